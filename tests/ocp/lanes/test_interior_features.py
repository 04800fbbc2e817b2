"""Interior-point lanes find the optima that IPOPT finds, with every feature.

The problems are those of the feature pairs: small, random, two features each. The lanes
of a problem have initial states, parameters and signals of their own.
"""

from itertools import islice

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Known,
    Model,
    OptimalControlProblem,
    Start,
    TerminalConstraint,
)
from swarmstart.ocp.lanes.interior import Instances, InteriorLanes
from swarmstart.ocp.rollout.fitness import at_nodes, core_known
from swarmstart.tests.ocp.feature_pairs.comparison import Ours, first_point
from swarmstart.tests.ocp.feature_pairs.features import FEATURES, drawn, pairs
from swarmstart.tests.ocp.lanes.interior_problems import posed

pytestmark = pytest.mark.usefixtures("compiler")

LEFT_OUT = {"stiff", "spline surface"}
"""Lanes refuse the first; the second takes a minute to compile."""
DRAWN = list(islice(pairs(np.random.default_rng(1)), 19))
CHOSEN = [pair for pair in DRAWN if not LEFT_OUT & set(pair)]
SAME, FEASIBLE = 1e-6, 1e-7


def column(arrays: list[Array]) -> Array:
    return np.stack(arrays, axis=-1)


@pytest.mark.parametrize(
    "number", range(len(CHOSEN)), ids=lambda k: " + ".join(CHOSEN[k])
)
def test_optima_are_those_of_ipopt(number: int) -> None:
    M, stated = 2, drawn(CHOSEN[number], np.random.default_rng([1, number]))
    ours = Ours(stated)
    planner, point = ours.planner, first_point(stated)
    lanes = InteriorLanes(planner.fitness.shooting)
    starts, controls, parameters, signals = (list[Array]() for _ in range(4))
    costs = list[float]()
    for lane in range(M):
        x0 = point.x0.copy()
        x0[0] += 0.02 * lane
        known = core_known(ours.lowered, stated.known._replace(
            parameters=np.asarray(stated.known.parameters) + 0.1 * lane,
            signals=np.asarray(stated.known.signals) + 0.05 * lane,
        ))  # fmt: skip
        state = ours.start(point._replace(x0=x0))
        plan = planner.plan(
            state, known=known, guess=Start(point.controls, x0=state),
            rng=np.random.default_rng(0),
        )  # fmt: skip
        assert plan.feasible
        costs.append(plan.cost)
        for into, one in zip(
            (starts, controls), ours.lowered.guess(state, point.controls), strict=True
        ):
            into.append(np.asarray(one))
        parameters.append(np.ravel(known.parameters))
        signals.append(np.ravel(known.signals, order="F"))
    instances = Instances(*map(column, (starts, parameters, signals)))
    decided = instances.x0[[one.states[0] for one in lanes.problem.free_starts]]
    answers = lanes(instances, column(controls), decided)
    assert answers.violation.max() <= FEASIBLE
    np.testing.assert_allclose(answers.cost, costs, rtol=SAME, atol=SAME)
    decides = {i for together in stated.start for i in together}
    assert np.ptp(costs) > SAME or 0 in decides


def test_pairs_have_nearly_every_feature() -> None:
    assert {name for pair in DRAWN for name in pair} >= set(FEATURES) - {
        "maximise",
        "euler",
    }


def steered(**more: object) -> OptimalControlProblem:
    """Bring a pendulum into a range, or as said; the costs are those of controls."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    given: dict[str, object] = {
        "horizon": 2.0, "intervals": 8, "stage_cost": u**2 + 0.1 * x[1] ** 2,
        "substeps": 2, "bounds": Bounds(controls=(-2.5, 2.5)),
        "terminal": [TerminalConstraint(expression=x[0], lower=0.6, upper=1.0),
                     TerminalConstraint(expression=x[1] + 0.2 * x[0], upper=0.1)],
    }  # fmt: skip
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 2 * ca.sin(x[0])))
    return OptimalControlProblem(model, **(given | more))  # type: ignore[arg-type]


def gain() -> OptimalControlProblem:
    """The most of a concave gain, by two controls, one of which is fixed."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=u[0] - 0.3 * x + u[1]),
        horizon=2.0, intervals=8, stage_cost=x - 0.5 * x**2 - u[0] ** 2, maximize=True,
        bounds=Bounds(controls=([-1, 0.25], [0.4, 0.25])),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("problem", "x0"),
    [
        (steered(), [[0.0, -0.4, 0.3], [0.0, 0.2, 0.5]]),
        (steered(control_shape="linear"), [[0.0, -0.4, 0.3], [0.0, 0.2, 0.5]]),
        (steered(control_shape="continuous"), [[0.0, -0.4, 0.3], [0.0, 0.2, 0.5]]),
        (gain(), [[0.0, 0.5, -1.0]]),
    ],
    ids=["range and limit at the end", "linear", "continuous", "gain, fixed control"],
)
def test_optima_of_further_shapes_are_those_of_ipopt(
    problem: OptimalControlProblem, x0: list[list[float]]
) -> None:
    case, states = posed(problem), np.array(x0)
    previous = np.zeros(problem.model.nu)
    known = Known(previous=previous) if problem.control_shape == "continuous" else None
    M = states.shape[1]
    instances = case.instances(states, None if known is None else [known] * M)
    answers = case.solved(instances)
    assert answers.violation.max() <= FEASIBLE
    for lane in range(M):
        nodes = at_nodes(case.lanes.problem, instances.signals[:, lane])
        plan = case.planner.plan(
            instances.x0[:, lane], rng=np.random.default_rng(0),
            known=Known(instances.parameters[:, lane], nodes),
        )  # fmt: skip
        assert plan.feasible
        assert answers.cost[lane] == pytest.approx(plan.cost, rel=SAME, abs=SAME)
