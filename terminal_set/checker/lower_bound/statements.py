"""The statements of a certificate, proven again one by one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from swarmstart.terminal_set.checker.findings import (
    Deadline,
    Finding,
    TimeIsUpError,
    Verdict,
)
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Certificate,
    Step,
)
from swarmstart.terminal_set.checker.lower_bound.controls import split
from swarmstart.terminal_set.checker.lower_bound.polynomials import exact_value
from swarmstart.terminal_set.checker.lower_bound.regions import (
    Region,
    is_cut_off,
    pruned_by,
    stated_tube,
)
from swarmstart.terminal_set.checker.lower_bound.tasks import (
    EndTask,
    FaceTask,
    StepTask,
)
from swarmstart.terminal_set.checker.search import Outcome, finding_of, prove


def findings(certificate: Certificate, *, seconds: float) -> Iterator[Finding]:
    """Judge a certificate, statement by statement.

    It stops at a statement that does not hold, since those after it depend on it.

    Args:
        certificate: The statements of the file.
        seconds: Time for all statements [s].

    Yields:
        A finding for each statement.
    """
    deadline = Deadline.after(seconds)
    try:
        for finding in _in_order(certificate, deadline):
            yield finding
            if finding.verdict is not Verdict.PROVED:
                return
    except TimeIsUpError:
        text = "the rest: time was up before it could be judged"
        yield Finding(Verdict.UNDECIDED, text)


def _in_order(certificate: Certificate, deadline: Deadline) -> Iterator[Finding]:
    yield _bound(certificate)  # First what takes no time.
    stated = stated_tube(certificate)
    region = Region(
        certificate=certificate,
        split=split(certificate.problem, deadline),
        tube=stated,
        stated=stated,
    )
    yield _start(region)
    yield _faces(region, deadline)
    for number, (come, go) in enumerate(certificate.prunings, start=1):
        yield from _step(come, f"step C of pruning {number}", region, deadline)
        yield from _step(go, f"step G of pruning {number}", region, deadline)
        pruned = pruned_by(certificate, come, go)
        region = dataclasses.replace(region, prunings=(*region.prunings, pruned))
    yield from _step(certificate.final, "the final step", region, deadline)


def proven_bound(certificate: Certificate) -> Fraction:
    """Return the lower bound that follows from the final step, as an exact fraction.

    It is min(known, V(0, x0) - slack * latest - end slack) + offset, with the known
    cost, the polynomial V and the slacks of the step, the initial state x0, the latest
    end time, and the number that is added to the cost.
    """
    final, problem = certificate.final, certificate.problem
    value = exact_value(final, (0.0, *problem.x0))
    value -= Fraction(final.slack) * Fraction(problem.horizon[1])
    value -= Fraction(final.end_slack or 0.0)
    if certificate.known is not None:
        value = min(value, Fraction(certificate.known))
    return value + Fraction(problem.offset)


def _bound(certificate: Certificate) -> Finding:
    follows = proven_bound(certificate)
    near = _shown(follows)
    text = f"the bound {certificate.bound:.12g} follows from the steps, which give"
    if Fraction(certificate.bound) <= follows:
        return Finding(Verdict.PROVED, f"{text} {near}, if they hold")
    return Finding(Verdict.REFUSED, f"it is false that {text} only {near}")


def _shown(value: Fraction) -> str:
    try:
        return f"{float(value):.12g}"
    except OverflowError:
        return "a number beyond floats"


def _start(region: Region) -> Finding:
    tube, problem = region.tube, region.certificate.problem
    times = region.certificate.times
    if times[0] > 0.0 or times[-1] < problem.horizon[1]:
        text = f"the tube covers {times[0]:g} to {times[-1]:g} s only"
        return Finding(Verdict.REFUSED, f"{text}, not 0 to {problem.horizon[1]:g} s")
    face = tube.holds_exactly(problem.x0)
    if face is not None:
        text = f"the initial state lies outside of the tube's face {face}"
        return Finding(Verdict.REFUSED, text)
    text = "the tube covers all times, and holds the initial state at the first"
    return Finding(Verdict.PROVED, text)


def _faces(region: Region, deadline: Deadline) -> Finding:
    text = "no admissible trajectory leaves the tube"
    start, boxes, exempt = time.monotonic(), 0, 0
    with np.errstate(all="ignore"):
        for face in range(len(region.tube.directions)):
            slabs = _slabs(region, face)
            exempt += len(region.tube.times) - 1 - len(slabs)
            if not slabs:
                continue
            task = FaceTask(face, region)
            outcome = prove(task, task.roots(slabs), deadline)
            boxes += outcome.boxes
            if not outcome.proven:
                found = dataclasses.replace(outcome, boxes=boxes)
                return finding_of(found, f"{text}, by face {face}", start, "(t, x)")
    if exempt:
        text += f" ({exempt} pieces of faces lie beyond the bounds of the states)"
    return finding_of(Outcome(True, boxes), text, start, "(t, x)")


def _slabs(region: Region, face: int) -> list[int]:
    """Return the slabs in which a face is not cut off by the bounds of the states."""
    tube, latest = region.tube, region.certificate.problem.horizon[1]
    levels, direction = tube.levels[:, face], tube.directions[face]
    return [
        i
        for i in range(len(tube.times) - 1)
        if tube.times[i] <= latest
        and not is_cut_off(direction, (levels[i], levels[i + 1]), region.certificate)
    ]


def _step(
    step: Step, name: str, region: Region, deadline: Deadline
) -> Iterator[Finding]:
    start = time.monotonic()
    outcome = prove(StepTask(step, region), region.roots(), deadline)
    text = f"V_t + L + V_x f >= -{step.slack:g} over the set, of {name}"
    yield finding_of(outcome, text, start, "(t, x)")
    if step.end_slack is None:
        return
    start = time.monotonic()
    earliest = region.certificate.problem.horizon[0]
    outcome = prove(EndTask(step, region), region.roots(earliest), deadline)
    text = f"V <= end cost + {step.end_slack:g} at all admissible ends, of {name}"
    yield finding_of(outcome, text, start, "(t, x)")


def verdict(certificate: Certificate) -> str:
    """Return the verdict if everything was proven again."""
    bound, sense = certificate.bound, certificate.problem.sense
    if sense < 0.0:
        return f"proven again: no admissible answer is worth more than {-bound:.12g}"
    return f"proven again: no admissible answer costs less than {bound:.12g}"
