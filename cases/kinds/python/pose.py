"""A scenario from Python -> its agent and plant; this module runs the user's file."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.kind import Posed, PosedAgent, PosedPlant
from swarmstart.cases.kinds.problem.measuring.measures import PATH, wrong_measures
from swarmstart.cases.kinds.problem.stated.symbols import TIME
from swarmstart.cases.kinds.python.scenario import (
    PythonScenario,
    UserCodeError,
    returned,
)
from swarmstart.ocp import Known, Model, OptimalControlProblem
from swarmstart.ocp.common import symbol_names
from swarmstart.ocp.loop import ReferenceSignals
from swarmstart.ocp.statement import held_signals

MOST_INTERVALS = 10_000
"""Largest number of intervals of a prediction, as in YAML."""
_PAIR, _TRIPLE = 2, 3
_ROUNDING = 1e-9
"""Part of the horizon by which a time may be before the interval that it begins."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Stated:
    """A checked problem that the user's function has returned.

    Attributes:
        problem: The problem.
        x0: Initial state, shape (nx,), finite; guesses for decided entries.
        parameters: Parameters that are not decided, finite.
        signals: Signals, shape (ns, nodes), finite.
        previous: Control of the interval before, shape (nu,); None if not given.
    """

    problem: OptimalControlProblem
    x0: Array
    parameters: Array
    signals: Array
    previous: Array | None


def pose(scenario: PythonScenario) -> Posed:
    """Run the scenario's file, and return the agent and the plant of its problem.

    Raises:
        UserCodeError: If it does not return a problem that fits the scenario.
    """
    stated = _stated(scenario)
    problem, model = stated.problem, stated.problem.model
    parameters, reference = stated.parameters, _reference(problem, stated.signals)
    return Posed(
        agents=(
            PosedAgent(
                problem=problem,
                reference=reference,
                parameters=(lambda time: parameters) if parameters.size else None,
                append=scenario.feedback.append,
                shift=scenario.feedback.last_plan == "shifted",
                previous=stated.previous,
                within=scenario.feedback.within_s,
            ),
        ),
        x0=stated.x0,
        plant=PosedPlant(
            model=model,
            substeps=scenario.plant.substeps,
            parameters=(
                lambda times: np.repeat(parameters[:, None], len(times), axis=1)
            )
            if parameters.size
            else None,
            signals=_first_rows(reference, model.ns),
            decided={name: one.first for name, one in problem.decided.items()},
        ),
        period=scenario.feedback.period_s,
        until=scenario.feedback.ends_at_s,
        open_loop=scenario.feedback.law == "open_loop",
        repair=scenario.feedback.repair,
        documents={scenario.problem.file.name: scenario.problem.text},
    )


def names_of(model: Model) -> tuple[str, ...]:
    """Return the names that own measures can use for values along the path."""
    return (TIME, *model.state_names, *model.control_names)


def _reference(
    problem: OptimalControlProblem, signals: Array
) -> ReferenceSignals | None:
    """Return signals at absolute times; the last value is held after the horizon."""
    if not len(signals):
        return None
    times, held = problem.expected_times, held_signals(problem)
    begins = times[:: problem.checks]
    names = symbol_names(problem.signals)

    def values(name: str, row: Array, at: Array) -> Array:
        if name not in held:
            return np.interp(at, times, row)
        # Multiples of the interval are rounded.
        since = np.searchsorted(begins, at + _ROUNDING * times[-1], side="right")
        return np.asarray(row[:: problem.checks][np.maximum(since - 1, 0)])

    return lambda at: np.stack(
        [values(name, row, at) for name, row in zip(names, signals, strict=True)]
    )


def _first_rows(
    reference: ReferenceSignals | None, count: int
) -> ReferenceSignals | None:
    """Return the first signals, which are those of a model; None without any."""
    if reference is None or not count:
        return None
    return lambda at: reference(at)[:count]


def _stated(scenario: PythonScenario) -> Stated:
    """Return the function's result, if it is a problem, x0 and known values."""
    found = returned(scenario.problem, scenario.arguments)
    parts = found if isinstance(found, tuple) else (found,)
    # The start may be a list, an array, or anything that NumPy reads.
    types = (OptimalControlProblem, object, Known)
    has_types = all(map(isinstance, parts, types))
    if len(parts) not in (_PAIR, _TRIPLE) or not has_types:
        raise _refused(
            scenario,
            "(problem, x0) or (problem, x0, known)",
            f"({', '.join(type(part).__name__ for part in parts)})",
        )
    problem, x0, known = (*parts, Known())[:_TRIPLE]
    _require_fitting(scenario, problem)
    model, size = problem.model, problem.signals.numel()
    # Without signals there is a shape of no rows, whatever Known holds.
    of_signals = known.signals if size else np.empty((0, problem.nodes))
    count = model.np - len(problem.decided)
    given = known.previous
    return Stated(
        problem=problem,
        x0=_numbers(scenario, "x0", _guessed(problem, x0), (model.nx,)),
        parameters=_numbers(scenario, "known.parameters", known.parameters, (count,)),
        previous=None
        if given is None
        else _numbers(scenario, "known.previous", given, (model.nu,)),
        signals=_numbers(scenario, "known.signals", of_signals, (size, problem.nodes)),
    )


def _guessed(problem: OptimalControlProblem, x0: object) -> object:
    """Return an initial state with guesses for entries that are NaN and decided."""
    if not isinstance(x0, Sequence | np.ndarray) or len(x0) != problem.model.nx:
        return x0  # An error is raised when it is read.
    guessed = list(x0)
    for one in problem.free_starts:
        for i in one.states:
            is_missing = isinstance(guessed[i], float) and np.isnan(guessed[i])
            guessed[i] = one.value.first if is_missing else guessed[i]
    return guessed


def _numbers(
    scenario: PythonScenario, name: str, given: object, shape: tuple[int, ...]
) -> Array:
    """Return finite numbers of a shape."""
    try:
        numbers = np.array(given, dtype=np.float64)
    except Exception as error:  # An object of the user's can raise any error.
        found = type(error).__name__
        raise _refused(scenario, f"numbers as {name}", found) from error
    if numbers.shape != shape:
        raise _refused(scenario, f"{name} of shape {shape}", str(numbers.shape))
    if not np.isfinite(numbers).all():
        raise _refused(scenario, f"finite numbers as {name}", str(numbers.tolist()))
    return numbers


def _require_fitting(scenario: PythonScenario, problem: OptimalControlProblem) -> None:
    """Raise for too many intervals or steps, and for measures with unknown names."""
    if problem.intervals > MOST_INTERVALS:
        found = str(problem.intervals)
        raise _refused(scenario, f"at most {MOST_INTERVALS} intervals", found)
    is_open = scenario.feedback.law == "open_loop"
    least, found_steps = problem.intervals, scenario.plant.substeps
    if scenario.feedback.period_s is not None and found_steps < least:
        raise UserCodeError(
            f"plant.substeps: expected at least the problem's {least} intervals with "
            f"feedback.period_s, found {found_steps}"
        )
    if is_open and scenario.steps > problem.intervals:
        raise UserCodeError(
            f"steps: expected at most the problem's {problem.intervals} intervals "
            f"with feedback: open_loop, found {scenario.steps}"
        )
    known = dict.fromkeys(names_of(problem.model), PATH)
    for place, what in wrong_measures(scenario.measures, known):
        raise UserCodeError(f"{'.'.join(map(str, place))}: {what}")


def _refused(scenario: PythonScenario, expected: str, found: str) -> UserCodeError:
    code = scenario.problem
    return UserCodeError(
        f"{printable(str(code.file))}: expected {code.function} to return {expected}; "
        f"found {printable(found)[:200]}"
    )
