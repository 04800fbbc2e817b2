"""Close formation as the commands run it."""

from pathlib import Path

from swarmstart.cases.close_formation.build import (
    CloseFormationFlight,
    build,
    problems,
)
from swarmstart.cases.close_formation.figures import draw
from swarmstart.cases.close_formation.measures import measure
from swarmstart.cases.close_formation.names import MEASURES
from swarmstart.cases.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.kind import Kind
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Trajectory


class NoAnimationError(SwarmstartError):
    """There is no animation of this kind of flight."""


def refuse_animation(writer: str) -> None:
    """Say that there is none.

    Raises:
        NoAnimationError: Always.
    """
    raise NoAnimationError(
        f"a close formation has no animation, got --animation {writer}"
    )


def animate(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    file: Path,
) -> None:
    """Say that there is none; see `refuse_animation`."""
    refuse_animation(file.suffix.removeprefix("."))


KIND = Kind(
    scenario=CloseFormationScenario,
    build=build,
    measure=measure,
    measures=MEASURES,
    problems=problems,
    figures=draw,
    animate=animate,
    check_animation=refuse_animation,
)
