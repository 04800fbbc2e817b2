"""Five aircraft form a V
======================

Five unmanned aircraft in a line abreast are to form a V behind a virtual leader, at 15
m/s. They turn by at most 10 degrees a second, and no two may come nearer than 3 m. The
lower two have to change places. How long does it take?

All are in their slots, within 1 m, after 8 s, and no two come nearer than 9.8 m. Each
one plans 8 s ahead, once a second, and avoids the plans of those before it. After seven
plans a linear law holds the V, in a terminal set that is proven. `ss.run` takes the
shipped scenario, here for 30 s in place of 60.

Prints::

    in the slots after 8 s, smallest distance 9.84 m
    steps without a feasible plan: 0
    steps under the linear law: 23 of 30

The same as a shipped scenario: `swarmstart run formation_v`.
"""

import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

run = ss.run("formation_v", seed=0, settings={"steps": 30})
settled, nearest = run.measures["settle_time_s"], run.measures["min_distance_m"]
print(f"in the slots after {settled:.0f} s, smallest distance {nearest:.2f} m")
print(f"steps without a feasible plan: {run.measures['infeasible_steps']}")
print(f"steps under the linear law: {run.measures['linear_steps']} of 30")

path = run.trajectory
x, y = path.dense_states.reshape(5, 4, -1)[:, 2:].transpose(1, 0, 2)  # m
axes = plt.figure(figsize=(6.4, 3)).add_subplot(aspect="equal")
end = np.searchsorted(path.dense_times, 11)
axes.plot(x[:, :end].T, y[:, :end].T, linewidth=2)
for seconds in (0, 3, 6, 10):
    now = np.searchsorted(path.dense_times, seconds)
    order = [2, 1, 0, 3, 4]  # along the V
    axes.plot(
        x[order, now], y[order, now], "o-", color="k", linewidth=0.8, markersize=5
    )
    axes.annotate(f"{seconds} s", (x[2, now], y[2, now] + 4), ha="center")
axes.set(xlabel="x [m]", ylabel="y [m]", ylim=(25, 105))
plt.show()
