"""Drag saved in a leader's vortex
===============================

A wingman saves drag in the upwash beside its leader's wing-tip vortex. How much, and
what is left of it while the leader turns by 20 degrees and accelerates?

In the slot, 23.6 ft to the side, a third of the drag is saved. The peak is narrow: ten
feet farther out half of that is left, and ten feet farther in the downwash adds drag.
So the turn costs: for 6.6 s the saving is below 30 %, and at worst it is gone.

The scenario repeats a figure of a book chapter, and `ss.run` judges the claims of its
text as well. One of them, that the cost falls at every step of the turn, does not hold.

Prints::

    drag saved: 33.5 % in the slot, 28.9 % on average, at worst 0.6 %
    below 30 % for 6.6 s
    the cost falls at every step: False

The same as a shipped scenario: `swarmstart run close_formation`.
"""

import matplotlib.pyplot as plt

import swarmstart as ss

run = ss.run("close_formation", seed=0)
slot, mean, worst = (
    run.measures[f"drag_saving_{name}percent"] for name in ("ideal_", "", "min_")
)
print(
    f"drag saved: {slot:.1f} % in the slot, {mean:.1f} % on average, "
    f"at worst {worst:.1f} %"
)
print(f"below 30 % for {run.measures['drag_saving_low_s']:.1f} s")
falls = next(claim["holds"] for claim in run.claims if claim["id"] == "14")
print("the cost falls at every step:", falls)

places = [12, 17, 20, 22, 23.6, 25, 28, 34, 42]  # of other slots [ft]
savings = [
    ss.run(
        "close_formation",
        seed=0,
        settings={"steps": 1, "slot.y_ft": y, "start.y_ft": y},
    )
    for y in places
]

figure, (left, right) = plt.subplots(1, 2, sharey=True, width_ratios=[2, 3])
left.plot([each.measures["drag_saving_percent"] for each in savings], places, "o-")
left.axvline(0, color="0.5", linewidth=1)
left.set(xlabel="drag saved [%]", ylabel="place to the side [ft]")
right.plot(run.trajectory.dense_times, run.trajectory.dense_states[1], "k")
right.axvline(5, color="0.5", linewidth=1, linestyle=":", label="the leader turns")
for axes in (left, right):
    axes.axhline(23.6, color="tab:orange", label="the slot")
right.set(xlabel="time [s]")
right.legend()
plt.show()
