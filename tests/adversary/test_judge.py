import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmstart.tests.adversary import judge as judge_module
from swarmstart.tests.adversary.judge import (
    Claim,
    Rows,
    Truth,
    Verdict,
    excess,
    judge,
    replay,
    scales,
)

JUDGE = Path(str(judge_module.__file__))
N = 4


@pytest.fixture
def truth() -> Truth:
    """x' = u from 0 to 1 in 1 s, least integral of u^2: u = 1, cost 1, x <= 1."""
    return Truth(
        dynamics=lambda x, u: u,
        stage_cost=lambda x, u: float(u[0] * u[0]),
        path=Rows(value=lambda x, u: x, lower=np.full(1, -np.inf), upper=np.ones(1)),
        terminal=Rows(value=lambda x, u: x, lower=np.ones(1), upper=np.ones(1)),
        controls=(np.full(1, -3.0), np.full(1, 3.0)),
        x0=np.zeros(1),
        horizon=1.0,
        intervals=N,
        sizes=np.ones(1),
        lowest=0.99,
        highest=1.001,
    )


def said(truth: Truth, controls: object, cost: float) -> Verdict:
    """Return what the judge says of a confirmed answer."""
    u = np.broadcast_to(np.asarray(controls, dtype=float), (1, N))
    return judge(truth, Claim(controls=u, cost=cost, is_confirmed=True))


def test_judge_imports_numpy_scipy_and_standard_library_only() -> None:
    """Code shared with the package could be wrong in both."""
    names = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(JUDGE.read_text("utf-8")))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [str(node.module)]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert names == {"numpy", "scipy", "collections", "dataclasses"}


def test_judge_runs_without_the_package() -> None:
    program = (
        "import importlib.util, sys;"
        f"spec = importlib.util.spec_from_file_location('judge', {str(JUDGE)!r});"
        "module = importlib.util.module_from_spec(spec);"
        "sys.modules['judge'] = module;"
        "spec.loader.exec_module(module);"
        "assert not {'swarmstart', 'casadi'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_closed_form_is_right(truth: Truth) -> None:
    assert said(truth, 1.0, 1.0) == Verdict(is_right=True)


def test_wrong_cost_is_false(truth: Truth) -> None:
    assert "cost" in said(truth, 1.0, 1.003).faults[0]
    assert said(truth, 1.0, 1.001).is_right


def test_nan_cost_is_false(truth: Truth) -> None:
    assert said(truth, 1.0, np.nan).faults


def test_missed_target_is_false(truth: Truth) -> None:
    assert "terminal" in said(truth, 0.999, 0.998).faults[0]


def test_constraint_cut_between_the_ends_is_false(truth: Truth) -> None:
    """x' = v, v' = u, thrown up and caught: within bounds at both ends of a second."""
    thrown = replace(
        truth,
        dynamics=lambda x, u: np.array([x[1], u[0]]),
        path=Rows(
            value=lambda x, u: x[:1], lower=np.full(1, -np.inf), upper=np.array([0.1])
        ),
        terminal=Rows(value=lambda x, u: x[:1], lower=np.zeros(1), upper=np.zeros(1)),
        x0=np.array([0.0, 1.0]),
        sizes=np.ones(2),
        intervals=1,
    )
    claim = Claim(controls=np.full((1, 1), -2.0), cost=4.0, is_confirmed=True)
    assert judge(thrown, claim).faults == (
        "path constraint broken by 1.5 of its scale",
    )


def test_mixed_constraint_is_looked_at_at_the_beginning_of_intervals(
    truth: Truth,
) -> None:
    """-u v <= 1.2 is broken at the start of a stop from 2, and nowhere else."""
    stop = replace(
        truth,
        path=Rows(
            value=lambda v, u: -u * v, lower=np.full(1, -np.inf), upper=np.array([1.2])
        ),
        terminal=Rows(value=lambda v, u: v, lower=np.zeros(1), upper=np.zeros(1)),
        x0=np.full(1, 2.0),
        horizon=2.0,
    )
    assert "broken by 0.667" in said(stop, -1.0, 2.0).faults[0]


def test_control_out_of_its_bounds_is_false(truth: Truth) -> None:
    free = replace(truth, terminal=judge_module.NO_ROWS, path=judge_module.NO_ROWS)
    assert said(free, 3.001, 3.001**2).faults == ("a control is out of its bounds",)


def test_controls_that_are_no_numbers_are_false(truth: Truth) -> None:
    assert said(truth, [1.0, np.nan, 1.0, 1.0], 1.0).faults


@pytest.mark.parametrize("power", [2, 3])
def test_escape_in_finite_time_is_false(truth: Truth, power: int) -> None:
    escaping = replace(truth, dynamics=lambda x, u: x**power, x0=np.full(1, 2.0))
    assert "does not exist" in said(escaping, 1.0, 1.0).faults[0]


def test_jump_across_a_pole_is_false(truth: Truth) -> None:
    """x' = -1 / x ends at zero, where a coarse step passes."""
    ending = replace(truth, dynamics=lambda x, u: -1 / x, x0=np.full(1, 0.9))
    assert "does not exist" in said(ending, 1.0, 1.0).faults[0]


def test_confirmation_of_what_has_no_solution_is_false(truth: Truth) -> None:
    impossible = replace(truth, is_solvable=False)
    assert "no solution" in said(impossible, 1.0, 1.0).faults[0]


def test_refusal_is_right_only_without_a_solution(truth: Truth) -> None:
    refused = Claim(controls=None)
    assert judge(replace(truth, is_solvable=False), refused).is_right
    assert judge(truth, refused) == Verdict(note="not confirmed")


def test_honest_answer_that_costs_more_is_not_right(truth: Truth) -> None:
    verdict = said(truth, [1.1, 0.9, 1.1, 0.9], 1.01)
    assert not verdict.faults and not verdict.is_right


def test_local_optimum_on_a_kink_is_false(truth: Truth) -> None:
    kinked = replace(truth, kinks=lambda x, u: x - 0.6)
    claim = Claim(
        controls=np.ones((1, N)), cost=1.0, is_confirmed=True, is_local_optimum=True
    )
    assert judge(kinked, claim).faults == ("a local optimum claimed on a kink",)
    assert judge(kinked, replace(claim, is_local_optimum=False)).is_right
    past = replace(truth, kinks=lambda x, u: x + 0.6)
    assert judge(past, claim).is_right


def test_jump_of_the_control_across_a_kink_is_none_within_an_interval(
    truth: Truth,
) -> None:
    bang = replace(truth, kinks=lambda x, u: u, terminal=judge_module.NO_ROWS)
    flown = replay(bang, np.array([[1.0, 1.0, -1.0, -1.0]]))
    assert flown is not None
    assert not judge_module.meets_kink(bang, flown)


def test_scale_is_width_then_limit_then_size() -> None:
    inf = np.inf
    rows = Rows(
        value=lambda x, u: x,
        lower=np.array([-1.0, -inf, 2.0, 0.0, -3.0]),
        upper=np.array([4.0, 7.0, 2.0, 0.0, inf]),
    )
    assert scales(rows, np.full(5, 9.0)).tolist() == [5.0, 7.0, 2.0, 9.0, 3.0]


def test_value_that_is_no_number_breaks_a_constraint(truth: Truth) -> None:
    flown = replay(truth, np.ones((1, N)))
    assert flown is not None
    rows = replace(truth.path, value=lambda x, u: np.log(x - 0.5))
    assert excess(rows, flown, at_end=False) == np.inf


def test_replay_is_right_to_ten_digits(truth: Truth) -> None:
    """x' = x u, held, is an exponential."""
    growing = replace(truth, dynamics=lambda x, u: x * u, x0=np.ones(1))
    flown = replay(growing, np.array([[1.0, -2.0, 3.0, 0.5]]))
    assert flown is not None
    assert flown.states[-1, 0, -1] == pytest.approx(np.exp(2.5 / 4), rel=1e-9)
    assert flown.cost == pytest.approx(14.25 / 4, rel=1e-9)
