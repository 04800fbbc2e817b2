"""Plans that know of no friction
==============================

A pendulum is swung up and held by a motor that is too weak to lift it directly. The
plans know of no friction; the real pendulum has some. Does it get up?

One plan for 2 s, followed to its end, stops 0.5 m below the top. With a new plan every
0.1 s, each from the measured state, the pendulum swings once more, gets up and stays
there, although no plan knows of the friction. `ss.RecedingHorizon` makes the plans,
`ss.OpenLoop` follows one only, and `ss.simulate` runs either on an `ss.Plant`.

Prints::

    one plan for 2 s: height 0.5
    60 plans, one every 0.1 s: height 1.000

The same in YAML; `swarmstart run closed_loop_mismatch.yaml` simulates the 60 plans:

.. literalinclude:: ../../../examples/uncertainty/closed_loop_mismatch.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))


def pendulum(friction: float) -> ss.Model:
    """Return a pendulum of 1 kg and 1 m, with friction [N m s]."""
    return ss.Model(
        states=ca.vertcat(angle, speed),  # rad, rad/s
        controls=torque,  # N m
        ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle) - friction * speed),
    )


low = 1 + ca.cos(angle)  # 0 upright, 2 hanging
problem = ss.OptimalControlProblem(
    pendulum(friction=0.0),
    horizon=2.0,
    intervals=20,
    stage_cost=10 * low + 0.1 * speed**2 + 0.05 * torque**2,
    terminal_cost=100 * low + 10 * speed**2,
    bounds=ss.Bounds(controls=(-5.0, 5.0)),
)
planner = ss.Planner(problem, search="lshade", polish=ss.IpoptOptions())
loop = ss.RecedingHorizon(planner=planner)
plant = ss.Plant(pendulum(friction=0.2), dt=problem.dt, substeps=10)
blind = ss.simulate(plant, ss.OpenLoop(loop=loop), [0, 0], steps=20, seed=0)
run = ss.simulate(plant, loop, [0, 0], steps=60, seed=0)
print(f"one plan for 2 s: height {-np.cos(blind.states[0, -1]):.1f}")
print(f"60 plans, one every 0.1 s: height {-np.cos(run.states[0, -1]):.3f}")

axes = plt.figure().add_subplot(xlabel="time [s]", ylabel="height of the bob [m]")
ahead = problem.dt * np.arange(problem.intervals + 1)
for start, decision in zip(run.times, run.decisions, strict=False):
    height = -np.cos(decision.plans[0].states[0])
    axes.plot(start + ahead, height, color="0.85", lw=1)
axes.plot([], [], color="0.85", label="the plans")
for flight, name in ((run, "a new plan every 0.1 s"), (blind, "one plan for 2 s")):
    axes.plot(flight.dense_times, -np.cos(flight.dense_states[0]), lw=2, label=name)
axes.set(xlim=(0, 6))
axes.legend(loc="lower right")
plt.show()
