"""Each statement of a lower bound is judged by itself, and stands on both sides."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.ocp.lower_bound.stated.answer import Evidence
from swarmstart.terminal_set.checker.findings import Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.lower_bound import statements
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Certificate,
    Step,
    certificate_of,
)
from swarmstart.terminal_set.checker.lower_bound.statements import (
    findings,
    proven_bound,
    verdict,
)
from swarmstart.terminal_set.checker.search import Outcome
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand
from swarmstart.tests.terminal_set.checker.changes import after_looks


def read(evidence: Evidence, **changes: Any) -> Certificate:
    """The certificate, with entries of it or of its problem replaced."""
    certificate = certificate_of(certificate_content(evidence))
    names = {field.name for field in dataclasses.fields(certificate)}
    own = {name: value for name, value in changes.items() if name in names}
    others = {name: value for name, value in changes.items() if name not in names}
    problem = dataclasses.replace(certificate.problem, **others)
    return dataclasses.replace(certificate, problem=problem, **own)


def constant(value: float, slack: float, end_slack: float | None) -> Step:
    return Step(
        middle=(0.0, 0.0),
        half=(1.0, 1.0),
        exponents=((0, 0),),
        coefficients=(value,),
        slack=slack,
        end_slack=end_slack,
    )


@pytest.mark.parametrize(
    ("known", "offset", "follows"),
    [
        (None, 0.0, Fraction(3) - Fraction(0.1) * 2 - Fraction(0.3)),
        (9.0, 0.7, Fraction(3) - Fraction(0.1) * 2 - Fraction(0.3) + Fraction(0.7)),
        (1.0, -0.7, Fraction(1) - Fraction(0.7)),
    ],
)
def test_the_bound_is_that_of_the_step_or_the_known_cost_exactly(
    known: float | None, offset: float, follows: Fraction
) -> None:
    certificate = read(
        by_hand.quadratic(),
        final=constant(3.0, 0.1, 0.3),
        horizon=(0.5, 2.0),
        known=known,
        offset=offset,
    )
    assert proven_bound(certificate) == follows
    near = float(follows)
    below = near if Fraction(near) <= follows else float(np.nextafter(near, -9))
    for bound, expected in (
        (below, Verdict.PROVED),
        (float(np.nextafter(below, 9)), Verdict.REFUSED),
    ):
        one = dataclasses.replace(certificate, bound=bound)
        found = next(findings(one, seconds=10.0))
        assert found.verdict is expected
        assert f"{near:.12g}" in found.text
        assert found.text.startswith("it is false") is (expected is Verdict.REFUSED)


def test_a_step_without_end_slack_gives_its_value() -> None:
    final = constant(3.0, 0.0, None)
    assert proven_bound(read(by_hand.quadratic(), final=final)) == 3


def test_a_bound_beyond_floats_is_shown_in_words() -> None:
    final = dataclasses.replace(
        constant(1e30, 0.0, 0.0), exponents=((0, 40),), half=(1.0, 1e-30)
    )
    certificate = read(by_hand.quadratic(), final=final, bound=0.0)
    found = next(findings(certificate, seconds=10.0))
    assert found.verdict is Verdict.PROVED
    assert "a number beyond floats" in found.text


def judged(certificate: Certificate) -> list[Finding]:
    return list(findings(certificate, seconds=60.0))


LEVELS = ((1.001, -0.999), (3.002, 1.002))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, ""),
        ({"horizon": (1.0, 1.0 + 1e-15)}, "covers 0 to 1 s only"),
        ({"times": (1e-15, 1.0)}, "covers 1e-15 to 1 s only"),
        ({"times": (0.0, 1.0 - 1e-15)}, "covers 0 to 1 s only, not 0 to 1 s"),
        ({"times": (-1.0, 1.0), "levels": ((1.0, -1.0), (5.1, 3.1))}, ""),
        ({"levels": ((1.0 - 1e-15, -1.0), (3.002, 1.002))}, "face 0"),
        ({"levels": ((1.001, -1.0 - 1e-15), (3.002, 1.002))}, "face 1"),
    ],
)
def test_the_tube_covers_all_times_and_holds_the_start(
    changes: dict[str, object], text: str
) -> None:
    found = judged(read(by_hand.quadratic(), **changes))
    assert found[1].verdict is (Verdict.REFUSED if text else Verdict.PROVED)
    assert text in found[1].text
    assert len(found) == (2 if text else 5)


def test_pieces_beyond_the_bounds_of_the_states_are_exempt() -> None:
    """x' = u, |u| <= 2, -9 <= x <= 2: x may not rise above 2 however flat the face.

    Of the upper face the levels are 1.5, 4, 4, 2, 2, 3 at 0, .5, 1, 1.5, 2, 2.5:
    all but the first slab begin and end at 2 or above. The other face is far away,
    at 9 at least, but for the last slab, which begins when all is over.
    """
    certificate = read(
        by_hand.quadratic(),
        times=(0.0, 0.5, 1.0, 1.5, 2.0, 2.5),
        levels=((1.5, 9.0), (4.0, 9.0), (4.0, 9.0), (2.0, 9.5), (2.0, 9.5), (3.0, 1.0)),
        state_box=((-9.0,), (2.0,)),
        horizon=(1.5, 1.5),
        final=constant(-1.0, 0.0, 0.0),
        bound=-1.0,
    )
    region_of = judged(certificate)
    faces = region_of[2]
    assert faces.verdict is Verdict.PROVED
    assert "(9 pieces of faces lie beyond the bounds of the states)" in faces.text
    # With a start at x = 2 the slabs at 2 and above are needed up to the last end.
    for upper, count, expected in (
        (2.0, 9, Verdict.PROVED),
        (2.001, None, Verdict.REFUSED),
        (None, None, Verdict.REFUSED),
    ):
        one = read(
            by_hand.quadratic(),
            times=certificate.times,
            levels=certificate.levels,
            horizon=(1.5, 1.5),
            state_box=((-9.0,), (upper,)),
            final=certificate.final,
            bound=-1.0,
        )
        found = judged(one)
        assert found[2].verdict is expected
        if count == 9:
            assert f"({count} pieces" in found[2].text
        if expected is Verdict.REFUSED:
            assert "by face 0: (t, x) = (" in found[2].text
            assert len(found) == 3


@pytest.mark.parametrize("levels", [(1.5, 4.0, 1.5), (1.5, 1.5, 4.0)])
def test_both_ends_of_an_exempt_piece_are_beyond_the_bounds(
    levels: tuple[float, ...],
) -> None:
    """x <= 2, and x rises from 1 at 2 a second: it reaches 2, beyond 1.5."""
    certificate = read(
        by_hand.quadratic(),
        times=(0.0, 0.5, 1.0),
        levels=tuple((level, 9.0) for level in levels),
        state_box=((-9.0,), (2.0,)),
        final=constant(-1.0, 0.0, 0.0),
        bound=-1.0,
    )
    found = judged(certificate)
    assert found[2].verdict is Verdict.REFUSED and "by face 0" in found[2].text


@pytest.mark.parametrize(("latest", "expected"), [(0.75, True), (1.0, False)])
def test_slabs_after_the_last_end_need_no_proof(latest: float, expected: bool) -> None:
    """The upper face falls from 1 s on; a slab that begins at the last end counts."""
    certificate = read(
        by_hand.quadratic(),
        times=(0.0, 1.0, 2.0),
        levels=((1.5, 0.0), (4.0, 3.0), (1.0, 6.0)),
        horizon=(0.5, latest),
        final=constant(-1.0, 0.0, 0.0),
        bound=-1.0,
    )
    found = judged(certificate)
    assert (found[2].verdict is Verdict.PROVED) == expected
    if expected:
        assert "(2 pieces of faces" in found[2].text


def test_faces_all_needed_are_said_without_exceptions() -> None:
    faces = judged(read(by_hand.quadratic()))[2]
    assert faces.text.startswith("no admissible trajectory leaves the tube (2 boxes,")


def test_boxes_of_all_faces_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = iter([5, 7, 11, 13])
    proofs = iter([True, True, False])

    def prove(*_: object) -> Outcome:
        return Outcome(next(proofs), next(counts), remark="late")

    monkeypatch.setattr(statements, "prove", prove)
    found = judged(read(by_hand.least_time()))
    assert "by face 2 (23 boxes," in found[2].text
    assert found[2].verdict is Verdict.UNDECIDED
    proofs, counts = iter([True] * 9), iter([5, 7, 11, 13, *[1] * 5])
    assert "leaves the tube (36 boxes," in judged(read(by_hand.least_time()))[2].text


NAMES: dict[Callable[[], Evidence], list[str]] = {
    by_hand.quadratic: ["final", "final"],
    by_hand.pruned: ["C of", "G of", "G of", "final", "final"],
}


@pytest.mark.parametrize("make", NAMES)
def test_every_step_has_its_statements(make: Callable[[], Evidence]) -> None:
    found = judged(read(make()))
    assert all(finding.verdict is Verdict.PROVED for finding in found)
    assert len(found) == 3 + len(NAMES[make])
    for finding, name in zip(found[3:], NAMES[make], strict=True):
        assert name in finding.text
    assert "V_t + L + V_x f >= -1e-06 over the set, of" in found[3].text
    assert "V <= end cost + 1e-06 at all admissible ends, of" in found[-1].text
    if make is by_hand.pruned:
        assert "of step C of pruning 1 (" in found[3].text


def test_a_pruning_is_used_after_its_own_steps_only() -> None:
    """The final step of `pruned` holds on what its pruning leaves, and only there."""
    certificate = read(by_hand.pruned())
    ((come, go),) = certificate.prunings
    assert len(judged(certificate)) == 8
    first = dataclasses.replace(certificate, prunings=((certificate.final, go),))
    found = judged(first)
    assert found[-1].verdict is Verdict.REFUSED
    assert "step C of pruning 1" in found[-1].text and len(found) == 4
    later = ((come, go), (certificate.final, go))
    found = judged(dataclasses.replace(certificate, prunings=later))
    assert found[-1].verdict is Verdict.PROVED
    assert any("step C of pruning 2" in finding.text for finding in found)


def test_ends_count_from_the_earliest_on() -> None:
    """Without end cost, V = .25 - t is at most 0 from .25 s on, and not before."""
    for earliest, expected in ((0.25, Verdict.PROVED), (0.2, Verdict.REFUSED)):
        final = Step(
            middle=(0.25, 0.0),
            half=(1.0, 1.0),
            exponents=((1, 0),),
            coefficients=(-1.0,),
            slack=1.001,
            end_slack=1e-6,
        )
        found = judged(
            read(by_hand.riccati(), final=final, horizon=(earliest, 1.0), bound=-9.0)
        )
        assert found[-1].verdict is expected
        assert len(found) == 5


def test_nothing_is_judged_after_what_does_not_hold() -> None:
    found = judged(read(by_hand.quadratic(), bound=9.0))
    assert [finding.verdict for finding in found] == [Verdict.REFUSED]


def test_time_that_is_up_within_a_tape_ends_the_findings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Deadline, "after", lambda _: after_looks(0))
    found = judged(read(by_hand.quadratic()))
    assert [finding.verdict for finding in found] == [Verdict.PROVED, Verdict.UNDECIDED]
    assert found[-1].text == "the rest: time was up before it could be judged"


def test_the_verdict_is_in_the_sense_of_the_cost() -> None:
    least = read(by_hand.quadratic(), bound=2.5)
    assert verdict(least).endswith("no admissible answer costs less than 2.5")
    most = read(by_hand.quadratic(), bound=-2.5, sense=-1.0)
    assert verdict(most).endswith("no admissible answer is worth more than 2.5")
