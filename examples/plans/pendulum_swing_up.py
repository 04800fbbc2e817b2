"""Swing up a pendulum
===================

The motor is too weak to lift the pendulum: gravity pulls it back with up to 9.81 N m,
and the motor has 8. Which torque brings it up in 3 s with the least effort?

The pendulum first swings back by almost a radian and gains height on the way. So it
needs no more than 5.8 N m. `ss.solve` finds this without a guess.

Prints::

    a local optimum, confirmed on the finer grid
    cost 36.713
    the pendulum swings back to -0.99 rad before it goes up
    largest torque 5.81 of 8 N m

The same as a shipped scenario: `swarmstart run pendulum`.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
model = ss.Model(
    states=ca.vertcat(angle, speed),  # rad, rad/s
    controls=torque,  # N m; 1 kg on a rod of 1 m
    ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle)),
)
problem = ss.OptimalControlProblem(
    model,
    horizon=3.0,  # s
    intervals=50,
    stage_cost=torque**2,
    bounds=ss.Bounds(controls=(-8.0, 8.0)),
    terminal=[angle - np.pi, speed],
)
solution = ss.solve(problem, x0=[0, 0], seed=0)
angles, torques = solution.states[0], solution.controls[0]
print(solution.status.value)
print(f"cost {solution.cost:.3f}")
lowest = angles.min() * np.sign(angles[-1])
print(f"the pendulum swings back to {lowest:.2f} rad before it goes up")
print(f"largest torque {abs(torques).max():.2f} of 8 N m")

figure, (motion, effort) = plt.subplots(1, 2)
for now, colour in zip(angles[::2], plt.cm.viridis(np.linspace(0, 1, 26)), strict=True):
    motion.plot([0, np.sin(now)], [0, -np.cos(now)], "o-", color=colour, markevery=[1])
motion.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
points = effort.scatter(angles[:-1], torques, c=solution.times[:-1])
effort.set(xlabel="angle [rad]", ylabel="torque [N m]")
figure.colorbar(points, label="time [s]")
plt.show()
