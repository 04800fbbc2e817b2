"""Two robots change places
========================

Two robots stand opposite each other and change places in 6 s. Each is a disc with a
radius of 1 m. Which way, and how much effort does it cost?

Both leave the straight line early, each to its own side, and touch in the middle. The
effort is 12.9, against 11.1 on straight lines through each other. `ss.stack_models`
makes one model of both, and `ss.Separation` is the distance that they keep.

Prints::

    a local optimum, confirmed on the finer grid
    cost 12.909
    smallest distance 2.00 m

The same in YAML; `swarmstart run several_vehicles.yaml` solves it:

.. literalinclude:: ../../../examples/vehicles/several_vehicles.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

LEFT, RIGHT = [0, 0, 0, 0], [10, 0, 0, 0]  # x, y [m], vx, vy [m/s]


def robot(name: str) -> ss.Model:
    """Return a robot in the plane whose acceleration is chosen."""
    x, y, vx, vy, ax, ay = (
        ca.SX.sym(f"{part}_{name}") for part in ("x", "y", "vx", "vy", "ax", "ay")
    )
    return ss.Model(
        states=ca.vertcat(x, y, vx, vy),
        controls=ca.vertcat(ax, ay),
        ode=ca.vertcat(vx, vy, ax, ay),
    )


both = ss.stack_models([robot("first"), robot("second")])
first, second = both.states[:2], both.states[4:6]
problem = ss.OptimalControlProblem(
    both,
    horizon=6.0,  # s
    intervals=30,
    stage_cost=ca.sumsqr(both.controls),
    bounds=ss.Bounds(controls=(-2.0, 2.0)),  # m/s^2
    constraints=[ss.Separation(relative=first - second, distance=2.0)],  # m
    terminal=[(both.states, [*RIGHT, *LEFT])],
)
solution = ss.solve(problem, [*LEFT, *RIGHT], seed=0)
path = solution.path.states
apart = np.hypot(*(path[:2] - path[4:6]))
print(solution.status.value)
print(f"cost {solution.cost:.3f}")
print(f"smallest distance {apart.min():.2f} m")

axes = plt.figure(figsize=(6.4, 3)).add_subplot(
    aspect="equal", xlabel="x [m]", ylabel="y [m]"
)
for (x, y), colour in ((path[:2], "tab:blue"), (path[4:6], "tab:orange")):
    axes.plot(x, y, color=colour)
    for moment in np.linspace(0, len(x) - 1, 13).astype(int):
        fade = 0.1 + 0.25 * moment / len(x)
        axes.add_patch(plt.Circle((x[moment], y[moment]), 1, color=colour, alpha=fade))
    axes.plot(x[-1], y[-1], "o", color=colour)
plt.show()
