"""Cross a river with a current
============================

A boat does 2 m/s in still water. It has to reach the point straight across a river of
100 m. The current has a parabolic profile and reaches 2.6 m/s in the middle, so that no
heading holds the boat on the straight line. What is the fastest way?

The boat drives upstream along the bank first, where the water is slow, then lets the
current carry it past the line, and comes back along the other bank: 77.13 s. In still
water it would be 50 s. IPOPT alone finds this plan too; the random starts also end in
slower ones. This is Zermelo's problem of 1931 with a current that differs by place.

Prints::

    least time 77.13 s
    30 m upstream, then 18 m downstream of the line

The same in YAML; `swarmstart run zermelo_current.yaml` solves it:

.. literalinclude:: ../../../examples/plans/zermelo_current.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

across, along, heading = (ca.SX.sym(name) for name in ("across", "along", "heading"))
speed, fastest, width = 2.0, 2.6, 100.0  # m/s, m/s, m


def current(across):
    """Speed of the water, greatest in the middle of the river [m/s]."""
    return 4 * fastest * across * (width - across) / width**2


problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(across, along),  # m
        controls=heading,  # rad, from straight across to downstream
        ode=speed * ca.vertcat(ca.cos(heading), ca.sin(heading))
        + ca.vertcat(0, current(across)),
    ),
    horizon=ss.Free(20.0, 400.0),  # s
    intervals=40,
    stage_cost=ca.SX(1),  # its integral is the time
    bounds=ss.Bounds(controls=(-np.pi, np.pi), states=([0, -500], [width, 500])),
    terminal=[across - width, along],
)
solution = ss.solve(problem, [0, 0], seed=0)
way = solution.path.states[:2]
print(f"least time {solution.cost:.2f} s")
print(
    f"{-way[1].min():.0f} m upstream, then {way[1].max():.0f} m downstream of the line"
)

axes = plt.figure().add_subplot(xlabel="across the river [m]", ylabel="downstream [m]")
grid = np.meshgrid(np.linspace(5, 95, 13), np.linspace(-36, 24, 7))
water = current(grid[0])
axes.imshow(
    water[:1],
    extent=(0, width, -40, 32),
    cmap="Blues",
    alpha=0.6,
    interpolation="bilinear",
)
axes.quiver(*grid, 0 * water, water, color="tab:blue", alpha=0.6, scale=50)
axes.plot(*way, "k", linewidth=2)
bow = np.array([np.cos(solution.controls[0]), np.sin(solution.controls[0])])
axes.quiver(*solution.states[:, 1:-1:3], *bow[:, 1::3], color="tab:red", scale=18)
axes.set(aspect="equal", title="blue: the current; red: where the bow points")
plt.show()
