"""Throw a ball as far as possible
===============================

A motor swings an arm of 0.8 m that throws a ball. It is too weak to lift the arm
directly, and has 1.5 s. When does the arm let go, and how far does the ball get?

It throws underhand: the arm swings back to -128 degrees, then forward, lets go at 43
degrees, and the ball gets 8.67 m far. Two stages with equations of their own are joined
by `ss.phases`: the last state of the arm gives the first state of the ball, and both
durations are decided. IPOPT alone, from its simple starts, finds no throw at all; most
of the random starts in lanes lead to this one.

Prints::

    8.67 m, released at 43 degrees with 8.7 m/s

The same in YAML; `swarmstart run hybrid_stages.yaml` solves it:

.. literalinclude:: ../../../examples/processes/hybrid_stages.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

angle, rate, torque = (ca.SX.sym(name) for name in ("angle", "rate", "torque"))
x, y, vx, vy = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy"))
hand = 0.8 * ca.vertcat(ca.sin(angle), -ca.cos(angle))  # m, from the shoulder
arm = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(angle, rate),  # rad from hanging down, rad/s
        controls=torque,  # N m
        ode=ca.vertcat(rate, (torque - 15.7 * ca.sin(angle)) / 0.96),  # kg m^2
    ),
    horizon=ss.Free(0.2, 1.5), intervals=24, maximize=True,  # s
    bounds=ss.Bounds(controls=(-12, 12), states=([-6.3, -30], [6.3, 30])),
)  # fmt: skip
drag = 0.01 * ca.sqrt(vx**2 + vy**2)  # 1/s
ball = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, vx, vy),  # m, m/s
        controls=ca.SX(0, 1),  # no controls
        ode=ca.vertcat(vx, vy, -drag * vx, -9.81 - drag * vy),
    ),
    horizon=ss.Free(0.2, 5.0), intervals=16, maximize=True,
    terminal_cost=x, terminal=[y],
)  # fmt: skip
release = {
    "x": hand[0],
    "y": 1.5 + hand[1],
    "vx": -rate * hand[1],
    "vy": rate * hand[0],
}
both = ss.phases([arm, ball], [release])
solution = ss.solve(both.problem, both.start([0, 0]), seed=0)

angles, rates = solution.states[:2, :25]
degrees, speed = np.degrees(angles[-1]), 0.8 * rates[-1]
print(f"{solution.cost:.2f} m, released at {degrees:.0f} degrees with {speed:.1f} m/s")

hands = np.array([0.8 * np.sin(angles), 1.5 - 0.8 * np.cos(angles)])
axes = plt.figure().add_subplot(aspect="equal", xlabel="x [m]", ylabel="y [m]")
axes.set_prop_cycle(color=plt.get_cmap("viridis_r")(np.linspace(0.1, 1, 25)))
axes.plot([0 * hands[0], hands[0]], [0 * hands[1] + 1.5, hands[1]], lw=2)
axes.plot(*np.hstack([hands[:, -1:], solution.states[2:4, 25:]]), "o-", color="C0")
plt.show()
