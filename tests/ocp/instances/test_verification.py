"""Values and statuses of many answers at once, against those of `verified`."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    SolutionStatus,
)
from swarmstart.ocp.instances.instance_data import posed_instances, read_data
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.instances.polishing import OneByOne
from swarmstart.ocp.instances.verification import FinePaths, fine_paths_of
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.rollout.paths_at_once import Data
from swarmstart.ocp.rollout.scaling import Sizes, Sizing

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
K, S, T = ca.SX.sym("k"), ca.SX.sym("s"), ca.SX.sym("t")
N = 6
SPRING = ca.vertcat(X[1], U - 4 * ca.sin(X[0]))


class Case(NamedTuple):
    """A problem with known data, and a status that must occur among its answers."""

    problem: OptimalControlProblem
    status: SolutionStatus
    known: Known | Mapping[str, Any] | None = None
    amplitude: float = 1.0


def posed(ode: ca.SX = SPRING, model: Any = MappingProxyType({}), **given: Any) -> Any:
    """Return a problem of two states and one control."""
    settings: dict[str, Any] = {
        "horizon": 1.5,
        "intervals": N,
        "substeps": 4,
        "stage_cost": U**2 + ca.sumsqr(X),
        "bounds": Bounds(controls=(-5, 5)),
    }
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=ode, **model), **settings | given
    )


FEASIBLE, BROKEN = SolutionStatus.FEASIBLE, SolutionStatus.BROKEN
CASES = {
    "costs": Case(
        posed(
            terminal_cost=5 * X[0] ** 2, initial_cost=X[1], step_cost=ca.sumsqr(X) * U
        ),
        FEASIBLE,
    ),
    "moving origin": Case(
        posed(stage_cost=X[0] + U**2, terminal_cost=3 * X[1]), FEASIBLE
    ),
    "maximised": Case(posed(maximize=True, terminal_cost=X[0]), FEASIBLE),
    "bounds": Case(
        posed(bounds=Bounds(controls=(-5, 5), states=([-9, -1.2], [9, 1.2])), checks=2),
        SolutionStatus.INFEASIBLE,
    ),
    "between checks": Case(
        posed(  # A period, 0.75 s, from check to check.
            ode=ca.vertcat(X[1], U - 70.2 * X[0]),
            intervals=2,
            substeps=20,
            constraints=[
                PathConstraint(expression=X[0] + 0.01 * U, lower=-0.2, upper=9.0)
            ],
        ),
        BROKEN,
        amplitude=0.3,
    ),
    "at the start of an interval": Case(  # Where the state has not decayed yet.
        posed(
            ode=ca.vertcat(-9 * X[0], U),
            constraints=[PathConstraint(expression=X[0] + 0.2 * U, upper=0.1)],
        ),
        SolutionStatus.INFEASIBLE,
    ),
    "coarse steps": Case(
        posed(ode=ca.vertcat(X[1], U - 200 * ca.sin(X[0])), substeps=1),
        SolutionStatus.MISMATCH,
    ),
    "Euler": Case(
        posed(ode=ca.vertcat(X[1] / 9, U / 9), integrator="euler", substeps=40),
        FEASIBLE,
    ),
    "explosion": Case(
        posed(ode=ca.vertcat(X[1], U + 40 * X[1] ** 2), horizon=3.0),
        SolutionStatus.NOT_FINITE,
        amplitude=3.0,
    ),
    "root of a negative number": Case(
        posed(constraints=[PathConstraint(expression=ca.sqrt(X[0] + 1.5), upper=9.0)]),
        SolutionStatus.NOT_FINITE,
        amplitude=5.0,
    ),
    "terminal rows": Case(
        posed(terminal=[X[0] - K >= -0.2], model={"parameters": K}),
        SolutionStatus.INFEASIBLE,
        {"k": np.linspace(-1, 1, 24)},
    ),
    "signals": Case(
        posed(
            ode=ca.vertcat(X[1], U - X[0] + S),
            model={"signals": S},
            stage_cost=(X[0] - S) ** 2 + U**2,
            checks=3,
        ),
        FEASIBLE,
        {"s": np.random.default_rng(5).normal(size=(3 * N + 1, 24))},
    ),
    "time": Case(
        posed(ode=ca.vertcat(X[1], U + ca.cos(3 * T)), model={"time": T}),
        FEASIBLE,
        Known(time=2.0),
    ),
    "free end time": Case(posed(horizon=Free(1, 2, guess=1.5)), FEASIBLE),
    "free start": Case(posed(start={"x_0": Free(-1, 1)}), FEASIBLE),
}


class Drawn(NamedTuple):
    """Random controls of a case, with what they are judged by."""

    planner: Planner
    paths: FinePaths
    instances: Instances
    controls: Array


def drawn(case: Case) -> Drawn:
    """Return random controls of 24 instances."""
    planner = Planner(case.problem, search=None, polish=IpoptOptions())
    rng = np.random.default_rng(3)
    data = read_data(case.problem, rng.normal(size=(2, 24)) / 3, case.known, None)
    instances = posed_instances(planner, data).core
    core = planner.problem
    lower, upper = (limit[:, None, None] for limit in core.control_limits)
    shape = core.model.nu, core.intervals, instances.x0.shape[1]
    controls = np.clip(case.amplitude * rng.normal(size=shape), lower, upper)
    paths = fine_paths_of(planner, threads=1)
    assert paths is not None
    return Drawn(planner, paths, instances, controls)


@pytest.mark.parametrize("name", CASES)
def test_answers_at_once_are_those_one_by_one(name: str) -> None:
    case = CASES[name]
    planner, paths, instances, controls = drawn(case)
    at_once = paths(instances, controls)
    each = OneByOne(planner, seed=(0,), repair=True, threads=1)
    groups = [group.answers for group in each.verified(instances, controls)]
    joined = [np.concatenate(values, axis=-1) for values in zip(*groups, strict=True)]
    one_by_one = Answers(*joined)
    assert at_once.status.tolist() == one_by_one.status.tolist()
    assert case.status in at_once.status.tolist()
    # Explosions amplify rounding; what they lead to is judged by the status.
    tame = np.abs(one_by_one.verified_cost) < 1e3
    assert tame.any() == (name != "explosion")
    for field in ("cost", "violation", "verified_cost", "excess", "end_difference"):
        found, expected = (getattr(a, field)[tame] for a in (at_once, one_by_one))
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9, err_msg=field)
    np.testing.assert_allclose(
        at_once.states[..., tame], one_by_one.states[..., tame], rtol=1e-8, atol=1e-9
    )


def test_sizes_are_not_asked_for_where_nothing_is_broken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They take longer than all the rest."""
    asked: list[int] = []
    _, paths, instances, controls = drawn(CASES["bounds"])
    sizing = Sizing.of_all

    def counted(self: Sizing, x0: Array, *given: Any) -> list[Sizes]:
        asked.append(x0.shape[1])
        return sizing(self, x0, *given)

    monkeypatch.setattr(Sizing, "of_all", counted)
    found = paths(instances, controls)
    kept = (found.violation == 0) & (found.excess == 0)
    assert 0 < kept.sum() < kept.size == 24
    assert sum(asked) == 24 - kept.sum()


@pytest.mark.parametrize("name", ["costs", "moving origin", "signals", "free end time"])
def test_sizes_of_paths_at_once_are_those_of_the_tracer(name: str) -> None:
    """The tolerances of the comparison are relative to them."""
    planner, paths, instances, controls = drawn(CASES[name])
    tracer, core = planner.tracer, planner.problem
    known = [instances.known(core, k) for k in range(3)]
    signals = [np.asarray(one.signals) for one in known]
    sizes = [
        tracer.shooting.sizing(
            instances.x0[:, k], instances.parameters[:, k], signals[k], controls[..., k]
        )
        for k in range(3)
    ]
    first = instances.at(np.arange(3))
    stacked = np.stack(signals, axis=-1)
    data = Data(controls[..., :3], first.x0, first.parameters, stacked, sizes)
    found = paths.paths.along(data)
    for k in range(3):
        path = tracer(
            controls[..., k],
            first.x0[:, k],
            first.parameters[:, k],
            signals[k],
            sizes[k],
        )
        assert found.magnitude[k] == pytest.approx(path.magnitude, rel=1e-9)
        assert found.cost[k] == pytest.approx(path.cost, rel=1e-9)
        np.testing.assert_allclose(found.reach[:, k], path.reach, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "given",
    [
        {"control_shape": "linear"},  # A state jumps from knot to knot.
        {"stage_cost": U**2 + ca.fabs(X[0])},
        {"quadrature": "left"},
        {"bounds": Bounds(controls=(-5, 5), integer=[0])},
        {"constraints": [PathConstraint(expression=X[0], upper=1, weight=1.0)]},
        {"integrator": "stiff"},
    ],
    ids=["jumps", "kinks", "sums", "whole numbers", "soft", "step size control"],
)
def test_what_has_no_scan_is_left_to_one_by_one(given: dict[str, Any]) -> None:
    planner = Planner(posed(**given), search=None, polish=IpoptOptions())
    assert fine_paths_of(planner, threads=1) is None
