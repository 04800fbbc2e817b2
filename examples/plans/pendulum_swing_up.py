"""Swing up a pendulum with a torque that is too weak to lift it at once.

Shows: a model, a problem, one call of `solve`, and the answer's status, cost and
arrays.

Prints:
    a local optimum, confirmed on the finer grid
    cost 36.713
    the pendulum swings back to -0.99 rad before it goes up
    largest torque 5.81 of 8 N m
"""

import casadi as ca
import numpy as np

import swarmstart as ss


def pendulum() -> ss.OptimalControlProblem:
    """Return the problem: from hanging to upright in 3 s with the least torque."""
    angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
    model = ss.Model(
        states=ca.vertcat(angle, speed),  # rad, rad/s
        controls=torque,  # N m
        ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle)),
    )
    return ss.OptimalControlProblem(
        model,
        horizon=3.0,
        intervals=50,
        stage_cost=torque**2,
        bounds=ss.Bounds(controls=(-8.0, 8.0)),
        terminal=[angle - np.pi, speed],
    )


def main() -> None:
    """Solve the problem and print what the answer says."""
    solution = ss.solve(pendulum(), x0=[0, 0], seed=0)
    angle, torque = solution.states[0], solution.controls[0]
    lowest = angle.min() * np.sign(angle[-1])
    print(solution.status.value)
    print(f"cost {solution.cost:.3f}")
    print(f"the pendulum swings back to {lowest:.2f} rad before it goes up")
    print(f"largest torque {abs(torque).max():.2f} of 8 N m")


if __name__ == "__main__":
    main()
