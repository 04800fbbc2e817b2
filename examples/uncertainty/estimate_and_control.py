"""Swing up a simulator by measurements of its angle alone, which are noisy.

Shows: an estimation written as a problem, and a controller around `RecedingHorizon`.

Prints:
    error of the speed 0.10 rad/s; height 1.000
"""

import casadi as ca
import numpy as np

import swarmstart as ss

NOISE, STEP, WINDOW = 0.02, 0.1, 8  # rad, s, number of intervals
angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
measured, applied = ca.SX.sym("measured"), ca.SX.sym("applied")
MODEL = ss.Model(
    states=ca.vertcat(angle, speed),
    controls=torque,
    ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle)),
)
LOW, MISFIT = 1 + ca.cos(angle), ((angle - measured) / NOISE) ** 2
SWING_UP = ss.OptimalControlProblem(
    MODEL, horizon=20 * STEP, intervals=20, terminal_cost=100 * LOW + 10 * speed**2,
    stage_cost=10 * LOW + 0.1 * speed**2 + 0.05 * torque**2,
    bounds=ss.Bounds(controls=(-5.0, 5.0)),
)  # fmt: skip
# The past that fits best: its start is decided, and friction, as a torque, has a cost.
PAST = ss.OptimalControlProblem(
    MODEL, horizon=WINDOW * STEP, intervals=WINDOW, terminal_cost=MISFIT,
    step_cost=MISFIT + ((torque - applied) / 0.5) ** 2,
    signals=ca.vertcat(measured, applied), bounds=ss.Bounds(controls=(-20.0, 20.0)),
    start={"angle": ss.Free(-50.0, 50.0), "speed": ss.Free(-50.0, 50.0)},
)  # fmt: skip


class Pendulum:
    """A simulator, with friction that no plan knows."""

    def step(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
        """Return the state after a step."""
        for _ in range(100):
            rate = np.array([x[1], u[0] - 9.81 * np.sin(x[0]) - 0.2 * x[1]])
            x = x + dt / 100 * rate
        return x


class ByMeasurements:
    """A controller that sees the angle with noise, and estimates the state."""

    dt = STEP

    def __init__(self) -> None:
        """Begin with a past at rest."""
        self._past = ss.Planner(PAST, search=None, polish=ss.IpoptOptions())
        planner = ss.Planner(SWING_UP, search="lshade", polish=ss.IpoptOptions())
        self._loop = ss.RecedingHorizon(planner=planner)
        self._seen, self._torques = [0.0] * WINDOW, [0.0] * WINDOW
        self.estimates = [np.zeros(2)] * WINDOW

    def decide(self, time, state, previous, *, rng) -> ss.Decision:  # type: ignore[no-untyped-def]
        """Return the decision for the estimated state."""
        self._seen.append(state[0] + NOISE * rng.standard_normal())
        known = np.array([self._seen[-WINDOW - 1 :], [*self._torques[-WINDOW:], 0.0]])
        past = self._past.plan(
            self.estimates[-WINDOW], known=ss.Known(signals=known), near=True, rng=rng,
            guess=np.array([self._torques[-WINDOW:]]),
        )  # fmt: skip
        self.estimates.append(past.states[:, -1])
        decision = self._loop.decide(time, self.estimates[-1], previous, rng=rng)
        self._torques.append(float(decision.control[0]))
        return decision


def main() -> None:
    """Swing it up, and compare the estimated speeds with the true ones."""
    controller = ByMeasurements()
    run = ss.simulate(Pendulum(), controller, [0.0, 0.0], steps=80, seed=0)
    error = np.array(controller.estimates)[WINDOW:, 1] - run.states[1, :-1]
    rms, height = np.sqrt((error**2).mean()), -np.cos(run.states[0, -1])
    print(f"error of the speed {rms:.2f} rad/s; height {height:.3f}")


if __name__ == "__main__":
    main()
