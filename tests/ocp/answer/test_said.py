"""Sentences of an answer that were not so: source, account, afterwards, names."""

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.ocp.answer.plan import Source
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.system.separation import as_path, label

X, U = ca.SX.sym("x"), ca.SX.sym("u")


def scalar(**more: object) -> ss.OptimalControlProblem:
    """x' = u, from anywhere, |u| <= 2."""
    stated: dict[str, object] = {
        "horizon": 1.0, "intervals": 4, "stage_cost": U**2,
        "bounds": ss.Bounds(controls=(-2, 2)),
    }  # fmt: skip
    model = ss.Model(states=X, controls=U, ode=U)
    return ss.OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def test_answer_without_a_guess_is_not_said_to_be_the_guess() -> None:
    """Nothing improves the start, since no polish is near enough to converge."""
    once = ss.IpoptOptions(max_iterations=1)
    problem = scalar(terminal_cost=(X - 1.3) ** 2)
    for guess, source in ((None, Source.COLD), (np.ones((1, 4)), Source.GUESS)):
        found = ss.solve(
            problem, [0.0], search=None, lanes=0, guess=guess, polish=once, seed=0
        )
        if found.plan.source is not Source.POLISH:
            assert found.plan.source is source
        assert ("the guess" in str(found)) <= (guess is not None)


def test_account_of_whole_numbers_tells_of_the_polish_that_ran() -> None:
    problem = scalar(
        terminal_cost=(X - 1.3) ** 2, bounds=ss.Bounds(controls=(-2, 2), integer=[0])
    )
    found = ss.solve(problem, [0.0], search=None, seed=0)
    starts = found.plan.starts
    assert starts is not None
    assert [one.cost for one in starts.tried] == pytest.approx([found.plan.cost])
    assert starts.tried[0].evaluations > 0
    assert "polished    nothing" not in str(found)


def test_cost_that_no_start_gave_is_told_with_what_made_it() -> None:
    """A wall that is cut between the checks, and repaired."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        intervals=5, stage_cost=u**2, terminal=[x[0]], constraints=[x[0] <= 0.5],
        bounds=ss.Bounds(controls=(-9, 9)),
    )  # fmt: skip
    found = ss.solve(problem, [0.0, 1.5], search=None, seed=0)
    assert found.status.is_confirmed and found.repair is not None
    assert f"  afterwards  {found.cost:.7g}, by repair" in str(found)
    plain = ss.solve(problem, [0.0, 1.5], search=None, repair=False, seed=0)
    assert "afterwards" not in str(plain)


def test_long_expression_is_named_by_its_symbols() -> None:
    a, b = ca.SX.sym("height"), ca.SX.sym("speed")
    part = ca.sin(a) * ca.exp(b)
    whole = part + ca.sqrt(part**2 + part)
    constraint = ss.PathConstraint(expression=whole, upper=1)
    assert label(constraint) == "a constraint of height, speed"
    assert label(as_path(whole <= 1)) == "a constraint of height, speed"
    short = ss.PathConstraint(expression=a - b, upper=1)
    assert label(short) == "(height-speed)"


def test_parts_that_casadi_writes_apart_stand_at_their_places() -> None:
    """CasADi writes "@1=(x/2), @2=(@1*sin(@1)), (@2+sq(@2))"."""
    half = ca.SX.sym("x") / 2
    product = half * ca.sin(half)
    assert str(product**2 + product).startswith("@1=")
    assert shortened(product) == "((x/2)*sin((x/2)))"
    assert shortened(ca.vertcat(product, half)) == "[((x/2)*sin((x/2))), (x/2)]"
    assert label(as_path(product <= 0.5)) == "(((x/2)*sin((x/2)))<=0.5)"
    for _ in range(200):
        product = product * product + ca.sin(product)
    assert shortened(product).endswith("...")
