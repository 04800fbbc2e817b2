"""Start of a polish: controls, states, and multipliers carried from another answer.

Multipliers are transferred to an NLP on another grid or time window. The time of the
answer's horizon is scaled to [0, 1]. The new horizon is a window of this time: usually
[0, 1], or [1/N, 1 + 1/N] one of N intervals later. Then

    costates     are interpolated: they are the gradient of the cost to go, on any grid
    path rows    are densities: the multipliers of an interval and its checks are spread
    and bounds   over the time and summed over the time that each new row stands for
    end, start   stay as they are

Beyond the end, interpolation holds the last value. The multipliers of collocation rows
and of tied controls in blocks follow from the others by stationarity, exactly.

Source: Nocedal and Wright (2006), section 12.8, for multipliers as sensitivities;
Hager (2000), Runge-Kutta methods in optimal control and the transformed adjoint system,
Numerische Mathematik 87, for the costates of a grid.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import FLAG, checked, having, mapping, optional, reals
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.nlp.collocation import inner_unknowns
from swarmstart.ocp.nlp.multipliers import Duals, columns_of, shifted_duals, units_of
from swarmstart.ocp.nlp.nlp_assembly import Mapped, Part, decided_states, inputs_of
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.statement.control_shape import first_of, ties, variables_of
from swarmstart.ocp.statement.problem import STATE_BOUNDS, OptimalControlProblem
from swarmstart.ocp.system.separation import label

Key = tuple[Hashable, ...]


@checked(
    refused,
    controls=reals(),
    states=optional(reals()),
    x0=optional(reals()),
    is_guess=FLAG,
    carried=optional(having("placed", words="multipliers of an earlier answer")),
    decided=mapping(words="a mapping of names to numbers"),
)
class Start(NamedTuple):
    """Start of a polish.

    Attributes:
        controls: Controls, shape (nu, N).
        states: States at the nodes, shape (nx, nodes); None: those that the controls
            lead to.
        x0: Initial state, including the decisions about it, shape (nx,); None: the
            given one.
        is_guess: Whether the NLP is scaled by these states: the natural size of a
            state without bounds is then its range in them.
        carried: Multipliers of an earlier answer, from which a polish starts; None: no
            multipliers.
        decided: Decisions of an earlier answer about the start of the rewritten
            problem's states, by their names: a free end time, parameters.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u - x**3), horizon=1.0, intervals=5,
        ...     stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> line = np.linspace(2.0, 0.0, 6)[None, :]
        >>> guess = ss.Start(controls=np.zeros((1, 5)), states=line)
        >>> found = ss.solve(problem, [2.0], guess=guess, search=None, lanes=0, seed=0)
        >>> found.status.name
        'CONVERGED'
    """

    controls: Array
    states: Array | None = None
    x0: Array | None = None
    is_guess: bool = False
    carried: Carried | None = None
    decided: Mapping[str, float] = MappingProxyType({})

    def __reduce__(self) -> tuple[type[Start], tuple[Any, ...]]:
        """Return how to make it again: Python cannot pickle the view of a mapping."""
        return Start, (*self[:-1], dict(self.decided))


_PATIENCE, _LEAST_PATIENCE = 3, 20
"""Iterations after which a solve in a closed loop is given up: three times the median
of the earlier ones, at least 20."""


class _Place(NamedTuple):
    """Place of a multiplier within an interval.

    Attributes:
        at: Time within the interval, as a fraction of it.
        is_bound: Whether the multiplier belongs to a bound of a variable, not to a row.
        number: Number of the row or variable in the interval.
    """

    at: float
    is_bound: bool
    number: int


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Carried:
    """Multipliers of an answer, prepared for another solve.

    Attributes:
        duals: Multipliers of the answer, without scaling.
        program: The NLP that they belong to; None: the NLP to be solved.
        begin: Start of the new horizon, in the answer's time from 0 to 1.
        end: End of the new horizon, in the answer's time from 0 to 1.
        stretch: Length of the new horizon divided by the answer's time from `begin` to
            `end`.
        spent: In a closed loop, the iterations of those earlier solves that began with
            carried multipliers and converged, the latest last. A solve that takes many
            more iterations is stopped. If empty, there is no such limit.
    """

    duals: Duals
    program: NonlinearProgram | None = None
    begin: float = 0.0
    end: float = 1.0
    stretch: float = 1.0
    spent: tuple[int, ...] = ()

    @property
    def most(self) -> float:
        """Number of iterations after which a solve is stopped; may be infinite."""
        if not self.spent:
            return math.inf
        return max(_LEAST_PATIENCE, _PATIENCE * float(np.median(self.spent)))

    def placed(
        self, program: NonlinearProgram, w: Array, q: Array, cost_size: float
    ) -> tuple[Array, Array] | None:
        """Return the multipliers of rows and bounds, scaled as an NLP needs them.

        Args:
            program: The NLP.
            w: Point at which its solver starts.
            q: Arguments of the NLP.
            cost_size: Divisor of the cost in the NLP.

        Returns:
            The multipliers; None if they are not finite or do not fit the NLP.
        """
        rows, bounds = units_of(program, q, cost_size)
        own = self.program or program
        if (self.duals.rows.size, self.duals.bounds.size) != _numbers(own):
            return None
        found = self._as_they_are(own, program)
        if found is not None:
            lam_g, lam_x = found.rows / rows, found.bounds / bounds
        else:
            found = self._on(own, program)
            lam_g, lam_x = found.rows / rows, found.bounds / bounds
            lam_g = _completed(program, w, q, lam_g, lam_x)
        if not (np.isfinite(lam_g).all() and np.isfinite(lam_x).all()):
            return None
        return lam_g, lam_x

    def _as_they_are(
        self, own: NonlinearProgram, program: NonlinearProgram
    ) -> Duals | None:
        """Return the multipliers if the grid is the same; None if it is not."""
        if not _same_layout(own, program):
            return None
        if (self.begin, self.end, self.stretch) == (0.0, 1.0, 1.0):
            return self.duals
        part = 1.0 / program.problem.intervals
        is_next = (self.begin, self.end, self.stretch) == (part, part + 1.0, 1.0)
        # Blocks keep their places, so their multipliers cannot move along.
        if is_next and not program.problem.ties_controls:
            return shifted_duals(program, self.duals)
        return None

    def _on(self, own: NonlinearProgram, program: NonlinearProgram) -> Duals:
        """Return the multipliers on another grid."""
        found = Duals(*(np.zeros(n) for n in _numbers(program)))
        given, made = columns_of(own, self.duals), columns_of(program, found)
        self._costates(own, program, given[0], made[0])
        now, before = _streams(program), _streams(own)
        spread = _spread(own, given[1])
        for key, places in now.items():
            if key not in before:
                continue
            values = np.array(
                [
                    (spread if place.is_bound else given[0])[place.number]
                    for place in before[key]
                ]
            )
            moved = self._summed(
                values, [p.at for p in before[key]], [p.at for p in places], program
            )
            for place, row in zip(places, moved, strict=True):
                made[place.is_bound][place.number] = row
        _gather(program, made[1])
        _copy_ends((own, self.duals), (program, found))
        return found

    def _costates(
        self,
        own: NonlinearProgram,
        program: NonlinearProgram,
        given: Array,
        made: Array,
    ) -> None:
        """Interpolate the costates, in place; those of new states stay 0."""
        N, names = own.problem.intervals, own.problem.model.state_names
        at = np.arange(1, N + 1) / N
        wanted = self._source(np.arange(1, program.problem.intervals + 1), program)
        for i, name in enumerate(program.problem.model.state_names):
            if name not in names:
                continue
            row = given[names.index(name)]
            made[i] = np.interp(wanted, at, row)
            if N > 1:  # Extrapolate before the first costate.
                early = np.minimum(wanted - at[0], 0.0)
                made[i] += early * (row[1] - row[0]) * N

    def _source(self, intervals: ArrayLike, program: NonlinearProgram) -> Array:
        """Return the answer's time at given interval numbers of the new grid."""
        part = np.asarray(intervals) / program.problem.intervals
        return np.asarray(self.begin + (self.end - self.begin) * part)

    def _summed(
        self,
        values: Array,
        given: Sequence[float],
        wanted: Sequence[float],
        program: NonlinearProgram,
    ) -> Array:
        """Integrate a density over the cells of new places; shape (places, N).

        Args:
            values: Values of the density at each place, shape (places, N of the
                answer).
            given: Times of these places within an interval.
            wanted: Times of the new places within an interval.
            program: The NLP with the new places.
        """
        N = values.shape[1]
        edges = _edges(given, N) / N
        total = np.append(0.0, np.cumsum(values.ravel(order="F")))
        if self.end > 1.0:
            density = values[-1, -1] / (edges[-1] - edges[-2])
            total = np.append(total, total[-1] + density * (self.end - 1.0))
            edges = np.append(edges, self.end)
        new = self._source(_edges(wanted, program.problem.intervals), program)
        # Differences of the running integral, so that no part of it is lost.
        parts = np.diff(np.interp(new, edges, total)) * self.stretch
        return np.asarray(parts.reshape((len(wanted), -1), order="F"))


def _edges(at: Sequence[float], intervals: int) -> Array:
    """Return the edges of time cells around places in each interval, in intervals."""
    within = np.append(0.0, (np.array(at[1:]) + np.array(at[:-1])) / 2)
    return np.append((np.arange(intervals)[:, None] + within).ravel(), intervals)


def _numbers(program: NonlinearProgram) -> tuple[int, int]:
    """Return the numbers of rows and of variables of an NLP."""
    return int(program.nlp["g"].numel()), int(program.nlp["x"].numel())


def _same_layout(one: NonlinearProgram, other: NonlinearProgram) -> bool:
    """Return whether the rows and variables of two NLPs correspond one by one."""
    return one is other or (
        one.problem.intervals == other.problem.intervals
        and _numbers(one) == _numbers(other)
        and _streams(one) == _streams(other)
    )


def _names(problem: OptimalControlProblem) -> list[Key]:
    """Return a name of each constraint, by its number among a part's places."""
    groups = {
        "path": problem.path_constraints,
        "end": problem.terminal_constraints,
        "soft": problem.soft,
    }
    found: list[Key] = []
    for group, constraints in groups.items():
        for constraint in constraints:
            name = label(constraint)
            again = sum(1 for one in found if one[:2] == (group, name))
            found.append((group, name, again))
    return found


def _keys(program: NonlinearProgram, part: Part) -> list[Key]:
    """Return a key that identifies each limited row of a part."""
    names, rows = _names(program.problem), part.rows
    sides = zip(np.isfinite(rows.lower), np.isfinite(rows.upper), strict=True)
    return [
        (*names[number], row, *map(bool, side))
        for (number, row), side in zip(rows.places, sides, strict=True)
    ]


def _streams(program: NonlinearProgram) -> dict[Key, list[_Place]]:
    """Return the places of each multiplier that is distributed along the time."""
    core, interval = program.problem, program.parts.interval
    first = interval.height - len(interval.rows.places)
    jumped = core.checks + 1
    found: dict[Key, list[_Place]] = {}
    for number, (key, check) in enumerate(
        zip(_keys(program, interval), interval.rows.at, strict=True)
    ):
        own = (*key, check == jumped)
        # The check after the jump is at the end as well.
        place = _Place(min(check / core.checks, 1.0), False, first + number)
        found.setdefault(own, []).append(place)
    for j in range(core.model.nu):
        found["control", core.model.control_names[j]] = [_Place(1.0, True, j)]
    for j in range(core.slacks):
        found["excess", j] = [_Place(1.0, True, core.model.nu + j)]
    lower, upper = core.state_limits
    names, inputs = _names(core), inputs_of(core)
    for row, i in enumerate(core.bounded_states):
        name = next(n for n in names if n[:2] == ("path", STATE_BOUNDS))
        sides = bool(np.isfinite(lower[i])), bool(np.isfinite(upper[i]))
        place = _Place(1.0, True, inputs + int(i))
        found.setdefault((*name, row, *sides, False), []).append(place)
    return found


def _spread(program: NonlinearProgram, bounds: Array) -> Array:
    """Return multipliers of bounds (inputs + nx, N), shared out within each block."""
    core = program.problem
    if not core.ties_controls:
        return bounds
    found, nu = bounds.copy(), core.model.nu
    number = variables_of(core.control_labels)
    of_first = bounds[:nu].ravel(order="F")[first_of(core.control_labels)]
    shared = (of_first / np.bincount(number))[number]
    found[:nu] = shared.reshape((nu, -1), order="F")
    return found


def _gather(program: NonlinearProgram, bounds: Array) -> None:
    """Add up a block's multipliers at its first control, in place."""
    core = program.problem
    if not core.ties_controls:
        return
    nu, number = core.model.nu, variables_of(core.control_labels)
    sums = np.bincount(number, weights=bounds[:nu].ravel(order="F"))
    every = np.zeros(number.size)
    every[first_of(core.control_labels)] = sums
    bounds[:nu] = every.reshape((nu, -1), order="F")


def _copy_ends(
    given: tuple[NonlinearProgram, Duals], made: tuple[NonlinearProgram, Duals]
) -> None:
    """Copy the multipliers of the end and the start, in place."""
    before, after = _of_ends(*given), _of_ends(*made)
    for key, number in after.rows.items():
        if key in before.rows:
            made[1].rows[number] = given[1].rows[before.rows[key]]
    for name, number in after.decided.items():
        if name in before.decided:
            made[1].bounds[number] = given[1].bounds[before.decided[name]]


class _Ends(NamedTuple):
    """Indices of the multipliers at the end and the start."""

    rows: Mapping[Key, int]
    decided: Mapping[str, int]


def _of_ends(program: NonlinearProgram, duals: Duals) -> _Ends:
    core, place = program.problem, 0
    rows: dict[Key, int] = {}
    for number, part in enumerate(program.parts.present):
        height = part.height
        if number:
            keys = _keys(program, part)
            equations = [("equation", i) for i in range(height - len(keys))]
            every: list[Key] = [*equations, *keys]
            rows |= {(number, *key): place + i for i, key in enumerate(every)}
        place += height * (1 if number else core.intervals)
    free = decided_states(core)
    first = duals.bounds.size - len(free)
    names = core.model.state_names
    return _Ends(rows, {names[i]: first + k for k, i in enumerate(free)})


def _completed(
    program: NonlinearProgram, w: Array, q: Array, lam_g: Array, lam_x: Array
) -> Array:
    """Return the multipliers, completed by stationarity.

    The completed ones belong to the collocation rows and to the tied controls of
    blocks.
    """
    core = program.problem
    count = inner_unknowns(core)
    if not count and not core.ties_controls:
        return lam_g
    found, nx, N = lam_g.copy(), core.model.nx, core.intervals
    height = program.parts.interval.height
    inner = found[: height * N].reshape((N, height))[:, nx : nx + count]  # A view.
    inner[:] = 0.0  # Unknown; they must not enter `rest`.
    tied = ties(core.control_labels)[0].size if core.ties_controls else 0
    found[found.size - tied :] = 0.0
    jacobian = program.derivatives["jac_g"](w, q)[1].sparse().tocsr()
    slope = np.array(program.derivatives["grad_f"](w, q)[1]).ravel()
    if count:
        rest = slope + jacobian.T @ found + lam_x
        width = inputs_of(core) + nx
        for k in range(N):
            rows = slice(k * height + nx, k * height + nx + count)
            own = slice(
                k * width + inputs_of(core) - count, k * width + inputs_of(core)
            )
            block = jacobian[rows, own].toarray()
            inner[k] = np.linalg.lstsq(block.T, -rest[own], rcond=None)[0]
    if tied:
        rest = slope + jacobian.T @ found + lam_x
        now, before = Mapped(core, program.parts).ties()
        # From the last one on, since each row also holds the control before it.
        for row in reversed(range(tied)):
            value = -rest[now[row]]
            found[found.size - tied + row] = value
            rest[before[row]] -= value
    return found
