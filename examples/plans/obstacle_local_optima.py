"""Pass a disc on one of two sides: two local optima, one start and many starts.

Shows: bounds of states, `disc`, a first guess, IPOPT alone against `solve` with its
defaults, and the list of local optima that the answer keeps.

Prints:
    IPOPT from a guess below the disc: cost 3.715
    search, many starts and IPOPT: cost 2.813
    local optima found: 2.813, 3.715
"""

import casadi as ca
import numpy as np

import swarmstart as ss

START = [0, 0, 0, 0]


def past_a_disc() -> ss.OptimalControlProblem:
    """Return the problem: 10 m to the right in 8 s, with a disc in the way."""
    x, y, vx, vy = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy"))  # m, m/s
    ax, ay = ca.SX.sym("ax"), ca.SX.sym("ay")  # m/s^2
    free, fastest = np.inf, 1.8
    return ss.OptimalControlProblem(
        ss.Model(
            states=ca.vertcat(x, y, vx, vy),
            controls=ca.vertcat(ax, ay),
            ode=ca.vertcat(vx, vy, ax, ay),
        ),
        horizon=8.0,
        intervals=40,
        stage_cost=ax**2 + ay**2,
        bounds=ss.Bounds(
            controls=(-2.0, 2.0),
            states=([-free, -free, -fastest, -fastest], [free, free, fastest, fastest]),
        ),
        constraints=[ss.disc(ca.vertcat(x, y), centre=[5.0, -0.4], radius=1.5)],
        terminal=[x - 10, y, vx, vy],
    )


def main() -> None:
    """Solve it from one guess, then from many starts."""
    problem = past_a_disc()
    guess = np.zeros((2, 40))
    guess[1, :20], guess[1, 20:] = -0.3, 0.3  # down for 4 s, then up for 4 s
    alone = ss.solve(problem, START, guess=guess, search=None, lanes=0, seed=0)
    best = ss.solve(problem, START, guess=guess, seed=0)
    print(f"IPOPT from a guess below the disc: cost {alone.cost:.3f}")
    print(f"search, many starts and IPOPT: cost {best.cost:.3f}")
    costs = ", ".join(f"{optimum.cost:.3f}" for optimum in best.optima)
    print(f"local optima found: {costs}")


if __name__ == "__main__":
    main()
