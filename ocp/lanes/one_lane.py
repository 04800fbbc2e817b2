"""One lane of a problem as functions and numbers, for code written elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.lanes.integrator_steps import IntegratorSteps, integrator_steps
from swarmstart.ocp.lanes.interior import (
    BLANK,
    LEAST_UNIT,
    LIMITED,
    SAYING,
    TOLERANCE,
    has_limits,
    shared_numbers,
    state_names,
)
from swarmstart.ocp.lanes.interior_kernels import small_interior
from swarmstart.ocp.lanes.interior_parts import SteppedPlace, places_of
from swarmstart.ocp.lanes.interior_verdict import ROUNDING
from swarmstart.ocp.lanes.kernels import Written, rows_of
from swarmstart.ocp.lanes.posed import NoLanesError, posed, refused_by_lanes
from swarmstart.ocp.nlp.transcription import interval_around, multiple_shooting
from swarmstart.ocp.rollout.fitness import Arguments, Known
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class OneLane:
    """A lane of a problem whose numbers are divided by fixed sizes.

    Attributes:
        kernels: Kernels of the lane by name.
        rows: Number of entries of each name that a kernel reads or writes, besides
            those of `shared`.
        shared: Arguments that do not change, by name.
        state: Names x that take the value of "next.x" after the trial of a step.
        blank: First value of names that do not begin at 0.
        sizes: Sizes that numbers are divided by.
        weights: 1 / scale of the rows whose scale depends on the initial state.
        inputs: Number of variables of an interval besides its state.
        least_unit: Two numbers: the least unit of the cost; and the size that the cost
            of a start must at least have to become the unit.
        steps: The steps of the integrator.
        pull: Function for the costate after the last step of an interval, before any
            jump; None: it is the costate after the interval.
    """

    kernels: Mapping[str, Written]
    rows: Mapping[str, int]
    shared: Mapping[str, Array]
    state: tuple[str, ...]
    blank: Mapping[str, float]
    sizes: Sizes
    weights: Array
    inputs: int
    least_unit: tuple[float, float]
    steps: IntegratorSteps
    pull: ca.Function | None


def one_lane(  # noqa: PLR0913 - a problem, and how exactly it is solved
    shooting: Shooting,
    x0: ArrayLike,
    known: Known,
    *,
    most: int,
    longest: int,
    tolerance: float = TOLERANCE,
    rounding: float = ROUNDING,
) -> OneLane:
    """Return the lane of a problem, with the sizes of an initial state.

    Args:
        shooting: The functions of the problem.
        x0: Initial state of the rewritten problem (core), shape (nx,).
        known: Parameters and signals of the core.
        most: Largest number of steps.
        longest: Largest number of instructions of an interval's part of a kernel.
        tolerance: Largest scaled error at which the lane ends.
        rounding: Rounding error of the barrier's value, relative to it.

    Raises:
        NoLanesError: If lanes cannot solve the problem, or it is too long.
        InvalidProblemError: If a shape is not the problem's, or a value not finite.
    """
    problem = shooting.problem
    reason = refused_by_lanes(problem)
    if reason:
        raise NoLanesError(reason)
    program, arguments = multiple_shooting(shooting), Arguments(shooting)
    steps = integrator_steps(shooting, program)
    places = places_of(program, interval_around(shooting))
    interval = places.interval
    try:
        kernels = small_interior(
            places, tolerance=tolerance, rounding=rounding, most=most, longest=longest
        )
    except NoCompilerError as error:
        raise NoLanesError(str(error)) from error
    one = posed(program, arguments, x0, known)
    shared = shared_numbers(one, places)
    rows: dict[str, int] = {}
    for kernel in kernels.values():
        rows |= rows_of(kernel)
    state = state_names(rows)
    rows |= {name: rows[f"next.{name}"] for name in state}
    limited = has_limits(places)
    return OneLane(
        kernels=kernels,
        rows={name: count for name, count in rows.items() if name not in shared},
        shared=shared,
        state=state,
        blank=BLANK,
        sizes=one.sizes,
        weights=arguments(x0, known)[1][problem.model.np :],
        inputs=one.least.size,
        least_unit=(LIMITED, SAYING) if limited else (LEAST_UNIT, 0.0),
        steps=steps,
        pull=interval.pull() if isinstance(interval, SteppedPlace) else None,
    )
