"""One plan, applied to its end, is the answer of `solve`."""

import casadi as ca
import numpy as np

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Planner,
    RecedingHorizon,
    solve,
)


def test_an_open_loop_flies_what_solve_answers() -> None:
    """This holds even if IPOPT stops at a kink, which `solve` rounds less and less."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=3.0,
        intervals=15,
        stage_cost=ca.fabs(u),
        bounds=Bounds(controls=(-1.0, 1.0)),
        terminal=[x - ca.vertcat(1.0, 0.0)],
    )
    answer = solve(problem, np.zeros(2), search=None, lanes=0, seed=0)
    planner = Planner(problem, search=None, polish=IpoptOptions())
    controller = OpenLoop(loop=RecedingHorizon(planner=planner))
    plan = controller.decide(0.0, np.zeros(2), None, rng=np.random.default_rng(0))
    alone = planner.plan(np.zeros(2), rng=np.random.default_rng(0))
    np.testing.assert_array_equal(plan.plans[0].controls, answer.controls)
    assert answer.cost < alone.cost - 1e-3
