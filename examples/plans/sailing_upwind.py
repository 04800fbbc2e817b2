"""Sail to a buoy upwind
=====================

A buoy lies 200 m upwind, in a fairway of 70 m. A boat cannot sail into the wind: it has
to tack from side to side, and each tack costs speed. How often should it tack?

Three times, and as wide as the fairway allows: 192.6 s. Plans with four and with five
tacks are local optima too, since no small change takes a tack away. `solution.optima`
lists them. IPOPT alone ends in the first. The cost is the time and a loss for turns.

Prints::

    192.6 s with 3 tacks
    the best plan with 3 tacks costs 207.6
    the best plan with 4 tacks costs 216.0
    the best plan with 5 tacks costs 227.5

The same in YAML; `swarmstart run sailing_upwind.yaml` solves it:

.. literalinclude:: ../../../examples/plans/sailing_upwind.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

x, y, heading, turn = (ca.SX.sym(name) for name in ("x", "y", "heading", "turn"))


def polar(angle):
    """Speed of the boat at an angle to the wind, 0 into the wind [m/s]."""
    return 2.5 * (1 - ca.cos(angle)) * (1.35 + ca.cos(angle))


problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, heading),  # m, rad; the wind blows along -x
        controls=turn,  # rad/s
        ode=ca.vertcat(
            polar(heading) * ca.cos(heading), polar(heading) * ca.sin(heading), turn
        ),
    ),
    horizon=ss.Free(50.0, 400.0),  # s
    intervals=50,
    substeps=2,
    stage_cost=1 + 20 * turn**2,  # s: a turn brakes the boat
    bounds=ss.Bounds(controls=(-0.3, 0.3), states=([-50, -25, -2.5], [250, 45, 2.5])),
    terminal=[x - 200, y],
)
solution = ss.solve(problem, [0, 0, 0.8], search=None, seed=0)
tacks = [np.count_nonzero(np.diff(np.sign(way.states[2]))) for way in solution.optima]
print(f"{solution.times[-1]:.1f} s with {tacks[0]} tacks")
best = [solution.optima[tacks.index(count)] for count in (3, 4, 5)]
for count, way in zip((3, 4, 5), best, strict=True):
    print(f"the best plan with {count} tacks costs {way.cost:.1f}")

axes = plt.figure().add_subplot(aspect="equal", xlabel="upwind [m]", ylabel="y [m]")
axes.axhspan(-25, 45, color="tab:blue", alpha=0.1)
styles = [("k", "-"), ("tab:orange", "--"), ("tab:blue", ":")]
for count, way, (colour, line) in zip((3, 4, 5), best, styles, strict=True):
    axes.plot(*way.states[:2], line, color=colour, label=f"{count} tacks", linewidth=2)
for height in (-17, 10, 37):
    axes.annotate("", (208, height), (232, height), arrowprops={"color": "0.6"})
axes.text(220, 19, "wind", ha="center")
axes.set(xlim=(-4, 236))
axes.legend(loc="upper center", ncols=3, bbox_to_anchor=(0.5, 1.3))
plt.show()
