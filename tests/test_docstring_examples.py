"""The examples in docstrings: every public name that a user calls has one that runs."""

from __future__ import annotations

import doctest
import enum
import re

import pytest

import swarmstart as ss

RETURNED = frozenset(
    """
    LowerBound Multistart OptimalityGap Plan PolishStatus Record Row Run SearchReport
    SearchResult Solution Source StartOutcome Step StopReason TerminalSet Trajectory
    WarmStartReport Certificate Progress Decision
    """.split()
)
"""Names of what calls return; their pages describe attributes."""


def called(name: str) -> bool:
    """Return True for a name that a user calls: no error, no enumeration, no result."""
    thing = getattr(ss, name)
    if isinstance(thing, type) and issubclass(thing, BaseException | enum.Enum):
        return False
    return callable(thing) and name not in RETURNED


CALLED = sorted(filter(called, ss.__all__))


@pytest.mark.parametrize("name", CALLED)
def test_a_name_that_a_user_calls_has_an_example_that_runs(name: str) -> None:
    thing = getattr(ss, name)
    assert re.search(r"^ *Examples?:$", thing.__doc__, re.MULTILINE), name
    tests = doctest.DocTestParser().get_doctest(
        thing.__doc__, {}, name, thing.__module__, None
    )
    assert tests.examples
    failures: list[str] = []
    doctest.DocTestRunner(
        optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    ).run(tests, out=failures.append)
    assert not failures, "".join(failures)


def test_what_is_taken_for_a_result_is_a_public_name() -> None:
    assert set(ss.__all__) >= RETURNED
