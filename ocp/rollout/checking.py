"""Measurement of broken constraints: at the start, along a path, at the end.

An excess over a limit is measured in the units of the user, and relative to the scale
of its row. It is stated with the number of its constraint, and with its time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import STATE_BOUNDS, OptimalControlProblem
from swarmstart.ocp.system.constraints import Constraint
from swarmstart.ocp.system.separation import label


@dataclass(frozen=True, kw_only=True, slots=True)
class Excess:
    """Largest excess of one row of a constraint over its limit.

    Attributes:
        name: Name of the constraint, with the row number if it has several rows.
        amount: Excess over the limit, in the units of the row; infinity if the row is
            not finite there.
        scale: The row's scale.
        time: Time of the excess after the start of the horizon [s].
        constraint: Number of the constraint among path and terminal constraints.
        row: Number of the row in the constraint.
        above: Whether the upper limit is broken, not the lower one.
    """

    name: str
    amount: float
    scale: float
    time: float
    constraint: int
    row: int
    above: bool

    @property
    def relative(self) -> float:
        """Excess relative to the scale."""
        return self.amount / self.scale

    def __str__(self) -> str:
        """Return name, amount, scale and time as part of a sentence."""
        return (
            f"{self.name} is broken by {self.amount:.3g} "
            f"({self.relative:.2g} of its scale {self.scale:.3g}) at {self.time:.4g} s"
        )


class Checker:
    """Measurement of all constraints of one problem; compiled once.

    Attributes:
        path: Rows of the path constraints.
        end: Rows of the terminal constraints.
        free: Mask of the path rows that depend on neither a control nor a decided
            start.
    """

    def __init__(self, problem: OptimalControlProblem | Shooting) -> None:
        """Compile the rows of all constraints.

        Args:
            problem: The problem, or its compiled functions.
        """
        shooting = shooting_of(problem)
        self._problem = problem = shooting.problem
        path, ends = problem.path_constraints, problem.terminal_constraints
        self.path = ConstraintRows(problem, path)
        self.end = ConstraintRows(problem, ends, first=len(path))
        self._controlled = _mask(path, shooting.rows_with_controls)
        self.free = ~(self._controlled | _mask(path, shooting.rows_of_start))

    @property
    def looks_at_start(self) -> bool:
        """True if any path row depends on neither a control nor a decided start."""
        return bool(self.free.any())

    def at_start(
        self, x0: Array, p: Array, s: Array, sizes: Callable[[], Sizes]
    ) -> list[Excess]:
        """Return the rows that an initial state breaks by more than the tolerance.

        Rows that depend on a control are skipped, since a control may still keep them.

        Args:
            x0: Initial state, shape (nx,).
            p: Parameters, shape (np,).
            s: Signals at the start, shape (ns,).
            sizes: Function that returns the natural sizes; called only if a row is
                broken.
        """
        if not self.looks_at_start:
            return []
        excess, above = self._at_starts(x0[:, None], p[:, None], s[:, None])
        if not (excess > 0).any():
            return []
        found = self.path.worst(excess, above, np.zeros(1), sizes())
        return [e for e in found if e.relative > self._problem.tolerance]

    def may_break(self, x0: Array, p: Array, s: Array) -> NDArray[np.bool_]:
        """Return a mask of the initial states that break any row, shape (n,).

        `at_start` needs to be called for these states only.

        Args:
            x0: Initial states, shape (nx, n).
            p: Parameters, shape (np, n).
            s: Signals at the start, shape (ns, n).
        """
        if not self.looks_at_start:
            return np.zeros(x0.shape[1], dtype=np.bool_)
        excess, _ = self._at_starts(x0, p, s)
        return np.asarray((excess > 0).any(axis=0))

    def _at_starts(
        self, x0: Array, p: Array, s: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the excess of each row that no control changes, -inf of others."""
        u = np.zeros((self._problem.model.nu, 1))
        excess, above = self.path.excess(x0, u, p, s)
        excess[~self.free] = -np.inf
        return excess, above

    def along(
        self,
        points: "Points",
        p: Array,
        sizes: Sizes,
        *,
        outside: list[Excess],
        left: "Points | None" = None,
    ) -> list[Excess]:
        """Return the worst excess of each path row, if positive.

        Args:
            points: The points of the path.
            p: Parameters, shape (np,).
            sizes: Natural sizes of states, controls, cost and rows.
            outside: Rows that the start breaks. Such a row counts from the first time
                at which it is kept; from the start on if it is never kept, or if its
                excess grows beyond that at the start.
            left: The state after the last interval's end, if that end changes the
                state. Rows that depend on a control are not checked there.
        """
        excess, above = self.path.excess(
            points.states, points.controls, p, points.signals
        )
        times = points.times
        if left is not None:
            last, side = self.path.excess(left.states, left.controls, p, left.signals)
            last[self._controlled] = -np.inf
            excess, above = np.hstack([excess, last]), np.hstack([above, side])
            times = np.append(times, left.times)
        for start in outside:
            row = self.path.number(start)
            # Some room: an excess that only stays as it is must not count.
            limit = start.amount * (1 + self._problem.path_tolerance)
            bad = excess[row] > self._problem.path_tolerance * start.scale
            if bad.all():  # Never kept, which no later point excuses.
                continue
            first_kept = int(np.argmin(bad))
            if (excess[row, :first_kept] <= limit).all():
                excess[row, :first_kept] = -np.inf
        # No control can keep them at the start; `outside` reports these.
        excess[np.ix_(self.free, times == 0.0)] = -np.inf
        return self.path.worst(excess, above, times, sizes)

    def slack(self, points: "Points", p: Array) -> dict[tuple[int, int], float]:
        """Return the smallest distance of each path row to its limits.

        The keys are (number of the constraint, row in it).

        Args:
            points: The points of the path.
            p: Parameters, shape (np,).
        """
        found, _ = self.path.excess(points.states, points.controls, p, points.signals)
        least = -found.max(axis=1, initial=-np.inf)
        return dict(zip(self.path.places, least.tolist(), strict=True))

    def at_end(
        self, x: Array, p: Array, s: Array, sizes: Sizes, time: float
    ) -> list[Excess]:
        """Return the excess of each terminal row, if positive, at the end time."""
        u = np.zeros((self._problem.model.nu, 1))  # Terminal rows contain no control.
        excess, above = self.end.excess(x[:, None], u, p, s[:, None])
        return self.end.worst(excess, above, np.array([time]), sizes)


def _mask(
    constraints: tuple[Constraint, ...], chosen: tuple[list[int], ...]
) -> NDArray[np.bool_]:
    """Return a mask over all rows, in order: True for the chosen ones."""
    found = [np.empty(0, dtype=bool)]
    for constraint, rows in zip(constraints, chosen, strict=True):
        size = constraint.rows(constraint.expression).lower.size
        found.append(np.isin(np.arange(size), rows))
    return np.concatenate(found)


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points of a path.

    Attributes:
        times: Times of the points, shape (n,) [s].
        states: States at the points, shape (nx, n).
        controls: Controls held at the points, shape (nu, n).
        signals: Signals at the points, shape (ns, n).
    """

    times: Array
    states: Array
    controls: Array
    signals: Array


class ConstraintRows:
    """Rows of some constraints, evaluated at many points in one call.

    Attributes:
        names: Names of the rows.
        lower: Lower limits of the rows, shape (rows, 1).
        upper: Upper limits of the rows, shape (rows, 1).
        places: (number of the constraint, row in it) for each row.
        function: Function (x, u, p, s) -> values of the rows.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        constraints: tuple[Constraint, ...],
        *,
        first: int = 0,
    ) -> None:
        """Compile the rows.

        Args:
            problem: The problem.
            constraints: Path or terminal constraints in the problem's symbols.
            first: Number of the first of these constraints.
        """
        symbols = [*problem.symbols().values()]
        rows = [c.rows(c.expression) for c in constraints]
        values = ca.vertcat(ca.SX(0, 1), *[r.values for r in rows])
        self.function = ca.Function("rows", symbols, [values])
        self.lower = np.concatenate([np.empty(0), *[r.lower for r in rows]])[:, None]
        self.upper = np.concatenate([np.empty(0), *[r.upper for r in rows]])[:, None]
        self.places = [
            (first + number, row)
            for number, r in enumerate(rows)
            for row in range(r.lower.size)
        ]
        self.names = [name for c in constraints for name in _row_names(problem, c)]

    def number(self, excess: Excess) -> int:
        """Return the index of an excess's row among all rows."""
        return self.places.index((excess.constraint, excess.row))

    def values(self, x: Array, u: Array, p: Array, s: Array) -> Array:
        """Return the value of each row, shape (rows, n), at n columns of arguments."""
        if not self.places:
            return np.empty((0, x.shape[1]))
        return np.array(self.function(x, u, p, s))

    def excess(
        self, x: Array, u: Array, p: Array, s: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the excess of each row, and whether the upper limit is the nearer one.

        Both have shape (rows, points). The excess is negative inside the limits, and
        infinity if the row is not a finite number. A row without limits has the excess
        -infinity in any case.

        Args:
            x: States, shape (nx, points).
            u: Controls, shape (nu, points), or (nu, 1) for all.
            p: Parameters of all points, shape (np,), or of each, (np, points).
            s: Signals, shape (ns, points).
        """
        if p.ndim == 1:
            p = np.tile(p[:, None], (1, x.shape[1]))
        values = self.values(x, u, p, s)
        with np.errstate(invalid="ignore"):  # Of rows that are infinite; see `lost`.
            below, above = self.lower - values, values - self.upper
            excess = np.maximum(below, above)
        limited = np.isfinite(self.lower) | np.isfinite(self.upper)
        # A row without limits is not even broken by NaN.
        lost = np.where(limited, np.inf, -np.inf)
        return np.where(np.isfinite(values), excess, lost), above > below

    def worst(
        self, excess: Array, above: NDArray[np.bool_], times: Array, sizes: Sizes
    ) -> list[Excess]:
        """Return the largest excess of each row, if positive, the worst first."""
        if not excess.size:
            return []
        where = np.argmax(excess, axis=1)
        found = [
            Excess(
                name=name,
                amount=float(excess[i, where[i]]),
                scale=float(sizes.rows[place[0]][place[1]]),
                time=float(times[where[i]]),
                constraint=place[0],
                row=place[1],
                above=bool(above[i, where[i]]),
            )
            for i, (name, place) in enumerate(zip(self.names, self.places, strict=True))
            if excess[i, where[i]] > 0
        ]
        return sorted(found, key=lambda e: -e.relative)


def _row_names(problem: OptimalControlProblem, constraint: Constraint) -> list[str]:
    """Return a name for each row of a constraint."""
    name, values = label(constraint), constraint.rows(constraint.expression).values
    rows = int(values.numel())
    if name == STATE_BOUNDS:
        bounded = [problem.model.state_names[i] for i in problem.bounded_states]
        return [f"the bound of state {state}" for state in bounded]
    if rows == 1:
        return [f"'{name}'"]
    if constraint.expression.numel() == rows and constraint.name:
        symbols = [str(constraint.expression[i]) for i in range(rows)]
        return [f"'{name}' ({symbol})" for symbol in symbols]
    return [f"row {row} of '{name}'" for row in range(rows)]
