"""Swing up a pendulum on a cart
=============================

A cart carries a pendulum, which hangs down. Pushes of at most 80 N bring it upright; an
error of position or angle costs most. What does the cart do?

The cart jumps 1.23 m to the side, at full force, and back under the pendulum: it stands
half a second after the start. IPOPT alone finds this too. Most of the random starts of
`ss.solve` agree, the others end at nearly twice the cost or more.

Prints::

    cost 1995.7, then 3682.5
    the cart goes 1.23 m to the side
    furthest from upright after 0.5 s: 0.14 rad

The same as a shipped scenario: `swarmstart run pendulum_on_cart`.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

names = ("position", "theta", "velocity", "dtheta", "force")
position, theta, velocity, dtheta, force = (ca.SX.sym(name) for name in names)
cart, bob, rod, g = 1.0, 0.1, 0.8, 9.81  # kg, kg, m, m/s^2; theta is 0 upright
sine, cosine = ca.sin(theta), ca.cos(theta)
swing, denominator = bob * rod * sine * dtheta**2, cart + bob - bob * cosine**2
push = (-swing + bob * g * cosine * sine + force) / denominator
tilt = (-swing * cosine + force * cosine + (cart + bob) * g * sine) / (
    rod * denominator
)
goal = 1e3 * (position**2 + theta**2) + 1e-2 * (velocity**2 + dtheta**2)
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(position, theta, velocity, dtheta),
        controls=force,  # N
        ode=ca.vertcat(velocity, dtheta, push, tilt),
    ),
    horizon=1.0,  # s
    intervals=20,
    stage_cost=goal + 1e-2 * force**2,
    terminal_cost=goal,
    bounds=ss.Bounds(controls=(-80.0, 80.0)),
)
solution = ss.solve(problem, [0, np.pi, 0, 0], seed=0)
places, angles = solution.states[:2]
print(f"cost {solution.cost:.1f}, then {solution.optima[1].cost:.1f}")
print(f"the cart goes {places.max():.2f} m to the side")
print(f"furthest from upright after 0.5 s: {abs(angles[10:]).max():.2f} rad")

figure, (motion, effort) = plt.subplots(2, 1, height_ratios=[3, 1])
colours = plt.cm.viridis(np.linspace(0, 0.95, 12))
for place, angle, colour in zip(places, angles, colours, strict=False):
    motion.plot(place, 0, "s", color=colour, markersize=12, alpha=0.8)
    top = (place - rod * np.sin(angle), rod * np.cos(angle))
    motion.plot([place, top[0]], [0, top[1]], color=colour)
    motion.plot(*top, "o", color=colour, markersize=8)
motion.set(aspect="equal", xlabel="x [m]", ylabel="height [m]", xlim=(-1.2, 2.4))
effort.stairs(solution.controls[0], solution.times, color="k")
effort.scatter(solution.times[:12], 0 * colours[:, 0], c=colours, zorder=3)
effort.set(xlabel="time [s]", ylabel="force [N]")
plt.show()
