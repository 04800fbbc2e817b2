"""Ensembles whose members later have controls of their own, against Opti."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Fitness,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    SolutionStatus,
    ensemble,
    simulate,
    solve,
)
from swarmstart.ocp.nlp.optimality import Curvature, curvature
from swarmstart.ocp.statement.risk import Measure

GAINS, WEIGHTS, LEVEL = [0.5, 1.0, 2.0], [1.0, 2.0, 1.0], 0.6
N, STEPS, MOST = 5, 4, 0.9
BEFORE = 0.3


def one(**more: object) -> OptimalControlProblem:
    """A lag of unknown gain k, driven to 1 with small moves, x at most 0.9."""
    x, u, k, before = (ca.SX.sym(n) for n in ("x", "u", "k", "before"))
    stated: dict[str, object] = {
        "horizon": 2.0,
        "intervals": N,
        "stage_cost": (x - 1) ** 2,
        "step_cost": 0.05 * (u - before) ** 2,
        "previous": before,
        "bounds": Bounds(controls=(-3, 3), states=(-5, MOST)),
    }
    model = Model(states=x, controls=u, ode=-x + k * u, parameters=k)
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def tree_of_opti(r: int, risk: str, gains: list[float], weights: list[float]) -> float:
    """Return the cost of the same tree by copies of the lag in CasADi's Opti."""
    opti, h, M = ca.Opti(), 2.0 / N / STEPS, len(gains)
    u, costs = opti.variable(M, N), []
    opti.subject_to(opti.bounded(-3, ca.vec(u), 3))
    for m, k in enumerate(gains):

        def rate(y: Any, v: Any, k: float = k) -> Any:
            return ca.vertcat(-y[0] + k * v, (y[0] - 1) ** 2)

        y, moves, before = ca.MX(2, 1), ca.MX(0), ca.MX(BEFORE)
        for i in range(N):
            if i < r and m:
                opti.subject_to(u[m, i] == u[0, i])
            moves, before = moves + 0.05 * (u[m, i] - before) ** 2, u[m, i]
            for _ in range(STEPS):
                k1 = rate(y, u[m, i])
                k2 = rate(y + h / 2 * k1, u[m, i])
                k3 = rate(y + h / 2 * k2, u[m, i])
                k4 = rate(y + h * k3, u[m, i])
                y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            opti.subject_to(y[0] <= MOST)
        costs.append(y[1] + moves)
    t, e = opti.variable(), opti.variable(M)
    J, w = ca.vertcat(*costs), ca.DM(weights) / sum(weights)
    told = {
        "mean": (ca.dot(w, J), [t == 0, e == 0]),
        "worst": (t, [t >= J, e == 0]),
        "cvar": (t + ca.dot(w, e) / (1 - LEVEL), [e >= 0, e >= J - t]),
    }
    cost, rows = told[risk]
    opti.minimize(cost)
    opti.subject_to(rows)
    quiet: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0}
    opti.solver("ipopt", {**quiet, "ipopt.sb": "yes", "ipopt.tol": 1e-10})
    return float(opti.solve().value(cost))


def tree(r: int | None, risk: Measure = "mean", **more: object) -> Any:
    return ensemble(
        one(**more), {"k": GAINS}, weights=WEIGHTS, risk=risk, level=LEVEL,
        robust_horizon=r,
    )  # fmt: skip


KNOWN = Known(previous=[BEFORE])


@pytest.mark.parametrize(
    ("r", "risk"),
    [(0, "mean"), (1, "mean"), (2, "mean"), (N, "mean"), (1, "worst"), (2, "cvar")],
)
def test_cost_is_that_of_the_same_tree_in_opti(r: int, risk: Measure) -> None:
    answer = solve(tree(r, risk), [0.0], known=KNOWN, search=None, seed=0)
    expected = tree_of_opti(r, risk, GAINS, WEIGHTS)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(expected, rel=1e-6)
    assert answer.control_names == ("u_0", "u_1", "u_2")
    same = (answer.controls == answer.controls[0]).all(axis=0)
    np.testing.assert_array_equal(same, np.arange(N) < r)


def test_tree_is_between_members_that_know_all_and_one_sequence() -> None:
    costs = {r: solve(tree(r), [0.0], known=KNOWN, search=None, seed=0).cost
             for r in (None, 0, 2, N)}  # fmt: skip
    each = [
        solve(ensemble(one(), {"k": [k]}), [0.0], known=KNOWN, search=None, seed=0).cost
        for k in GAINS
    ]
    assert costs[0] == pytest.approx(np.average(each, weights=WEIGHTS), rel=1e-7)
    assert costs[N] == pytest.approx(costs[None], rel=1e-7)
    assert costs[0] < costs[2] < costs[N]


def test_search_decides_what_is_shared_once() -> None:
    problem = tree(2, bounds=Bounds(controls=(-3, 3)))
    planner = Planner(problem, search="lshade")
    assert planner._space is not None
    assert planner._space.box.dim == 2 + 3 * 3
    searched = solve(
        problem, [0.0], known=KNOWN, budget=6000, polish=None, seed=0, backend="llvm"
    )
    best = solve(problem, [0.0], known=KNOWN, search=None, seed=0)
    assert searched.cost == pytest.approx(best.cost, rel=1e-2)
    np.testing.assert_array_equal(searched.controls[1:, :2], searched.controls[:2, :2])


def test_machine_code_gives_what_casadi_gives() -> None:
    problem = tree(2)
    start, known, _ = Planner(problem, search=None).posed([0.0], KNOWN)
    controls = np.random.default_rng(0).uniform(-1, 1, (3, N))
    values = [
        Fitness(problem, backend=backend).value(controls, start, known)
        for backend in ("llvm", "casadi")
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-11)


def test_block_that_begins_in_the_robust_horizon_is_shared_to_its_end() -> None:
    problem = tree(2, blocks=[1, 3, 1])
    answer = solve(problem, [0.0], known=KNOWN, search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    np.testing.assert_array_equal(answer.controls[1:, :4], answer.controls[:2, :4])
    np.testing.assert_array_equal(answer.controls[:, 1], answer.controls[:, 3])
    assert np.ptp(answer.controls[:, 4]) > 0.1


def test_what_members_share_is_one_direction_of_the_second_derivatives() -> None:
    """Costs 2 x^2 and -x^2: a minimum for one control, a saddle for two.

    Costs x^2 and -2 x^2 are a saddle for one.
    """
    x, u, k = (ca.SX.sym(n) for n in "xuk")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - x, parameters=k),
        horizon=1.0, intervals=3, terminal_cost=k * x**2, bounds=Bounds(
            controls=(-1, 1)), stage_cost=0.1 * k * u**2,
    )  # fmt: skip
    found = []
    for r, gains in ((3, [2.0, -1.0]), (0, [2.0, -1.0]), (3, [1.0, -2.0])):
        planner = Planner(
            ensemble(problem, {"k": gains}, robust_horizon=r),
            search=None,
            polish=IpoptOptions(),
        )
        assert planner.polisher is not None
        start, known, _ = planner.posed([0.0])
        polished = planner.polisher(np.zeros((2, 3)), start, known)
        assert polished.point is not None
        found.append(curvature(polished.point))
    assert found == [Curvature.POSITIVE, Curvature.NEGATIVE, Curvature.NEGATIVE]


def test_closed_loop_flies_what_all_members_share() -> None:
    planner = Planner(tree(1), search=None, polish=IpoptOptions())
    loop = RecedingHorizon(planner=planner, append="last", previous=np.array([BEFORE]))
    plant = Plant(
        one().model, dt=2.0 / N, substeps=4,
        parameters=lambda times: np.full((1, times.size), 2.0),
    )  # fmt: skip
    flight = simulate(plant, loop, [0.0], steps=4, seed=0)
    assert flight.controls.shape == (1, 4)
    assert flight.states.max() < MOST + 1e-6
    for decision in flight.decisions:
        shared = decision.plans[0].controls[:, 0]
        np.testing.assert_array_equal(shared, decision.control[0])
        assert decision.plans[0].feasible
    # The first plan's move is measured from the control before the run.
    first = solve(tree(1), [0.0], known=KNOWN, search=None, seed=0)
    assert flight.controls[0, 0] == pytest.approx(first.controls[0, 0], abs=1e-6)


@pytest.mark.parametrize("r", [-1, N + 1, 1.5, True, "1"])
def test_robust_horizon_is_a_number_of_intervals(r: Any) -> None:
    with pytest.raises(InvalidProblemError, match="robust_horizon must be "):
        tree(r)


def test_what_one_plant_cannot_fly_is_refused() -> None:
    planner = Planner(tree(0), search=None)
    with pytest.raises(InvalidProblemError, match="share no control cannot be run"):
        RecedingHorizon(planner=planner)
    loop = RecedingHorizon(planner=Planner(tree(2), search=None))
    with pytest.raises(InvalidProblemError, match="members have their own after 2 of"):
        OpenLoop(loop=loop)
    with pytest.raises(InvalidProblemError, match="need not be whole numbers, got u"):
        tree(1, bounds=Bounds(controls=(0, 1), integer=["u"]))
    with pytest.raises(InvalidProblemError, match=r"numbers of shape \(1,\), one"):
        solve(tree(1), [0.0], known=Known(previous=[0, 1]), search=None, seed=0)


def test_lanes_say_that_members_share_controls() -> None:
    account = solve(
        tree(2), [0.0], known=KNOWN, search=None, lanes=8, seed=0
    ).plan.starts  # fmt: skip
    assert account is not None
    assert account.without_lanes == "its members share controls for a while"
