"""What a kind of scenario must offer for the commands to run it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.format.settings import Scenario
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import (
    Controller,
    Known,
    OptimalControlProblem,
    Plant,
    Solution,
    Trajectory,
    TrajectoryFamily,
)

Array = NDArray[np.float64]
Measure = float | int | list[float | None] | None
NEVER = "never"
"""Why a time is not defined: what it waits for does not come, so it is above any."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Flight:
    """A closed loop ready to be flown.

    Attributes:
        plant: What is flown.
        controller: What flies it.
        x0: Where it starts, shape (nx,).
        agents: Number of agents that plan, with as many plans in a decision.
        documents: What else belongs into a run's folder: name of a file -> its text.
    """

    plant: Plant
    controller: Controller
    x0: Array
    agents: int
    documents: Mapping[str, str] = field(default_factory=dict)

    def answer(self, trajectory: Trajectory) -> Solution | None:
        """Return the one plan that was flown to its end, verified; None: many plans."""
        del trajectory
        return None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed:
    """One planning problem, from one state.

    Attributes:
        problem: The problem.
        x0: The state, shape (nx,).
        known: Its parameters and signals.
        family: What a search looks for; None means control sequences.
    """

    problem: OptimalControlProblem
    x0: Array
    known: Known
    family: TrajectoryFamily | None = None


class SeveralPlansError(SwarmstartError):
    """A step of the scenario has several planning problems."""


class NoAnimationError(SwarmstartError):
    """There is no animation of this kind of flight."""


def refuse_animation(writer: str) -> None:
    """Say that there is none, in a kind that has none.

    Raises:
        NoAnimationError: Always.
    """
    raise NoAnimationError(
        f"this kind of scenario has no animation, got --animation {writer}"
    )


def animate_nothing(
    scenario: Scenario, flight: Flight, trajectory: Trajectory, file: Path
) -> None:
    """Say that there is none; see `refuse_animation`."""
    refuse_animation(file.suffix.removeprefix("."))


@dataclass(frozen=True, kw_only=True, slots=True)
class Kind:
    """A kind of scenario.

    Attributes:
        scenario: The pydantic model of its scenarios.
        build: Scenario -> flight; all of its problems are compiled here. Kernels of a
            search that this machine has never run are compiled at the first step.
        pose: Scenario -> the planning problem of its first step, nothing compiled;
            raises SeveralPlansError where a step has several.
        measure: (scenario, flight, trajectory) -> measures by name.
        measures: Name -> what it is, for the list.
        undefined: Name of a measure that may be null -> why; NEVER for a time.
        problems: Scenario -> what is wrong across its parts, with the place.
        figures: (scenario, flight, trajectory, folder) -> files written.
        animate: (scenario, flight, trajectory, file) -> None; by default a kind has no
            animation.
        check_animation: Refuses what cannot be written here, "gif" or "mp4"; by default
            either.
    """

    scenario: type[Scenario]
    build: Callable[..., Flight]
    pose: Callable[..., Posed]
    measure: Callable[..., Mapping[str, Measure]]
    measures: Mapping[str, str]
    undefined: Mapping[str, str]
    problems: Callable[..., Iterator[tuple[tuple[str | int, ...], str]]]
    figures: Callable[..., list[Path]]
    animate: Callable[..., None] = animate_nothing
    check_animation: Callable[[str], None] = refuse_animation
