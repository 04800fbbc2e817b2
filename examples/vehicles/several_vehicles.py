"""Let two vehicles change places without coming too close.

Shows: `stack_models`, which makes one model of several, and `Separation`, a distance
between two of them.

Prints:
    a local optimum, confirmed on the finer grid
    cost 12.909
    smallest distance 2.00 m
"""

import casadi as ca
import numpy as np

import swarmstart as ss

LEFT, RIGHT = [0, 0, 0, 0], [10, 0, 0, 0]  # x, y [m], vx, vy [m/s]


def vehicle(name: str) -> ss.Model:
    """Return a vehicle in the plane whose acceleration is chosen."""
    x, y, vx, vy = (ca.SX.sym(f"{part}_{name}") for part in ("x", "y", "vx", "vy"))
    ax, ay = ca.SX.sym(f"ax_{name}"), ca.SX.sym(f"ay_{name}")
    return ss.Model(
        states=ca.vertcat(x, y, vx, vy),
        controls=ca.vertcat(ax, ay),
        ode=ca.vertcat(vx, vy, ax, ay),
    )


def main() -> None:
    """Plan for both vehicles at once."""
    both = ss.stack_models([vehicle("first"), vehicle("second")])
    first, second = both.states[:2], both.states[4:6]
    problem = ss.OptimalControlProblem(
        both,
        horizon=6.0,
        intervals=30,
        stage_cost=ca.sumsqr(both.controls),
        bounds=ss.Bounds(controls=(-2.0, 2.0)),
        constraints=[ss.Separation(relative=first - second, distance=2.0)],
        terminal=[(both.states, [*RIGHT, *LEFT])],
    )
    solution = ss.solve(problem, [*LEFT, *RIGHT], seed=0)
    apart = np.hypot(*(solution.path.states[:2] - solution.path.states[4:6]))
    print(solution.status.value)
    print(f"cost {solution.cost:.3f}")
    print(f"smallest distance {apart.min():.2f} m")


if __name__ == "__main__":
    main()
