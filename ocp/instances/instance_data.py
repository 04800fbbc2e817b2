"""Data of many instances of one problem, as they are given and for the problem's core.

A value that all instances share is repeated without being copied. An instance with
invalid data is listed by its number, with the reason; the valid ones are solved, in an
order that depends on their data only. So the order in which they are given changes no
bit of an answer.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.errors import LONGEST_SHOWN
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.common.limits import numbers_of
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.rollout.fitness import NOTHING, Known, shared_arguments
from swarmstart.ocp.statement.guesses import given_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem

KnownGiven = Known | Mapping[str, ArrayLike] | None
"""Known data of all instances; or by name, with a value for all or for each; None: the
problem has no parameters and no signals."""
NAMED = 10
"""Largest number of invalid instances that a message names."""
_A_MATRIX, _A_STACK = 2, 3
"""Numbers of axes."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class InstanceData:
    """Data of M instances of a stated problem.

    Attributes:
        x0: Initial states, shape (nx, M).
        parameters: Parameters that are not decided, shape (np, M).
        signals: Signals at the nodes, shape (ns, nodes, M).
        time: Time at the start of the horizon [s], of all instances.
        previous: Controls before the horizon, for all instances; see `Known`.
        guesses: Guesses of the controls as the problem states them, shape (nu, N, M),
            or (nu, N + 1, M) for linear ones; None: no guesses.
        names: Names of the rows of x0, then of the parameters.
    """

    x0: Array
    parameters: Array
    signals: Array
    time: float
    previous: ArrayLike | None
    guesses: Array | None
    names: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of instances."""
        return int(self.x0.shape[1])

    @property
    def numbers(self) -> Array:
        """Initial states and parameters, a row for each name, shape (rows, M)."""
        return np.vstack([self.x0, self.parameters])

    def known(self, number: int) -> Known:
        """Return the known data of an instance.

        Args:
            number: Number of the instance.
        """
        return Known(
            self.parameters[:, number],
            self.signals[:, :, number],
            time=self.time,
            previous=self.previous,
        )

    @property
    def typical(self) -> int | None:
        """Number of an instance with typical data; None if no instance has finite data.

        It is the middle one of the instances with finite data, in the order of these
        data. So it is the same instance in whatever order they are given.
        """
        rows = np.vstack([self.numbers, self.signals.reshape(-1, self.size)])
        finite = np.flatnonzero(np.isfinite(rows).all(axis=0))
        if not finite.size:
            return None
        order = order_of(rows[:, finite])
        return int(finite[order[order.size // 2]])


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedInstances:
    """Valid instances of the rewritten problem (core), ordered by their data only.

    Attributes:
        numbers: Number of each valid instance among those given, shape (n,).
        core: Data of these instances for the core.
        guesses: Guesses of the controls, shape (nu, N, n); None without guesses.
        invalid: Reason why an instance is invalid, by its number among those given.
    """

    numbers: NDArray[np.int64]
    core: Instances
    guesses: Array | None
    invalid: Mapping[int, str]


def read_data(
    problem: OptimalControlProblem,
    x0s: ArrayLike,
    known: KnownGiven,
    guesses: ArrayLike | None,
) -> InstanceData:
    """Return the data of instances, with the shapes checked.

    Args:
        problem: The problem as it is stated.
        x0s: Shape (nx, M); for an ensemble, the states of one member are enough.
        known: Parameters and signals; see `solve_many`.
        guesses: Controls for all instances or for each one; None: no guesses.

    Raises:
        InvalidProblemError: If a name is missing or unknown, or a shape is another one.
    """
    x0 = _initial_states(problem, x0s)
    M = x0.shape[1]
    names = _parameters(problem)
    time, previous = 0.0, None
    if isinstance(known, Known | None):
        given = known or NOTHING
        time, previous = given.time, given.previous
        parameters = _shared("parameters", given.parameters, (len(names),), M)
        signals = np.empty((0, problem.nodes, M))
        if problem.ns or np.size(given.signals):
            shape = problem.ns, problem.nodes
            signals = _shared("signals", given.signals, shape, M)
    else:
        parameters, signals = _by_name(problem, names, known, M)
    rows = problem.model.state_names[: len(x0)]
    return InstanceData(
        x0=x0,
        parameters=parameters,
        signals=signals,
        time=time,
        previous=previous,
        guesses=None if guesses is None else _guesses(problem, guesses, M),
        names=(*rows, *names),
    )


def varied_names(
    problem: OptimalControlProblem,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the states and of the parameters that an instance gives.

    Args:
        problem: The problem; what it decides is left out.
    """
    decided = {
        name
        for names in problem.start
        for name in ((names,) if isinstance(names, str) else names)
    }
    states = (name for name in problem.model.state_names if name not in decided)
    return tuple(states), _parameters(problem)


def _parameters(problem: OptimalControlProblem) -> tuple[str, ...]:
    """Return the names of the parameters that are not decided."""
    names = symbol_names(problem.model.parameters)
    return tuple(name for name in names if name not in problem.decided)


def _initial_states(problem: OptimalControlProblem, x0s: ArrayLike) -> Array:
    nx, names = problem.model.nx, problem.model.state_names
    members = 1 if problem.risk is None else problem.risk.members
    given = numbers_of("x0s", x0s)
    allowed = {nx, nx // members}
    if given.ndim != _A_MATRIX or given.shape[0] not in allowed or not given.shape[1]:
        raise InvalidProblemError(
            f"x0s must have shape ({nx}, M), a row for each of the states "
            f"{', '.join(names)} and a column for each instance, got shape "
            f"{given.shape}"
        )
    return given


def _shared(role: str, values: ArrayLike, shape: tuple[int, ...], M: int) -> Array:
    """Return values with an axis of M at the end, also if all instances share them."""
    found = numbers_of(role, values)
    if found.shape == (*shape, M):
        return found
    if found.shape != shape:
        raise InvalidProblemError(
            f"{role} of a Known must have shape {shape} for all instances or "
            f"{(*shape, M)}, one for each, got {found.shape}"
        )
    return np.broadcast_to(found[..., None], (*shape, M))


def _by_name(
    problem: OptimalControlProblem,
    names: Sequence[str],
    known: Mapping[str, ArrayLike],
    M: int,
) -> tuple[Array, Array]:
    """Return parameters (np, M) and signals (ns, nodes, M) from values by name."""
    nodes, streams = problem.nodes, symbol_names(problem.signals)
    every = (*names, *streams)
    unknown = [str(name) for name in known if name not in every]
    missing = [name for name in every if name not in known]
    if unknown or missing:
        wrong = [f"missing {', '.join(missing)}"] if missing else []
        wrong += [f"unknown {', '.join(unknown)}"] if unknown else []
        raise InvalidProblemError(
            f"known must name the parameters ({', '.join(names) or 'none'}) and the "
            f"signals ({', '.join(streams) or 'none'}) of the problem: "
            f"{'; '.join(wrong)}"
        )
    parameters, signals = np.empty((len(names), M)), np.empty((len(streams), nodes, M))
    for row, name in zip(parameters, names, strict=True):
        values = numbers_of(f"parameter {name}", known[name])
        if values.shape not in {(), (M,)}:
            raise InvalidProblemError(
                f"parameter {name} must be a number for all instances or have shape "
                f"({M},), one for each, got shape {values.shape}"
            )
        row[:] = values
    for stream, name in zip(signals, streams, strict=True):
        values = numbers_of(f"signal {name}", known[name])
        if values.shape not in {(nodes,), (nodes, M)}:
            raise InvalidProblemError(
                f"signal {name} must have shape ({nodes},), its values at the nodes "
                f"for all instances, or ({nodes}, {M}), got shape {values.shape}"
            )
        stream[:] = values if values.ndim == _A_MATRIX else values[:, None]
    return parameters, signals


def _guesses(problem: OptimalControlProblem, guesses: ArrayLike, M: int) -> Array:
    """Return the guesses of all instances, shape (nu, N, M) or (nu, N + 1, M)."""
    given = numbers_of("guesses", guesses)
    shape = problem.model.nu, problem.intervals + int(problem.has_knots)
    if given.ndim == 1:  # One control, as in `solve`.
        given = given[None, :]
    if given.shape == shape:
        return np.broadcast_to(given[:, :, None], (*shape, M))
    if given.ndim != _A_STACK or given.shape != (*shape, M):
        raise InvalidProblemError(
            f"guesses must have shape {shape} for all instances or {(*shape, M)}, one "
            f"for each, got shape {given.shape}"
        )
    return given


def posed_instances(planner: Planner, data: InstanceData) -> PosedInstances:
    """Return the valid instances of the core, and why the others are invalid.

    The core is the problem after all rewrites.

    Args:
        planner: The planner of the problem.
        data: The data of all instances.
    """
    as_stated = planner.is_core and data.previous is None
    found, guesses, numbers, invalid = (_kept if as_stated else _converted)(
        planner, data
    )
    outside = _outside(planner, found)
    invalid |= {int(numbers[place]): reason for place, reason in outside.items()}
    inside = np.setdiff1d(np.arange(numbers.size), [*outside]).astype(np.int64)
    found = found.at(inside)
    guesses = None if guesses is None else guesses[..., inside]
    keys = [one for one in (*found, guesses) if one is not None]
    flat = [one.reshape(math.prod(one.shape[:-1]), inside.size) for one in keys]
    order = order_of(np.vstack(flat))
    return PosedInstances(
        numbers=numbers[inside[order]],
        core=found.at(order),
        guesses=None if guesses is None else guesses[:, :, order],
        invalid=invalid,
    )


class _OfCore(NamedTuple):
    """Valid instances of the core, their guesses and numbers; why others are not."""

    instances: Instances
    guesses: Array | None
    numbers: NDArray[np.int64]
    invalid: dict[int, str]


def _kept(planner: Planner, data: InstanceData) -> _OfCore:
    """Return instances of a core that is the problem itself, without a loop."""
    M, invalid = data.size, dict[int, str]()
    flat = data.signals.swapaxes(0, 1).reshape(-1, M)
    rows = [data.x0, data.parameters, flat]
    if data.guesses is not None:
        rows.append(data.guesses.reshape(-1, M))
    is_finite = np.all([np.isfinite(one).all(axis=0) for one in rows], axis=0)
    for number in np.flatnonzero(~is_finite).tolist():
        try:
            _posed(planner, data, number)
        except InvalidProblemError as error:
            invalid[number] = str(error)
    numbers = np.flatnonzero(is_finite)
    instances = Instances(data.x0, data.parameters, flat).at(numbers)
    guesses = None if data.guesses is None else data.guesses[..., numbers]
    return _OfCore(instances, guesses, numbers, invalid)


def _converted(planner: Planner, data: InstanceData) -> _OfCore:
    """Return instances converted one by one."""
    core = planner.problem
    invalid: dict[int, str] = {}
    numbers: list[int] = []
    columns: list[tuple[Array, ...]] = []
    for number in range(data.size):
        try:
            columns.append(_posed(planner, data, number))
            numbers.append(number)
        except InvalidProblemError as error:
            invalid[number] = str(error)
    shapes = core.model.nx, core.model.np, core.ns * core.nodes
    parts = [*zip(*columns, strict=True)] or [()] * len(shapes)
    found = Instances(*(
        np.stack(part, axis=-1) if part else np.empty((rows, 0))
        for part, rows in zip(parts, shapes, strict=False)
    ))  # fmt: skip
    guesses = None
    if data.guesses is not None and len(parts) > len(shapes):
        guesses = np.stack(parts[-1], axis=-1)
    return _OfCore(found, guesses, np.array(numbers, dtype=np.int64), invalid)


def _posed(planner: Planner, data: InstanceData, number: int) -> tuple[Array, ...]:
    """Return x0, parameters, flat signals and, if given, controls of an instance.

    Raises:
        InvalidProblemError: If its data are invalid.
    """
    guess = None if data.guesses is None else data.guesses[:, :, number]
    if guess is not None and not np.isfinite(guess).all():
        raise InvalidProblemError("its guess must be finite")
    x0, known, start = planner.posed(data.x0[:, number], data.known(number), guess)
    found = shared_arguments(planner.problem, x0, known)
    if start is None:
        return found
    return *found, given_controls(planner.problem, np.asarray(start))


def _outside(planner: Planner, instances: Instances) -> dict[int, str]:
    """Return why starts break a constraint for any control, by their numbers."""
    core, reasons = planner.problem, dict[int, str]()
    first = instances.signals[: core.ns]
    broken = planner.tracer.checker.may_break(instances.x0, instances.parameters, first)
    for number in np.flatnonzero(broken).tolist():
        known = instances.known(core, number)
        outside = planner.outside(instances.x0[:, number], known)
        if outside:
            reasons[number] = (
                "its start must keep the bounds of the states and the path "
                f"constraints: {'; '.join(map(str, outside))}"
            )
    return reasons


def order_of(rows: Array) -> NDArray[np.int64]:
    """Return the numbers of the columns, sorted by the values in their first row.

    Columns with the same value there are sorted by the next rows.

    Args:
        rows: Shape (rows, n).
    """
    varied = rows[(rows != rows[:, :1]).any(axis=1)]
    if not varied.size:  # No key to sort by.
        return np.arange(rows.shape[1])
    return np.lexsort(varied[::-1]).astype(np.int64)


def told_invalid(invalid: Mapping[int, str]) -> Iterator[str]:
    """Yield a line for each of the first invalid instances, and a count of the others.

    Args:
        invalid: Reasons by the numbers of the instances.
    """
    for number in sorted(invalid)[:NAMED]:
        reason = " ".join(invalid[number].split())
        yield f"instance {number}: {reason[:LONGEST_SHOWN]}"
    if len(invalid) > NAMED:
        yield f"and {len(invalid) - NAMED} more"
