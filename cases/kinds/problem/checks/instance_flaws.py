"""Errors of the instances of a scenario: of their names and numbers."""

from collections.abc import Iterator

from swarmstart.cases.format.kind import GivenInstances, unknown_instances
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Attempt, Place, quantity
from swarmstart.cases.kinds.problem.checks.uncertain import law_flaws
from swarmstart.cases.kinds.problem.stated.instances import Axis, instance_columns
from swarmstart.cases.kinds.problem.stated.scenario import (
    ProblemScenario,
    UserScenario,
)
from swarmstart.cases.kinds.problem.stated.symbols import constants_of, number
from swarmstart.ocp import OptimalControlProblem


def instances_of(scenario: UserScenario) -> GivenInstances | None:
    """Return the instances of a scenario; None if it has none.

    Raises:
        ExpressionError: If an expression is not a finite number.
    """
    part = scenario.instances
    if part is None:
        return None
    constants = _constants(scenario)
    columns = instance_columns(part, lambda text: number(text, constants))
    return GivenInstances(columns, part.starts, part.place)


def _constants(scenario: UserScenario) -> dict[str, float]:
    """Return the constants of a scenario; a problem from Python has none."""
    return constants_of(scenario) if isinstance(scenario, ProblemScenario) else {}


def instance_numbers(scenario: UserScenario) -> Iterator[Attempt]:
    """Yield the place of each expression of the instances, and its evaluation.

    The expressions are those of the grid and of the drawn laws. The evaluation is a
    function that returns the number, or raises the error.
    """
    if scenario.instances is not None:
        fixed = _constants(scenario)
        for place, text in scenario.instances.quantities():
            yield quantity(("instances", *place), text, fixed)


def instance_ranges(scenario: UserScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of numbers that are out of range."""
    part = scenario.instances
    if part is None:
        return
    fixed = _constants(scenario)
    for name, law in part.drawn.items():
        yield from law_flaws(("instances", "drawn", name), law, fixed)
    for name, axis in part.grid.items():
        if isinstance(axis, Axis):
            first, last = number(axis.lower, fixed), number(axis.upper, fixed)
            if not first < last:
                place: Place = ("instances", "grid", name)
                yield place, f"expected lower < upper, found [{first:g}, {last:g}]"


def instance_names(
    scenario: UserScenario, problem: OptimalControlProblem
) -> Iterator[LocatedFlaw]:
    """Yield errors of names that are neither states nor parameters of the plan.

    Args:
        scenario: The scenario.
        problem: Its planning problem.
    """
    part = scenario.instances
    if part is None:
        return
    source = next(
        key for key in ("file", "values", "grid", "drawn") if getattr(part, key)
    )
    for name, what in unknown_instances(part.names, problem):
        place: Place = ("instances", source)
        yield place if source == "file" else (*place, name), what
