"""The named problems of the lower bounds, and the tables made of them."""

from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.benchmarks.lower_bounds import (
    adversary_share,
    best_known,
    crossings,
    measure,
)
from swarmstart.benchmarks.lower_bounds.problems import DISC, NAMED, Named
from swarmstart.ocp import Solution
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.tests.adversary.problems import free_end_time


def flown_cost(named: Named, answer: Solution) -> float:
    """Return what linear controls cost by DOP853, knot by knot."""
    model = named.problem.model
    x, u = model.states, model.controls
    rates = ca.vertcat(model.ode, named.problem.stage_cost)
    f = ca.Function("f", [x, u], [rates])
    end = ca.Function("end", [x], [named.problem.terminal_cost])
    duration = answer.decided.get("end time", float(answer.times[-1]))
    knots = np.linspace(0, duration, answer.controls.shape[1])
    y = np.append(named.x0, 0.0)
    for k in range(len(knots) - 1):

        def rate(t: float, y: Array, k: int = k) -> Array:
            part = (t - knots[k]) / (knots[k + 1] - knots[k])
            own = (1 - part) * answer.controls[:, k] + part * answer.controls[:, k + 1]
            return np.asarray(f(y[:-1], own), dtype=np.float64).ravel()

        span = (knots[k], knots[k + 1])
        y = solve_ivp(rate, span, y, method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    return float(y[-1] + float(end(y[:-1])))


@pytest.mark.parametrize("name", NAMED)
def test_best_costs_are_those_of_controls_that_another_integrator_flies(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = NAMED[name]()
    monkeypatch.setattr(best_known, "STEPS", 400)
    answer = best_known.refined(named, "linear", lanes=8, grids=(50,))[-1]
    cost = flown_cost(named, answer)
    assert cost == pytest.approx(answer.cost, rel=1e-6)
    # Coarse knots cost more; a path that is judged between checks may gain 1e-4.
    assert named.best * (1 - 1e-4) <= cost <= named.best * (1 + 1e-3)


def test_best_costs_are_no_more_than_those_of_held_controls_and_goals_no_more() -> None:
    for make in NAMED.values():
        named = make()
        assert not named.held < named.best
        assert all(bound < named.best for _, bound in named.goals)


def test_a_bound_that_does_not_see_the_disc_does_not_reach_its_goal() -> None:
    free, round_it = NAMED["unicycle"](), NAMED["unicycle_and_disc"]()
    assert round_it.goals[0][1] > free.best
    centre, radius = np.array(DISC[0]), DISC[1]
    assert np.linalg.norm(round_it.x0[:2] - centre) > radius


def told(value: float, kind: BoundKind = BoundKind.PROVEN) -> LowerBound:
    """Return a bound as if it had been proven."""
    return LowerBound(
        kind=kind, value=value, reason="told", degree=5, boxes=1234, set_name="a tube"
    )


def give(
    monkeypatch: pytest.MonkeyPatch, module: object, value: float, kind: str = "proven"
) -> None:
    """Let a script find this bound of everything."""
    bound = told(value, BoundKind(kind))
    monkeypatch.setattr(module, "lower_bound", lambda *_, **__: bound)


def test_table_says_gap_and_whether_a_goal_is_reached(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"above\n{measure.BEGIN}\nold\n{measure.END}\nbelow\n")
    give(monkeypatch, measure, 4.85)
    asked = ["linear_quadratic", "--answer", "best", "--into", str(page)]
    assert measure.main(asked) == 0
    said = capsys.readouterr().out.splitlines()[2:]
    assert ">= 4.848 in 30 s: reached" in said[0]
    assert ">= 4.8525 in 60 s: **missed**" in said[1]
    assert all("0.0606 %" in line and "1,234" in line for line in said[:2])
    text = page.read_text()
    assert text.startswith("above\n") and text.endswith("below\n")
    assert "old" not in text and said[0] in text


def test_a_bound_above_the_best_cost_is_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    give(monkeypatch, measure, 4.853)
    assert measure.main(["linear_quadratic", "--answer", "none"]) == 3
    assert "above the best known" in capsys.readouterr().out


def test_no_bound_reaches_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    give(monkeypatch, measure, np.nan, "none")
    asked = ["linear_quadratic", "--answer", "best", "--seconds", "45"]
    assert measure.main(asked) == 0
    said = capsys.readouterr().out.splitlines()[2]
    assert ">= 4.8525 in 60 s: **missed**" in said and "| none | - |" in said


def test_a_page_without_marks_is_refused() -> None:
    with pytest.raises(ValueError, match="once each"):
        measure.with_table("nothing", [])
    with pytest.raises(ValueError, match="before"):
        measure.with_table(measure.END + measure.BEGIN, [])


def test_an_unknown_name_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        measure.main(["pendulums"])
    assert "expected names of" in capsys.readouterr().err


def test_adversary_share_counts_proven_bounds_alone(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    case = free_end_time.cases()[0]
    monkeypatch.setattr(adversary_share, "candidates", lambda: [case])
    answer = SimpleNamespace(cost=case.truth.highest)
    monkeypatch.setattr(adversary_share, "solve", lambda *_, **__: answer)
    record = tmp_path / "share.json"
    asked = ["--count", "1", "--json", str(record)]
    give(monkeypatch, adversary_share, 0.91 * answer.cost)
    assert adversary_share.main(asked) == 0
    assert "1 of 1 have" in capsys.readouterr().out
    assert '"within": 1' in record.read_text()
    give(monkeypatch, adversary_share, 0.91 * answer.cost, "trivial")
    assert adversary_share.main(asked) == 0
    assert "0 of 1 have" in capsys.readouterr().out
    give(monkeypatch, adversary_share, 1.01 * answer.cost)
    assert adversary_share.main(asked) == 3
    assert "above a right answer" in capsys.readouterr().out


def test_adversary_cases_that_may_be_chosen_are_the_smooth_small_ones() -> None:
    cases = adversary_share.candidates()
    assert len(cases) > 200
    assert max(case.truth.x0.size for case in cases) == 3
    assert not {"nonsmooth", "no_solution"} & {case.kind for case in cases}
    assert all(case.is_counted and case.truth.is_solvable for case in cases)


def test_crossings_are_counted_in_both_senses(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    give(monkeypatch, crossings, 1.0)
    assert crossings.main(["catch", "to zero and stay"]) == 3
    said = capsys.readouterr().out
    # 1 is above 1/3, below the worth 1.31, above the cost -1.31.
    assert "3 crossings; 3 proven" in said
    give(monkeypatch, crossings, np.nan)
    assert crossings.main(["to zero and stay"]) == 3
