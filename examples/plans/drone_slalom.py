"""A drone through three gates
===========================

A drone has to pass a high gate, a low gate soon after it, and a third one, in the least
time. Its rotors push one way only, and the body turns at most 8 rad/s.

The fastest plan is a loop: the drone passes the first gate upside down, so that its
rotors push it down, and comes out of the dive after one whole turn. IPOPT from zero
controls stays upright, which takes 3.322 s. A loop backwards is slower still.

Each gate ends a part of the plan with a length of its own; `ss.phases` joins the parts.

Prints::

    3.297 s with 1 turns of the body
    3.322 s with 0 turns of the body
    3.337 s with -1 turns of the body

The same in YAML; `swarmstart run drone_slalom.yaml` solves it:

.. literalinclude:: ../../../examples/plans/drone_slalom.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

names = ("x", "z", "vx", "vz", "pitch", "thrust", "turn")
x, z, vx, vz, pitch, thrust, turn = (ca.SX.sym(name) for name in names)
model = ss.Model(
    states=ca.vertcat(x, z, vx, vz, pitch),  # m, m/s, rad
    controls=ca.vertcat(thrust, turn),  # m/s^2 (per mass), rad/s
    ode=ca.vertcat(vx, vz, thrust * ca.sin(pitch), thrust * ca.cos(pitch) - 9.81, turn),
)
gates = [(5.0, 7.0), (8.0, 1.0), (14.0, 5.0)]  # x and height [m]
legs = [
    ss.OptimalControlProblem(
        model,
        horizon=ss.Free(0.3, 4.0),  # s
        intervals=12,
        stage_cost=ca.SX(1),
        bounds=ss.Bounds(controls=([2.0, -8.0], [20.0, 8.0])),
        terminal=[
            x - a,
            ss.TerminalConstraint(expression=z, lower=b - 0.3, upper=b + 0.3),
        ],
    )
    for a, b in gates
]
course = ss.phases(legs)
solution = ss.solve(
    course.problem, course.start([0, 2, 0, 0, 0]), search=None, lanes=32, seed=0
)


for way in solution.optima[:3]:
    turns = round(way.states[4, -1] / (2 * np.pi))
    print(f"{way.cost:.3f} s with {turns} turns of the body")

axes = plt.figure().add_subplot(aspect="equal", xlabel="x [m]", ylabel="height [m]")
without, ends = solution.optima[1], np.array([-0.4, 0.4])  # m, of the body
axes.plot(
    *without.states[:2],
    "--",
    color="tab:orange",
    label="upright",
)
axes.plot(*solution.path.states[:2], color="tab:blue", label="loop")
for a, b, *_, angle in solution.states[:5, ::2].T:
    up = np.array([np.sin(angle), np.cos(angle)])
    axes.quiver(a, b, *up, color="tab:red", scale=18, width=0.005)
    axes.plot(a + up[1] * ends, b - up[0] * ends, "k", linewidth=3)
for a, b in gates:
    axes.plot([a, a], [b - 0.5, b + 0.5], "o-", color="tab:green", linewidth=2)
axes.legend(loc="lower left")
plt.show()
