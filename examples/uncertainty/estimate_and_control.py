"""Swing up by noisy measurements of the angle
===========================================

Only the angle of a pendulum is measured, every 0.1 s and with noise of 0.02 rad. Its
speed and its friction are unknown. Can it still be swung up?

It gets up and stays there. The speed is estimated to 0.10 rad/s, of up to 6 rad/s. The
estimation is an optimal-control problem too: the past 0.8 s that fit the measurements
best, with a decided start (`ss.Free`) and with an unknown torque in place of friction.
The controller is a class of your own, with one method, around `ss.RecedingHorizon`.

Prints::

    error of the speed 0.10 rad/s; height 1.000

It has no YAML form: a file of swarmstart cannot state an estimator.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

NOISE, STEP, WINDOW = 0.02, 0.1, 8  # rad, s, number of intervals
angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
sensor, motor = ca.SX.sym("sensor"), ca.SX.sym("motor")
low, misfit = 1 + ca.cos(angle), ((angle - sensor) / NOISE) ** 2


def pendulum(friction: float) -> ss.Model:
    """Return a pendulum of 1 kg and 1 m, with friction [N m s]."""
    rates = ca.vertcat(speed, torque - 9.81 * ca.sin(angle) - friction * speed)
    return ss.Model(states=ca.vertcat(angle, speed), controls=torque, ode=rates)


swing_up = ss.OptimalControlProblem(
    pendulum(0), horizon=2.0, intervals=20, bounds=ss.Bounds(controls=(-5.0, 5.0)),
    stage_cost=10 * low + 0.1 * speed**2 + 0.05 * torque**2,
    terminal_cost=100 * low + 10 * speed**2,
)  # fmt: skip
past = ss.OptimalControlProblem(  # friction, as a torque, has a cost
    pendulum(0), horizon=WINDOW * STEP, intervals=WINDOW, terminal_cost=misfit,
    step_cost=misfit + ((torque - motor) / 0.5) ** 2,
    start={"angle": ss.Free(), "speed": ss.Free()}, signals=ca.vertcat(sensor, motor),
)  # fmt: skip
estimator = ss.Planner(past, search=None, polish=ss.IpoptOptions())
planner = ss.Planner(swing_up, search="lshade", polish=ss.IpoptOptions())
loop = ss.RecedingHorizon(planner=planner)
seen, torques, estimates = [0.0] * WINDOW, [0.0] * WINDOW, [np.zeros(2)] * WINDOW


class ByMeasurements:
    """A controller that estimates the state from noisy angles."""

    dt = STEP

    def decide(self, time, state, previous, *, rng):  # type: ignore[no-untyped-def]
        """Return the decision for the estimated state."""
        seen.append(state[0] + NOISE * rng.standard_normal())
        known = ss.Known(signals=[seen[-WINDOW - 1 :], [*torques[-WINDOW:], 0.0]])
        old = {"guess": [torques[-WINDOW:]], "near": True}
        fit = estimator.plan(estimates[-WINDOW], known=known, rng=rng, **old)
        estimates.append(fit.states[:, -1])
        decision = loop.decide(time, estimates[-1], previous, rng=rng)
        torques.append(float(decision.control[0]))
        return decision


plant = ss.Plant(pendulum(friction=0.2), dt=STEP, substeps=20)
run = ss.simulate(plant, ByMeasurements(), [0.0, 0.0], steps=80, seed=0)
speeds, times = np.array(estimates)[WINDOW:, 1], run.times[:-1]
error = np.sqrt(((speeds - run.states[1, :-1]) ** 2).mean())
print(f"error of the speed {error:.2f} rad/s; height {-np.cos(run.states[0, -1]):.3f}")

axes = plt.figure().add_subplot(xlabel="time [s]", ylabel="angle [rad], speed [rad/s]")
axes.plot(run.dense_times, run.dense_states.T, "k", lw=1, label=("true", None))
axes.plot(times, seen[WINDOW:], "o", color="C1", ms=4, label="measured angle")
axes.plot(times, speeds, "^", color="C0", ms=4, label="estimated speed")
axes.legend(loc="lower right")
plt.show()
