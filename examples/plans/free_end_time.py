"""Reach a point in the least time, with an end time that is decided.

Shows: `Free`, and an answer that is known in closed form: full acceleration, then full
braking, 2 s in all.

Prints:
    end time 2.0000 s, in closed form 2 s
    acceleration at first 1.00, at last -1.00 m/s^2
"""

import casadi as ca

import swarmstart as ss


def main() -> None:
    """Solve the problem of least time, and compare with the closed form."""
    x, v, acceleration = (ca.SX.sym(name) for name in ("x", "v", "acceleration"))
    problem = ss.OptimalControlProblem(
        ss.Model(
            states=ca.vertcat(x, v),
            controls=acceleration,
            ode=ca.vertcat(v, acceleration),
        ),
        horizon=ss.Free(0.5, 5.0),  # s
        intervals=20,
        stage_cost=ca.SX(1),  # its integral is the time
        bounds=ss.Bounds(controls=(-1.0, 1.0)),
        terminal=[x - 1, v],
    )
    solution = ss.solve(problem, x0=[0, 0], seed=0)
    pushes = solution.controls[0]
    print(f"end time {solution.times[-1]:.4f} s, in closed form 2 s")
    print(f"acceleration at first {pushes[0]:.2f}, at last {pushes[-1]:.2f} m/s^2")


if __name__ == "__main__":
    main()
