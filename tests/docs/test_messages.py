"""Every status, end of a polish and warning has its place on the page of messages."""

import inspect

import pytest

from swarmstart.ocp.compiled import backend
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.system import control_systems
from swarmstart.tests.docs.conftest import DOCS

PAGE = DOCS / "messages.md"
if not PAGE.is_file():
    pytest.skip("there are no pages beside the tests", allow_module_level=True)
TEXT = PAGE.read_text(encoding="utf-8")
HEADINGS = [line[4:] for line in TEXT.splitlines() if line.startswith("### ")]


def test_each_status_has_a_heading_in_its_own_words_and_no_other_is_there() -> None:
    assert [status.value for status in SolutionStatus] == HEADINGS


@pytest.mark.parametrize("status", PolishStatus)
def test_each_end_of_a_polish_has_a_row(status: PolishStatus) -> None:
    assert f"| {status.value} |" in TEXT


def test_each_warning_has_a_paragraph() -> None:
    found = [
        name
        for module in (backend, control_systems)
        for name, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, UserWarning) and kind.__module__ == module.__name__
    ]
    assert sorted(found) == ["BackendWarning", "NonMinimalWarning"]
    assert all(f"**{name}" in TEXT for name in found)
