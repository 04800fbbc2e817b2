"""The race line round a hairpin
=============================

A car drives a hairpin of 180 degrees in the least time. The tyres give 10 m/s^2 in all,
for turning, braking and driving together; the engine gives at most 5. The road is 10 m
wide. Which line is the fastest?

The car brakes while it turns in from the outside, touches the inner edge, and leaves
the bend along the outer edge under full power: 9.48 s. On the middle line it could hold
14 m/s in the bend, and slows to 11; but the middle line would take 10.52 s. IPOPT alone
finds this line too, and all random starts of `ss.solve` that lead to a plan agree.

Prints::

    least time 9.48 s
    slowest: 11.3 m/s, 4.6 m left of the middle

The same in YAML; `swarmstart run race_line.yaml` solves it:

.. literalinclude:: ../../../examples/plans/race_line.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

names = ("along", "offset", "angle", "speed", "acceleration", "turn")
along, offset, angle, speed, acceleration, turn = (ca.SX.sym(name) for name in names)
straight, radius, half_width = 80.0, 20.0, 5.0  # m
length = 2 * straight + np.pi * radius
rise = ca.tanh((along - straight) / 4) - ca.tanh((along - length + straight) / 4)
curvature = rise / (2 * radius)  # of the middle of the road [1/m]
progress = speed * ca.cos(angle) / (1 - offset * curvature)
swing = turn - curvature * progress
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(along, offset, angle, speed),  # m, m, rad, m/s
        controls=ca.vertcat(acceleration, turn),  # m/s^2, rad/s
        ode=ca.vertcat(progress, speed * ca.sin(angle), swing, acceleration),
    ),
    horizon=ss.Free(5.0, 30.0),  # s
    intervals=50,
    substeps=2,
    stage_cost=ca.SX(1),  # its integral is the time
    bounds=ss.Bounds(
        controls=([-10.0, -1.5], [5.0, 1.5]),
        states=([-1, -half_width, -1.5, 3], [300, half_width, 1.5, 60]),
    ),
    constraints=[acceleration**2 + (speed * turn) ** 2 <= 100.0],  # grip of the tyres
    terminal=[along - length],
)
solution = ss.solve(problem, [0, 0, 0, 30], search=None, lanes=16, seed=0)
line = solution.path.states
slowest = line[3].argmin()
print(f"least time {solution.cost:.2f} s")
print(
    f"slowest: {line[3, slowest]:.1f} m/s, {line[1, slowest]:.1f} m left of the middle"
)

grid = np.linspace(0, length, 500)
bends = ca.Function("bends", [along], [curvature])(grid).full().ravel()
course = np.cumsum(bends) * grid[1]  # rad
middle = np.cumsum([np.cos(course), np.sin(course)], axis=1) * grid[1]
left = np.array([-np.sin(course), np.cos(course)])
axes = plt.figure().add_subplot(aspect="equal", xlabel="x [m]", ylabel="y [m]")
edges = [middle + side * half_width * left for side in (-1, 1)]
axes.fill(*np.hstack([edges[0], edges[1][:, ::-1]]), color="0.85")
bx, by, nx, ny = (np.interp(line[0], grid, row) for row in (*middle, *left))
x, y = bx + line[1] * nx, by + line[1] * ny
points = axes.scatter(x, y, c=line[3], s=12, cmap="plasma")
plt.colorbar(points, label="speed [m/s]", shrink=0.8)
plt.show()
