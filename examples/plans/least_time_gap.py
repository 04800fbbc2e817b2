"""Least time through a gap
========================

A vehicle reaches a place on the other side of a wall in the least time. The straight
way is blocked, one gap is narrow and near, and beyond the wall's ends there is room.

The narrow gap is the best of three ways. Its end time is decided with the controls:
`ss.Free` takes the place of the length of the plan.

Prints::

    least time 6.453 s
    three ways: 6.453, 7.044, 8.842 s

The same in YAML; `swarmstart run least_time_gap.yaml` solves it:

.. literalinclude:: ../../../examples/plans/least_time_gap.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt

import swarmstart as ss

x, y, vx, vy, ax, ay = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy", "ax", "ay"))
posts = [(5.0, -0.6, 1.6), (5.0, 2.9, 1.6)]  # x, y and radius [m]

problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, vx, vy),
        controls=ca.vertcat(ax, ay),
        ode=ca.vertcat(vx, vy, ax, ay),
    ),
    horizon=ss.Free(3.0, 12.0),  # s
    intervals=40,
    stage_cost=ca.SX(1),  # its integral is the time
    bounds=ss.Bounds(controls=(-1.0, 1.0)),
    constraints=[
        ss.PathConstraint(expression=ax**2 + ay**2, upper=1.0),
        *[ss.disc(ca.vertcat(x, y), centre=[a, b], radius=r) for a, b, r in posts],
    ],
    terminal=[x - 10, y, vx, vy],
)
solution = ss.solve(problem, [0, 0, 0, 0], seed=0)
print(f"least time {solution.cost:.3f} s")
print("three ways:", ", ".join(f"{way.cost:.3f}" for way in solution.optima[:3]), "s")

axes = plt.figure().add_subplot(aspect="equal", xlabel="x [m]", ylabel="y [m]")
for a, b, r in posts:
    axes.add_patch(plt.Circle((a, b), r, color="0.75"))
for way in solution.optima[:3]:
    axes.plot(*way.states[:2], "--", linewidth=1, label=f"{way.cost:.2f} s")
axes.plot(*solution.path.states[:2], "k", linewidth=2, label="the answer")
axes.legend()
plt.show()
