"""Cross a harbour between moving ships
====================================

A boat crosses three lanes within 12 s. Each has a ship that keeps its course: the boat
can pass before its bow or behind its stern. Which way takes the least effort?

The best way passes before the first ship and behind the two others, with an effort of
2.10. To pass before the second ship too costs hardly more, 2.13; eight ways were found
in all. IPOPT alone ends in one with four times the effort, 8.51. `time=` of the model
makes the places of the ships in `ss.disc` move; the answer is repaired until it keeps
its distance between the checks too.

Prints::

    effort 2.10 m^2/s^3; other ways: 2.13, 2.87

The same in YAML; `swarmstart run moving_obstacle.yaml` solves it:

.. literalinclude:: ../../../examples/uncertainty/moving_obstacle.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt

import swarmstart as ss

x, y, vx, vy, ax, ay = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy", "ax", "ay"))
time = ca.SX.sym("time")
# Place at the start [m], speed [m/s] and lane [m] of three round ships of 2 m radius.
ships = [(-7.0, 1.5, 3.0), (7.0, -1.2, 6.5), (-6.0, 1.0, 10.0)]
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, vx, vy),  # m, m/s
        controls=ca.vertcat(ax, ay),  # m/s^2
        ode=ca.vertcat(vx, vy, ax, ay),
        time=time,
    ),
    horizon=12.0,  # s
    intervals=24,
    checks=4,
    substeps=1,
    stage_cost=ax**2 + ay**2,
    bounds=ss.Bounds(controls=(-2, 2)),
    constraints=[
        ss.disc(ca.vertcat(x - a - b * time, y - c), centre=[0, 0], radius=2.0)
        for a, b, c in ships
    ],
    terminal=[x, y - 13, vx, vy],
)
solution = ss.solve(problem, [0, 0, 0, 0], seed=0)
others = ", ".join(f"{way.cost:.2f}" for way in solution.optima[1:3])
print(f"effort {solution.cost:.2f} m^2/s^3; other ways: {others}")

ways = (solution.states[:, ::4], *(way.states for way in solution.optima[1:3]))
panels = plt.figure().subplots(1, 4, sharey=True)
for panel, k in zip(panels, (6, 9, 14, 18), strict=True):
    for start, speed, lane in ships:
        at = start + speed * problem.dt * k
        panel.add_patch(plt.Circle((at, lane), 2.0, color="0.75"))
    for way, style in zip(ways, ("C0-", "C1--", "C2:"), strict=True):
        panel.plot(*way[:2, : k + 1], style, lw=2)
        panel.plot(*way[:2, k], "o", color=style[:2])
    panel.set(aspect="equal", xlim=(-4, 4), ylim=(-1, 14), xlabel="x [m]")
    panel.set_title(f"{problem.dt * k:g} s")
panels[0].set_ylabel("y [m]")
plt.show()
