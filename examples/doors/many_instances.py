"""A map of costs and first controls
=================================

A vehicle at rest anywhere in the plane goes to the origin in 6 s with least effort,
round a disc. What does that cost from each of 864 places, and where does it head first?

Behind the disc the map has a ridge: on one side of it the vehicle passes above, on the
other below, and the first control jumps. A smooth feedback law, such as a small
network, would be wrong there. `ss.solve_many` solves all instances at once in SIMD
lanes and verifies each answer; places inside the disc are left out, with the reason.

Prints::

    808 CONVERGED
    56 INVALID

The same in YAML; `swarmstart sweep many_instances.yaml` solves all of them:

.. literalinclude:: ../../../examples/doors/many_instances.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

x, y, vx, vy, ax, ay = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy", "ax", "ay"))
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, vx, vy),  # m, m/s
        controls=ca.vertcat(ax, ay),  # m/s^2
        ode=ca.vertcat(vx, vy, ax, ay),
    ),
    horizon=6.0,  # s
    intervals=20,
    stage_cost=ax**2 + ay**2,
    bounds=ss.Bounds(controls=(-3.0, 3.0)),
    constraints=[ss.disc(ca.vertcat(x, y), centre=[3.0, 0.0], radius=1.5)],
    terminal=[x, y, vx, vy],
)
across, up = np.meshgrid(np.linspace(-2, 10, 36), np.linspace(-4, 4, 24))
rest = np.zeros(across.size)
many = ss.solve_many(problem, [across.ravel(), up.ravel(), rest, rest], seed=0)
for status, count in many.counts.items():
    print(f"{count} {status.name}")

cost = many.cost.reshape(across.shape)
first = many.controls[:, 0].reshape(2, *across.shape)
axes = plt.figure(figsize=(7.2, 4)).add_subplot(aspect="equal")
colours = axes.contourf(across, up, cost, 20, cmap="viridis")
arrows = first / np.hypot(*first)
axes.quiver(across, up, *arrows, color="w", width=0.003, scale=45, pivot="mid")
axes.add_patch(plt.Circle((3, 0), 1.5, color="0.6"))
axes.plot(0, 0, "w*", markersize=12)
axes.set(xlabel="x [m]", ylabel="y [m]", facecolor="0.6")
plt.colorbar(colours, label="cost [m²/s³]")
plt.show()
