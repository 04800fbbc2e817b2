"""Turn a satellite in the least time
==================================

A satellite with three equal moments of inertia has to turn by half a turn about its
z-axis. It has a torque of at most 1 N m about each axis. A plain turn about z uses one
of the three: it takes 2 sqrt(pi) = 3.545 s. Is there a faster way?

There is: 3.244 s. The satellite leans over by 47 degrees on the way, so that all three
torques help, and comes back. IPOPT finds no plan from zero controls; the random starts
of `ss.solve` lead to this one and to its mirror images, which take as long. Bilimoria
and Wie found it in 1993: 3.243 s, with torques that may switch at any time.

Prints::

    least time 3.244 s, plain turn 3.545 s
    the z-axis leans over by 47 degrees

The same in YAML; `swarmstart run satellite_slew.yaml` solves it:

.. literalinclude:: ../../../examples/plans/satellite_slew.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import swarmstart as ss

q0, q1, q2, q3, wx, wy, wz = (ca.SX.sym(n) for n in "q0 q1 q2 q3 wx wy wz".split())
torques = ca.vertcat(*(ca.SX.sym(name) for name in ("tx", "ty", "tz")))  # N m
turning = ca.vertcat(
    -q1 * wx - q2 * wy - q3 * wz,
    q0 * wx - q3 * wy + q2 * wz,
    q3 * wx + q0 * wy - q1 * wz,
    -q2 * wx + q1 * wy + q0 * wz,
)
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(q0, q1, q2, q3, wx, wy, wz),  # quaternion, rad/s
        controls=torques,
        ode=ca.vertcat(turning / 2, torques),  # with 1 kg m^2 about each axis
    ),
    horizon=ss.Free(1.0, 10.0),  # s
    intervals=40,
    substeps=2,
    stage_cost=ca.SX(1),  # its integral is the time
    bounds=ss.Bounds(controls=(-1.0, 1.0)),
    terminal=[q0, q1, q2, wx, wy, wz],  # so q3 is 1 or -1, which is the same attitude
)
start = [1, 0, 0, 0, 0, 0, 0]
solution = ss.solve(problem, start, search=None, lanes=32, seed=0)
w, *vector = solution.path.states[:4]
attitudes = Rotation.from_quat(np.array([*vector, w]).T)
lean = np.degrees(np.arccos(attitudes.apply([0, 0, 1])[:, 2].min()))
print(f"least time {solution.cost:.3f} s, plain turn {2 * np.sqrt(np.pi):.3f} s")
print(f"the z-axis leans over by {lean:.0f} degrees")

figure = plt.figure()
ball, rates = figure.add_subplot(121, projection="3d"), figure.add_subplot(122)
u, v = np.mgrid[0 : 2 * np.pi : 25j, 0 : np.pi : 13j]
globe = [np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)]
ball.plot_wireframe(*globe, color="0.85", linewidth=0.6)
for row, (name, colour) in enumerate(zip("xyz", ("C0", "C1", "k"), strict=True)):
    tip = attitudes.apply(np.eye(3)[row])
    ball.plot(*tip.T, color=colour, linewidth=3)
    ball.plot(*np.outer(tip[0], [0, 1.3]), ":", color=colour)
    rates.plot(solution.times, solution.states[4 + row], color=colour, label=name)
ball.set_axis_off()
ball.set_box_aspect((1, 1, 1), zoom=1.5)
ball.view_init(elev=35, azim=-40)
rates.set(xlabel="time [s]", ylabel="rate about each axis [rad/s]")
rates.legend()
plt.show()
