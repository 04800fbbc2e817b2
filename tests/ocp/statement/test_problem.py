"""Statement of a problem: grid, conversion of its arguments, and errors."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    TerminalConstraint,
    disc,
)
from swarmstart.ocp.integration.integrators import INTEGRATORS

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
MODEL = Model(states=X, controls=U, ode=ca.vertcat(X[1], U))


def pose(**arguments: object) -> OptimalControlProblem:
    given: dict[str, object] = {"horizon": 3.0, "intervals": 6, **arguments}
    return OptimalControlProblem(MODEL, **given)  # type: ignore[arg-type]


def test_nodes_are_the_ends_of_all_checks() -> None:
    problem = pose(checks=2)
    assert problem.nodes == 13
    assert problem.dt == 0.5
    np.testing.assert_allclose(problem.times, 0.25 * np.arange(13))


def test_bounds_become_arrays_and_none_means_free() -> None:
    problem = pose(bounds=Bounds(controls=(-8, 8)))
    assert [limit.tolist() for limit in problem.control_limits] == [[-8.0], [8.0]]
    assert [v.tolist() for v in problem.state_limits] == [[-np.inf] * 2, [np.inf] * 2]
    pair = np.array([[-1.0], [1.0]])
    problem = pose(bounds=Bounds(controls=pair))  # type: ignore[arg-type]
    assert problem.control_limits[1].tolist() == [1.0]


def test_state_bounds_are_the_last_path_constraint() -> None:
    obstacle = disc(X, centre=[0, 0], radius=1)
    assert pose(constraints=[obstacle]).path_constraints == (obstacle,)
    states = ([-np.inf, -1], np.inf)
    bounded = pose(constraints=[obstacle], bounds=Bounds(states=states))
    first, last = bounded.path_constraints
    assert first is obstacle
    assert isinstance(last, PathConstraint)
    # The free state has no row.
    assert np.asarray(last.lower).tolist() == [-1]


def test_bare_terminal_expression_means_equality() -> None:
    kept = TerminalConstraint(expression=X[1], lower=-1, upper=1)
    first, second = pose(terminal=[X - 1, kept]).terminal_constraints
    assert np.asarray(first.lower).tolist() == [0, 0]
    assert np.asarray(first.upper).tolist() == [0, 0]
    assert second is kept


def test_relations_say_what_they_say() -> None:
    problem = pose(
        constraints=[X <= 1, X[0] >= -2, U == X[1], X[0] <= U, ca.vertcat(X[0] - 3)],
        terminal=[X[0] >= 4, (X[1], 5.0)],
    )
    limits = [
        (np.asarray(c.lower).tolist(), np.asarray(c.upper).tolist())  # type: ignore[attr-defined]
        for c in (*problem.stated, *problem.terminal_constraints)
    ]
    inf = np.inf
    assert limits == [
        ([-inf, -inf], [1, 1]),
        ([-2], [inf]),
        ([0], [0]),
        ([-inf], [0]),
        ([0], [0]),
        ([4], [inf]),
        ([5], [5]),
    ]
    values = ca.Function(
        "values",
        [X, U],
        [c.expression for c in (*problem.stated, *problem.terminal_constraints)],
    )
    rows = [np.array(v).ravel().tolist() for v in values([7.0, 9.0], 2.0)]
    assert rows == [[7, 9], [7], [-7], [5], [4], [7], [9]]


def test_model_of_another_kind_is_refused() -> None:
    with pytest.raises(InvalidProblemError, match=r"model must be .* got m \(str\)"):
        OptimalControlProblem("m", horizon=1.0, intervals=2)  # type: ignore[arg-type]


def test_summary_names_states_controls_and_constraints() -> None:
    problem = pose(bounds=Bounds(controls=(-8, 8)), constraints=[X[0] <= 1])
    text = repr(problem)
    assert "x_0, x_1" in text
    assert "u in [-8, 8]" in text
    assert "x_0<=1" in text
    assert text.count("\n") <= 9


def test_lists_of_the_caller_are_not_kept() -> None:
    constraints = [disc(X, centre=[0, 0], radius=1)]
    problem = pose(constraints=constraints)
    constraints.clear()
    assert len(problem.constraints) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"horizon": 0.0}, "horizon must be positive, got 0.0"),
        ({"horizon": np.inf}, "horizon must be positive, got inf"),
        ({"intervals": 0}, "intervals must be an integer of at least 1, got 0"),
        ({"intervals": 2.5}, "intervals must be an integer of at least 1, got 2.5"),
        ({"checks": 0}, "checks must be an integer of at least 1, got 0"),
        ({"substeps": 0}, "substeps must be an integer of at least 1, got 0"),
        ({"quadrature": "simpson"}, "quadrature must be integral or left or right"),
        ({"horizon": "3"}, r"horizon must be a number, got '3' \(str\)"),
        ({"horizon": None}, "horizon must be a number, got None"),
        ({"horizon": X}, "horizon must be a number, got"),
        ({"tolerance": "a"}, "tolerance must be a number, got 'a'"),
        ({"path_tolerance": -1.0}, "path_tolerance must be at least 0, got -1.0"),
        ({"constraints": ["x<3"]}, "constraints must hold .* got x<3"),
        ({"constraints": "x<3"}, "constraints must be a list, got x<3"),
        ({"terminal": ["x"]}, "terminal must hold .* got x"),
        ({"terminal": [disc(X, centre=0, radius=1)]}, "use TerminalConstraint"),
        ({"constraints": [TerminalConstraint(expression=X)]}, "the list `terminal`"),
        ({"bounds": (-8, 8)}, "bounds must be swarmstart.Bounds, such as"),
        (
            {"integrator": "cvodes"},
            f"integrator must be one of {', '.join(INTEGRATORS)}",
        ),
        ({"tolerance": -1.0}, "tolerance must be at least 0, got -1.0"),
        ({"stage_cost": X}, "stage_cost must be a scalar"),
        ({"stage_cost": ca.SX.sym("z")}, "stage_cost may depend on .* found z"),
        ({"terminal_cost": U}, "terminal_cost may depend on .* found u"),
        ({"terminal": [U]}, "a terminal constraint may depend on .* found u"),
        ({"constraints": disc(X, centre=0, radius=1)}, "constraints must be a list"),
        (
            {"constraints": [PathConstraint(expression=ca.SX.sym("z"))]},
            "a path constraint may depend on .* found z",
        ),
        ({"signals": 2 * X}, "signals must be CasADi SX symbols"),
        ({"signals": X}, "must be different symbols, found one twice"),
        ({"bounds": Bounds(controls=(1, -1))}, "limits of the controls must have"),
        ({"bounds": Bounds(states=([0, 0, 0], 1))}, "limits of the states must be"),
    ],
)
def test_refuses_what_cannot_be_posed(
    arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        pose(**arguments)
