"""Two ways past a disc
====================

A vehicle passes a disc on its way. It may pass above or below, and each way is a local
optimum: no small change makes it better.

From a guess below the disc IPOPT stays below, at cost 3.715. From many starts the way
above is found as well: 2.813, a quarter less. `solution.optima` lists both.

Prints::

    IPOPT from a guess below the disc: cost 3.715
    search, many starts and IPOPT: cost 2.813
    local optima found: 2.813, 3.715

The same in YAML; `swarmstart run obstacle_local_optima.yaml` solves it:

.. literalinclude:: ../../../examples/plans/obstacle_local_optima.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

x, y, vx, vy, ax, ay = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy", "ax", "ay"))
start, centre, radius = [0, 0, 0, 0], [5.0, -0.4], 1.5  # m, m/s
free, fastest = np.inf, 1.8  # m/s
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, vx, vy),
        controls=ca.vertcat(ax, ay),
        ode=ca.vertcat(vx, vy, ax, ay),
    ),
    horizon=8.0,  # s
    intervals=40,
    stage_cost=ax**2 + ay**2,
    bounds=ss.Bounds(
        controls=(-2.0, 2.0),
        states=([-free, -free, -fastest, -fastest], [free, free, fastest, fastest]),
    ),
    constraints=[ss.disc(ca.vertcat(x, y), centre=centre, radius=radius)],
    terminal=[x - 10, y, vx, vy],
)
guess = np.zeros((2, 40))
guess[1, :20], guess[1, 20:] = -0.3, 0.3  # down for 4 s, then up for 4 s
alone = ss.solve(problem, start, guess=guess, search=None, lanes=0, seed=0)
solution = ss.solve(problem, start, guess=guess, seed=0)
print(f"IPOPT from a guess below the disc: cost {alone.cost:.3f}")
print(f"search, many starts and IPOPT: cost {solution.cost:.3f}")
costs = ", ".join(f"{optimum.cost:.3f}" for optimum in solution.optima)
print(f"local optima found: {costs}")

axes = plt.figure().add_subplot(aspect="equal", xlabel="x [m]", ylabel="y [m]")
axes.add_patch(plt.Circle(centre, radius, color="0.75"))
axes.plot(*solution.path.states[:2], color="tab:blue", linewidth=2)
axes.plot(*alone.path.states[:2], "--", color="tab:orange", linewidth=2)
axes.annotate(
    f"many starts: {solution.cost:.2f}", (5, 1.25), ha="center", color="tab:blue"
)
axes.annotate(
    f"one guess: {alone.cost:.2f}", (5, -2.3), ha="center", color="tab:orange"
)
axes.set(ylim=(-2.7, 1.8))
plt.show()
