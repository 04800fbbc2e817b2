"""Prove how far an answer is from the optimum, at most.

Shows: `solve(..., bound=seconds)`. The bound is proven: no control costs less. More
seconds lead to a higher bound; here the gap is soon below 0.1 %.

Prints:
    answer 0.496, lower bound proven
    at most 10 % above the optimum: True
"""

import casadi as ca

import swarmstart as ss


def main() -> None:
    """Solve a small problem, and prove a lower bound of its cost."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u - x**3),
        horizon=1.0,
        intervals=20,
        stage_cost=x**2 + u**2,
        bounds=ss.Bounds(controls=(-1.0, 1.0), states=(-2.0, 2.0)),
    )
    solution = ss.solve(problem, x0=[1.0], seed=0, bound=20.0)  # seconds for the bound
    bound, gap = solution.bound, solution.gap
    if bound is None or gap is None:
        raise SystemExit("expected a bound")
    close = gap.gap is not None and gap.gap < 0.1
    print(f"answer {solution.cost:.3f}, lower bound {bound.kind.value}")
    print(f"at most 10 % above the optimum: {close}")


if __name__ == "__main__":
    main()
