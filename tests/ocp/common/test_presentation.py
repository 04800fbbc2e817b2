"""Results find the functions that draw, write and show them by name alone."""

import importlib
import subprocess
import sys

import pytest

from swarmstart.ocp import Solution, Solutions, SwarmFlight, Trajectory
from swarmstart.ocp.common import presentation
from swarmstart.ocp.common.presentation import PRESENTATIONS, Presented


@pytest.mark.parametrize("place", PRESENTATIONS.values())
def test_every_function_of_the_table_is_there(place: str) -> None:
    module, _, name = place.partition(":")
    assert callable(getattr(importlib.import_module(module), name))


def test_both_results_can_do_everything_that_the_table_has() -> None:
    # Over many instances or vehicles, with verbs of their own.
    own = {"Solutions": Solutions, "SwarmFlight": SwarmFlight}
    over_time = {entry for entry in PRESENTATIONS if entry[0] not in own}
    verbs = {verb for _, verb in over_time}
    classes = {"Solution", "Trajectory"}
    assert over_time == {(one, verb) for one in classes for verb in verbs}
    assert issubclass(Solution, Presented) and issubclass(Trajectory, Presented)
    assert all(hasattr(own[one], verb) for one, verb in PRESENTATIONS if one in own)


def test_results_import_no_drawing_before_they_are_asked() -> None:
    code = "import sys; from swarmstart.ocp import Solution, Trajectory; "
    code += "print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert presentation.__name__ in loaded
    assert not loaded & {"matplotlib", "pandas", "swarmstart.cases"}
