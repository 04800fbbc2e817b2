"""A predictive controller as one file of C
========================================

A controller swings up a pendulum by plans of 2 s, and hands over to a linear law near
the top. How does it come onto a microcontroller?

`ss.export_c` writes it as one C99 file, without heap and recursion, with a limit of the
operations of a step, and the certificate of its terminal set goes along. The C compiler
of this machine compiles it, and in the same closed loop it steers as the library does,
though it plans by an interior-point method of its own and not by IPOPT.

Prints::

    pendulum.c pendulum.h CMakeLists.txt pendulum.certificate.json
    the same states to 0.0001: True

There is no YAML form of this page; `swarmstart export c pendulum` does the same for a
shipped scenario.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(angle, speed),  # rad from upright, rad/s
        controls=torque,  # N m; mass and length are 1
        ode=ca.vertcat(speed, torque + 9.81 * ca.sin(angle)),
    ),
    horizon=2.0,  # s
    intervals=20,
    stage_cost=10 * angle**2 + 0.1 * speed**2 + 0.05 * torque**2,
    terminal_cost=100 * angle**2 + 10 * speed**2,
    bounds=ss.Bounds(controls=(-5.0, 5.0)),
)
weights = ss.Weights(Q=np.diag([10.0, 0.1]), R=np.array([[0.05]]))
rng = np.random.default_rng(0)
near = ss.terminal_set_of(problem, at=[0, 0], weights=weights, rng=rng)
planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
loop = ss.RecedingHorizon(planner=planner)
dual = ss.DualMode(loop, sets=[near], targets=[lambda time: np.zeros(2)])

hanging = [-np.pi, 0.0]
made = ss.export_c(dual, hanging, name="pendulum")
print(*made.files)
plant = ss.Plant(problem.model, dt=problem.dt, substeps=10)
library = ss.simulate(plant, dual, hanging, steps=40, seed=0)
try:
    compiled = made.controller()
except ss.NoCCompilerError as error:
    raise SystemExit(f"not compiled: {error}") from None
in_c = ss.simulate(plant, compiled, hanging, steps=40, seed=0)
apart = abs(in_c.states - library.states).max()
print("the same states to 0.0001:", bool(apart < 1e-4))

figure, (top, bottom) = plt.subplots(2, 1, sharex=True)
for run, name, style in (
    (library, "the library", {"color": "tab:orange", "linewidth": 6, "alpha": 0.5}),
    (in_c, "the C file", {"color": "black", "linewidth": 1.5}),
):
    top.plot(run.times, np.degrees(run.states[0]), label=name, **style)
    bottom.stairs(run.controls[0], run.times, baseline=None, **style)
top.set(ylabel="angle [deg]")
bottom.set(xlabel="time [s]", ylabel="torque [N m]")
top.legend()
plt.show()
