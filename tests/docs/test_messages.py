"""Each message that is not plainly good has its place on the page of messages."""

import inspect
import re

import pytest

import swarmstart as ss
from swarmstart.cases.campaign.trials.solver_names import solvers_of
from swarmstart.cases.commands.actions.checking import angle_warnings, ramp_warnings
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.ocp.answer import paragraph_of
from swarmstart.ocp.answer.explained import REASONS, status_line
from swarmstart.ocp.common import Paragraph
from swarmstart.ocp.common.messages import PAGE as ADDRESS
from swarmstart.ocp.compiled import backend
from swarmstart.ocp.nlp.optimality import Curvature
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.system import control_systems, units
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of
from swarmstart.tests.docs.conftest import DOCS, ROOT

PAGE = DOCS / "messages.md"
if not PAGE.is_file():
    pytest.skip("there are no pages beside the tests", allow_module_level=True)
TEXT = PAGE.read_text(encoding="utf-8")
HEADINGS = [line[4:] for line in TEXT.splitlines() if line.startswith("### ")]
BELOW = dict(re.findall(r"^\(([a-z-]+)\)=\n(.+)", TEXT, re.MULTILINE))
"""Anchor -> the first line below it."""
OF_RUNS = {
    Paragraph.NO_STEP: "no step found a feasible plan",
    Paragraph.SOME_STEPS: "planned steps found no feasible plan",
    Paragraph.WITHIN: "stopped in time (within_s)",
    Paragraph.NOT_CERTIFIED: "the linear law's terminal sets are not certified",
    Paragraph.OTHER_SYSTEM: "for the model it was made with: the simulated system is",
    Paragraph.OFF_PLAN: "off its plan, above the tracking_error of",
    Paragraph.BROKEN_RUN: "COLLISION, TOO CLOSE, Constraints are broken",
}
"""Words on runs, which are tested where runs are put into words."""


def test_each_status_has_a_heading_in_its_own_words_and_no_other_is_there() -> None:
    assert [status.value for status in SolutionStatus] == HEADINGS


@pytest.mark.parametrize("status", PolishStatus)
def test_each_end_of_a_polish_has_a_row(status: PolishStatus) -> None:
    assert f"| {status.value} |" in TEXT


def test_each_address_is_an_anchor_of_the_page_and_each_anchor_an_address() -> None:
    assert [*BELOW] == [one.value for one in Paragraph]
    assert TEXT.count(")=\n") == len(BELOW)  # None stands twice.
    assert (ROOT / ADDRESS) == PAGE
    assert str(Paragraph.KINK) == "docs/messages.md#kink"


@pytest.mark.parametrize("status", SolutionStatus)
def test_a_status_leads_to_its_heading_and_only_a_confirmed_optimum_to_none(
    status: SolutionStatus,
) -> None:
    paragraph = paragraph_of(status)
    if status is SolutionStatus.CONVERGED:
        assert paragraph is None
        assert "more:" not in status_line(status)
        return
    assert paragraph is not None
    assert BELOW[paragraph.value] == f"### {status.value}"
    assert status_line(status).endswith(f"{status.value} (more: {paragraph})")


@pytest.mark.parametrize(
    ("status", "words"),
    [(status, words) for status, its in REASONS.items() for words in its],
)
def test_a_reason_leads_to_a_paragraph_in_its_words(
    status: SolutionStatus, words: str
) -> None:
    paragraph = paragraph_of(status, f"the start is outside: a; {words} b; in vain")
    assert paragraph is not None
    begin = words.partition(":")[0].partition(",")[0]
    assert begin in BELOW[paragraph.value]
    assert paragraph_of(SolutionStatus.CONVERGED, words) is None


def test_each_end_of_a_polish_and_each_curvature_that_shows_nothing_has_a_reason() -> (
    None
):
    known = REASONS[SolutionStatus.FEASIBLE]
    ends = {one.value for one in PolishStatus} - {PolishStatus.CONVERGED.value}
    bends = {one.value for one in Curvature} - {Curvature.POSITIVE.value}
    assert ends | bends <= known.keys()


def test_each_paragraph_is_reached_by_a_status_a_reason_a_run_or_a_warning() -> None:
    reached = [*filter(None, map(paragraph_of, SolutionStatus))]
    reached += [one for its in REASONS.values() for one in its.values()]
    reached += [*OF_RUNS, *OF_WARNINGS]
    assert sorted(one.value for one in reached) == sorted(
        one.value for one in Paragraph
    )


@pytest.mark.parametrize("paragraph", OF_RUNS)
def test_the_words_on_a_run_begin_their_paragraph(paragraph: Paragraph) -> None:
    assert OF_RUNS[paragraph] in BELOW[paragraph.value]


def of_casadi() -> str:
    with pytest.warns(backend.BackendWarning) as found:
        backend.warn_of_casadi("the rates have 10^6 operations")
    return str(found[0].message)


def of_more_states() -> str:
    control = pytest.importorskip("control")
    two = control.TransferFunction([[[1], [1]]], [[[1, 1], [1, 2]]])
    with pytest.warns(control_systems.NonMinimalWarning) as found:
        ss.Model.from_system(two)
    return str(found[0].message)


def of_degrees() -> str:
    return angle_warnings({"heading_rad": 90.0})[0]


def of_an_old_name() -> str:
    return solvers_of("multistart-ipopt")[0].hint


def of_units() -> str:
    with pytest.warns(units.UnitWarning) as found:
        units.warn_of_units(["the rate of x is in m, expected m/s: x is in m"])
    return str(found[0].message)


def of_a_ramp() -> str:
    text = """\
kind: problem
signals: {s: {times: [0, 0.5], values: [0, 1], between: hold}}
states: {x: {start: 0, rate: s + u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: u**2
prediction: {horizon_s: 1, intervals: 1}
"""
    return ramp_warnings(pose(scenario_of(text)))[0]


OF_WARNINGS = {
    Paragraph.RAMP: of_a_ramp,
    Paragraph.UNITS: of_units,
    Paragraph.CASADI: of_casadi,
    Paragraph.MORE_STATES: of_more_states,
    Paragraph.DEGREES: of_degrees,
    Paragraph.RENAMED: of_an_old_name,
}


@pytest.mark.parametrize("paragraph", OF_WARNINGS)
def test_a_warning_ends_with_the_address_of_its_paragraph(paragraph: Paragraph) -> None:
    assert OF_WARNINGS[paragraph]().endswith(f" (more: {paragraph})")


def test_each_warning_has_a_paragraph() -> None:
    found = [
        name
        for module in (backend, control_systems, units)
        for name, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, UserWarning) and kind.__module__ == module.__name__
    ]
    assert sorted(found) == ["BackendWarning", "NonMinimalWarning", "UnitWarning"]
    assert all(f"**{name}" in TEXT for name in found)
