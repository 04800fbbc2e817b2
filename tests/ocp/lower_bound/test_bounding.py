"""Bounds from end to end: proven, near the optimum, and checked by the checker."""

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmstart.ocp import Free, PathConstraint, solve
from swarmstart.ocp.lower_bound import subsolution
from swarmstart.ocp.lower_bound.bounding import _trivial, lower_bound
from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.ocp.lower_bound.check import main
from swarmstart.ocp.lower_bound.hamiltonian import Forms, Setting, Stage
from swarmstart.ocp.lower_bound.region import Region
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.ocp.lower_bound.stated.statement import affine_form, statement_of
from swarmstart.ocp.lower_bound.subsolution import Search, worth
from swarmstart.ocp.lower_bound.tubes.tube import tube_of
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.system.separation import disc
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand
from swarmstart.tests.ocp.lower_bound.known_optimum import Symbols, stated
from swarmstart.tests.ocp.lower_bound.scalar_optima import regulator
from swarmstart.tests.ocp.lower_bound.test_known_optima import stop_after
from swarmstart.tests.ocp.lower_bound.test_region import full

OPTIMUM = np.tanh(1.0)


def test_a_regulator_s_bound_is_near_its_optimum_and_checked(tmp_path: Path) -> None:
    known = regulator()
    bound = lower_bound(
        known.problem,
        known.x0,
        answer=1.02 * OPTIMUM,
        work=60.0,
        progress=stop_after(6),
    )
    assert bound.kind is BoundKind.PROVEN
    assert 0.97 * OPTIMUM <= bound.value <= OPTIMUM
    assert bound.evidence is not None
    assert bound.evidence.bound == bound.value
    assert bound.evidence.prunings
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(certificate_content(bound.evidence)))
    assert main([str(file), "--seconds", "20"]) == 0


def test_a_maximised_worth_is_bounded_from_above() -> None:
    # The regulator's cost, less 3, with another sense.
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-5, 5), stage=3 - s.x**2 - s.u**2, maximize=True
    )
    optimum = 3 - OPTIMUM
    bound = lower_bound(
        problem, [1.0], answer=0.95 * optimum, work=60.0, progress=stop_after(2)
    )
    assert bound.kind is BoundKind.PROVEN and bound.sense == -1
    assert optimum <= bound.value <= 1.1 * optimum


@pytest.mark.parametrize("rate", [2.0, -2.0])
def test_the_trivial_bound_counts_the_horizon_that_is_least(rate: float) -> None:
    s = Symbols(1)
    problem = stated(s, s.u, horizon=Free(1.0, 3.0), controls=(-1, 1), stage=rate)
    statement = statement_of(problem, [0.0], NOTHING)
    least = 2.0 if rate > 0 else -6.0
    assert _trivial(statement, None).value == pytest.approx(least, rel=1e-12)
    assert _trivial(statement, None).value <= least


def test_a_cost_that_is_too_low_makes_no_bound_above_it() -> None:
    known = regulator()
    low = 0.5 * OPTIMUM
    bound = lower_bound(known.problem, known.x0, answer=low, work=60.0)
    assert bound.kind is BoundKind.PROVEN
    assert 0.9 * low <= bound.value <= low * (1 + 1e-5)


def test_ctrl_c_returns_the_best_so_far() -> None:
    known, told = regulator(), []

    def tell(done: int, of: int, what: str, /) -> None:
        told.append((done, of, what))
        raise KeyboardInterrupt

    bound = lower_bound(
        known.problem, known.x0, answer=1.1 * OPTIMUM, work=60.0, progress=tell
    )
    assert told == [(told[0][0], 60, "bounding")]
    assert "interrupted" in bound.reason
    assert bound.kind.is_bound and bound.value <= OPTIMUM


def test_limit_of_seconds_ends_a_proof_and_is_named() -> None:
    """A round or a proof that has begun is ended, on a busy machine too."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u - s.x[0] ** 3], horizon=3.0, controls=(-1, 1),
        stage=s.x[0] ** 2 + s.u**2,
    )  # fmt: skip
    begin = time.perf_counter()
    bound = lower_bound(problem, [1.0, 0.0], answer=100.0, work=1e6, seconds=0.5)
    assert time.perf_counter() - begin < 60.0
    assert bound.reason.endswith("stopped by the limit of 0.5 s")


def test_work_decides_a_bound_and_the_time_that_it_takes_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a machine whose clock is a thousand times faster, the same bits."""
    known = regulator()

    def bounded() -> LowerBound:
        return lower_bound(known.problem, known.x0, answer=1.01 * OPTIMUM, work=1.0)

    one, real = bounded(), time.perf_counter
    monkeypatch.setattr(
        "swarmstart.machine_code.clocks.time.perf_counter", lambda: 1e3 * real()
    )
    other = bounded()
    assert one.kind is BoundKind.PROVEN
    assert (one.value, one.boxes, one.degree) == (
        other.value,
        other.boxes,
        other.degree,
    )
    more = lower_bound(known.problem, known.x0, answer=1.01 * OPTIMUM, work=0.05)
    assert more.boxes < one.boxes


def test_a_margin_of_the_nlp_does_not_lift_a_bound() -> None:
    # The verified distance is 1, the smooth one 1.5: an answer at 1 is admissible.
    s, bounds = Symbols(2, 2), []
    for margin in (0.0, 0.5):
        problem = stated(
            s, s.u, horizon=1.0, controls=(-6, 6), stage=s.u[0] ** 2 + s.u[1] ** 2,
            path=[disc(s.x, centre=[0, 0], radius=1.0, smooth_margin=margin)],
            end=-s.x[0],
        )  # fmt: skip
        statement = statement_of(problem, [-1.2, 0.0], NOTHING)
        bounds.append([str(g) for g in statement.path])
        # A start that is nearer than the margin is no start outside.
    assert bounds[0] == bounds[1]


def test_a_start_outside_lifts_no_bound_above_a_confirmed_answer() -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=2.0, controls=(-2, 2), stage=s.x**2 + s.u**2, intervals=4,
        path=[PathConstraint(expression=s.x, upper=1.0)],
    )  # fmt: skip
    problem = replace(problem, substeps=1)
    answer = solve(
        problem, [1.5], search=None, lanes=0, backend="casadi", seed=0,
        start="may violate",
    )  # fmt: skip
    assert answer.status.is_confirmed
    bound = lower_bound(problem, [1.5], answer=1e3, work=1.0)
    assert not bound.kind.is_bound or bound.value <= answer.verified_cost


def test_every_proven_step_is_below_the_cost_to_go(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Whatever the rounds yield, the value at the start is at most the optimum, and V
    # plus what the slacks allow is at most the cost-to-go, tanh(1 - t) x^2.
    monkeypatch.setattr(subsolution, "SAMPLES", 2000)
    statement = statement_of(regulator().problem, [1.0], NOTHING)
    affine = affine_form(statement)
    stage = Stage(statement, affine)
    region = Region(statement, tube_of(statement))
    setting = Setting(statement, affine, stage, 1.0)
    rng = np.random.default_rng(0)
    # Rounds, not seconds, end it.
    search = Search(setting, region, Forms(setting, 4), "start", 1e-3, rng, np.inf)
    points = region.sampled(rng, 2000)
    x = points[1] * statement.sizes[0]
    least = np.tanh(1 - points[0]) * x**2
    number = 0
    for found in search.rounds(None):
        if found.step is not None:
            number += 1
            step = found.step
            V = step.polynomial
            basis = search.forms.basis
            values = basis.values(search.box, points) @ V.coefficients
            left = step.slack * (1 - points[0]) + (step.end_slack or 0.0)
            # Within |x| <= 2, where the bounds of u are none to the best control.
            assert (values - left <= least + 1e-9)[np.abs(x) < 2].all()
            assert worth(step, statement) <= OPTIMUM
    # How many rounds it takes to converge hangs on the processor's last digits.
    assert found.converged
    assert number >= 2


def test_worth_takes_off_all_slacks_and_is_rounded_down() -> None:
    statement = by_hand.scalar(horizon=(1.0, 3.0))
    step = full(by_hand.step({(0, 2): 1.0}, slack=0.1, end_slack=0.25))
    value = worth(step, statement)
    assert 0.45 - 1e-12 < value < 0.45
