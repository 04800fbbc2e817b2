"""Parameters from noisy measurements
==================================

The angle of a pendulum is measured 31 times, with noise of 0.25 rad (14 degrees), by a
sensor that shows tenths of a radian only. How long is the pendulum, and how large is
its friction?

It is 1.53 m long, with a friction of 0.10 1/s; the measurements were made with 1.5 m
and 0.1 1/s. IPOPT alone, from the middle of the bounds, ends in a wrong local optimum
with 28 times the misfit: its pendulum is short and soon at rest. `ss.solve` searches as
well. Nothing is controlled here: the parameters (`decided=`) and the state at the start
(`start=`) are decided so that the model comes nearest to the measurements, a signal.

Prints::

    solve: 1.53 m, 0.10 1/s, misfit 1.25
    IPOPT alone: 0.22 m, 1.00 1/s, misfit 35.04

The same in YAML; `swarmstart run estimate_parameters.yaml` solves it:

.. literalinclude:: ../../../examples/uncertainty/estimate_parameters.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

seen = [  # rad, every 0.4 s
    2.0, 1.5, 0.3, -1.3, -1.9, -1.2, 0.4, 1.6, 1.4, 0.5, -0.7,
    -1.4, -1.9, -0.3, 0.7, 1.2, 0.7, -0.5, -1.1, -0.8, -0.2,
    1.2, 1.0, 0.6, -0.3, -1.1, -1.0, -0.0, 0.8, 1.0, -0.1
]  # fmt: skip

angle, speed, measured = (ca.SX.sym(name) for name in ("angle", "speed", "measured"))
length, friction = ca.SX.sym("length"), ca.SX.sym("friction")
misfit = (angle - measured) ** 2
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(angle, speed),  # rad, rad/s
        controls=ca.SX(0, 1),  # no controls
        ode=ca.vertcat(speed, -9.81 / length * ca.sin(angle) - friction * speed),
        parameters=ca.vertcat(length, friction),  # m, 1/s
    ),
    horizon=12.0,
    intervals=30,
    step_cost=misfit,
    terminal_cost=misfit,
    signals=measured,
    start={"angle": ss.Free(-3, 3), "speed": ss.Free(-3, 3)},
    decided={"length": ss.Free(0.2, 5), "friction": ss.Free(0, 1)},
)
known = ss.Known(signals=[seen])
solution = ss.solve(problem, [np.nan, np.nan], known=known, seed=0)
alone = ss.solve(problem, [np.nan, np.nan], known=known, search=None, lanes=0, seed=0)
for answer, name in ((solution, "solve"), (alone, "IPOPT alone")):
    length, friction = answer.decided["length"], answer.decided["friction"]
    print(f"{name}: {length:.2f} m, {friction:.2f} 1/s, misfit {answer.cost:.2f}")

axes = plt.figure().add_subplot(xlabel="time [s]", ylabel="angle [rad]", xlim=(0, 12))
axes.errorbar(solution.times, seen, 0.25, fmt="o", color="C1", ms=5, label="measured")
axes.plot(solution.path.times, solution.path.states[0], lw=2, label="solve")
axes.plot(alone.path.times, alone.path.states[0], "k:", label="IPOPT alone")
axes.legend(loc="upper right")
plt.show()
