"""Results find the functions that draw, write and show them by name alone."""

import importlib
import subprocess
import sys

import pytest

from swarmstart.ocp import Solution, Trajectory
from swarmstart.ocp.common import presentation
from swarmstart.ocp.common.presentation import PRESENTATIONS, Presented


@pytest.mark.parametrize("place", PRESENTATIONS.values())
def test_every_function_of_the_table_is_there(place: str) -> None:
    module, _, name = place.partition(":")
    assert callable(getattr(importlib.import_module(module), name))


def test_both_results_can_do_everything_that_the_table_has() -> None:
    verbs = {verb for _, verb in PRESENTATIONS}
    classes = {"Solution", "Trajectory"}
    assert {*PRESENTATIONS} == {(one, verb) for one in classes for verb in verbs}
    assert issubclass(Solution, Presented) and issubclass(Trajectory, Presented)


def test_results_import_no_drawing_before_they_are_asked() -> None:
    code = "import sys; from swarmstart.ocp import Solution, Trajectory; "
    code += "print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert presentation.__name__ in loaded
    assert not loaded & {"matplotlib", "pandas", "swarmstart.cases"}
