"""A system of python-control, swung up
====================================

A script for python-control has an arm, whose motor is too weak to lift it, and an LQR
law for the arm upright. From hanging, that law comes no nearer to the top than 107
degrees. How can the same script bring it up?

By plans of 8 s: they swing to the other side first. `ss.Model.from_system` makes a
model of the `control.nlsys`, and the system itself is the plant of `ss.simulate`. After
8 s the script's own law takes over, in a terminal set in which it is proven to work.

Prints::

    LQR alone comes no nearer than 107 degrees
    with plans the law takes over at 8.0 s; 1.0 degrees are left at 11 s
    the gain of the law is that of the script: True

There is no YAML form: the system is an object of Python.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss


def rates(t, x, u, params):
    """Rates of the angle from upright [rad] and its rate; gravity and inertia are 1."""
    return [x[1], np.sin(x[0]) - 0.1 * x[1] + u[0]]


# The existing script: the arm, and its law near upright for a torque held for 0.2 s.
names = {"states": ["angle", "rate"], "inputs": ["torque"]}
arm = control.nlsys(rates, None, **names, name="arm")
Q, R, most = np.diag([1.0, 0.1]), np.array([[1.0]]), 0.6
K, P, _ = control.dlqr(control.sample_system(arm.linearize([0, 0], [0]), 0.2), Q, R)


def held(t, x, u, params):
    """Rates of the arm with that law, whose torque is clipped."""
    return rates(t, x, np.clip(-K @ x, -most, most), params)


times = np.linspace(0, 11, 200)
clipped = control.nlsys(held, None, **names)
lqr = control.input_output_response(clipped, times, 0, [np.pi, 0])
alone = np.degrees(lqr.states[0])
print(f"LQR alone comes no nearer than {alone.min():.0f} degrees")

# New: plans for the same system, which hand over to the same law.
model = ss.Model.from_system(arm)
x, u = model.states, model.controls
problem = ss.OptimalControlProblem(
    model,
    horizon=8.0,  # s
    intervals=40,
    stage_cost=(x.T @ Q @ x + u.T @ R @ u) / 0.2,
    quadrature="left",
    terminal_cost=x.T @ P @ x,
    bounds=ss.Bounds(controls=(-most, most)),
)
rng = np.random.default_rng(0)
near = ss.terminal_set_of(problem, at=[0, 0], weights=ss.Weights(Q=Q, R=R), rng=rng)
planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
loop = ss.RecedingHorizon(planner=planner)
dual = ss.DualMode(loop, sets=[near], targets=[lambda time: np.zeros(2)])
run = ss.simulate(arm, dual, [np.pi, 0], steps=55, seed=0)
first = [decision.mode for decision in run.decisions].index(ss.Mode.LINEAR)
begins, angle = run.times[first], np.degrees(run.states[0])
print(f"with plans the law takes over at {begins:.1f} s;", end=" ")
print(f"{angle[-1]:.1f} degrees are left at 11 s")
print("the gain of the law is that of the script:", np.allclose(near.K, K))

axes = plt.figure().add_subplot(xlabel="time [s]", ylabel="angle from upright [deg]")
axes.plot(times, alone, "--", label="LQR alone")
axes.plot(run.times, angle, label="plans, then LQR")
axes.plot(begins, angle[first], "ko", label="hand-over")
axes.legend()
plt.show()
