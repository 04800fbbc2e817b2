"""Decisions besides real-valued controls: end time, parameters, start, whole numbers.

An end time, a parameter or a start is a `Free` with bounds. The core of a problem
(rewrites/chain.py) turns all of them into decisions about the initial state: a
parameter becomes a constant state.

Controls that take whole numbers only need, in

    search      a coordinate that stands for the nearest whole number; the box reaches
                half a unit beyond the bounds, so that all numbers are equally likely
    relaxation  the NLP without the requirement; its optimum is, locally, a lower bound
    rounding    sum-up rounding: whole numbers w_k whose sums stay near those of the
                relaxed r_k,  w_k = nearest to r_k + sum over j < k of (r_j - w_j)
    descent     single numbers changed by one, or a unit moved to the next interval, as
                long as the cost falls

Source: Sager, Bock and Diehl (2012), The integer approximation error in mixed-integer
optimal control, Mathematical Programming 133, for sum-up rounding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.limits import require_number

_Symbolic = TypeVar("_Symbolic", ca.SX, ca.MX)
# Less than a half: the ends of the box must not round beyond the bounds.
_HALF = 0.499999
"""Extension of the box of a search beyond the bounds."""


@dataclass(frozen=True, slots=True)
class Free:
    """A number that is decided, within bounds.

    Attributes:
        lower: Lower bound; -inf for none. A population search needs both bounds.
        upper: Upper bound; inf for none.
        guess: Start value of a polish without a search; None: the middle of the bounds,
            or the allowed value nearest to zero.

    Raises:
        InvalidProblemError: If lower exceeds upper, or the guess is not within them.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> fastest = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        ...     horizon=ss.Free(0.5, 5.0), intervals=10, stage_cost=1,
        ...     bounds=ss.Bounds(controls=(-1, 1)), terminal=[(x[0], 1), (x[1], 0)],
        ... )
        >>> found = ss.solve(fastest, [0, 0], search=None, lanes=0, seed=0)
        >>> round(found.decided["end time"], 3)
        2.0
    """

    lower: float = -np.inf
    upper: float = np.inf
    guess: float | None = None

    def __post_init__(self) -> None:
        """Validate the numbers."""
        for role in ("lower", "upper"):
            value = require_number(f"{role} of a Free", getattr(self, role))
            object.__setattr__(self, role, value)
        if not (self.lower <= self.upper and self.lower < np.inf > -self.upper):
            raise InvalidProblemError(
                f"a Free must have lower <= upper, got {self.lower} and {self.upper}"
            )
        if self.guess is not None:
            guess = require_number("guess of a Free", self.guess)
            if not self.lower <= guess <= self.upper:
                raise InvalidProblemError(
                    f"guess of a Free must be within [{self.lower:g}, {self.upper:g}], "
                    f"got {guess:g}"
                )
            object.__setattr__(self, "guess", guess)

    @property
    def first(self) -> float:
        """The guess, or the default that replaces it."""
        if self.guess is not None:
            return self.guess
        if np.isfinite(self.upper - self.lower):
            # A sum of both may overflow.
            return self.lower + (self.upper - self.lower) / 2
        return float(np.clip(0.0, self.lower, self.upper))


@dataclass(frozen=True, kw_only=True, slots=True)
class FreeStart:
    """One decision about the state at the start.

    Attributes:
        states: Numbers of the states that start at this value, at least one.
        value: Bounds of the value, including those of the states, and its guess.
    """

    states: tuple[int, ...]
    value: Free


def free_starts(
    start: Mapping[str | tuple[str, ...], Free],
    names: Sequence[str],
    limits: tuple[Array, Array],
) -> tuple[FreeStart, ...]:
    """Return the decisions about the start, within the bounds of their states.

    Args:
        start: Names of states, or tuples of names that share one value, with bounds.
        names: Names of all states.
        limits: Lower and upper bounds of the states, each (nx,).

    Raises:
        InvalidProblemError: If a name is unknown or repeated, or the bounds leave no
            value.
    """
    found: list[FreeStart] = []
    for key, value in start.items():
        together = (key,) if isinstance(key, str) else tuple(key)
        unknown = [name for name in together if name not in names]
        if unknown or not together:
            raise InvalidProblemError(
                f"start must name states, one of {', '.join(names)}, got {key!r}"
            )
        if not isinstance(value, Free):
            raise InvalidProblemError(
                f"start of {key!r} must be a swarmstart.Free, got {value!r}"
            )
        states = tuple(names.index(name) for name in together)
        lower = max(value.lower, *(float(limits[0][i]) for i in states))
        upper = min(value.upper, *(float(limits[1][i]) for i in states))
        if not lower <= upper:
            raise InvalidProblemError(
                f"start of {key!r} must leave room between its bounds and those of the "
                f"state, got [{lower:g}, {upper:g}]"
            )
        guess = value.guess
        if guess is not None:
            # The state's bounds may be narrower.
            guess = float(np.clip(guess, lower, upper))
        found.append(FreeStart(states=states, value=Free(lower, upper, guess)))
    every = [i for one in found for i in one.states]
    if len(every) != len(set(every)):
        raise InvalidProblemError(
            f"start must name a state once, got {', '.join(map(str, start))}"
        )
    return tuple(found)


def integer_numbers(
    given: Sequence[int | str],
    names: Sequence[str],
    limits: Mapping[str, tuple[Array, Array] | None],
) -> tuple[int, ...]:
    """Return the numbers of the controls that take whole numbers, in order.

    Args:
        given: Numbers or names of controls.
        names: Names of all controls.
        limits: Pairs of lower and upper bounds of all controls, each (nu,). The keys
            are names of the bounds for messages; None: no such bounds.

    Raises:
        InvalidProblemError: If there is no such control, or its bounds are not whole
            numbers.
    """
    several = [given] if isinstance(given, int | str) else list(given)
    found = set()
    for one in several:
        if isinstance(one, str):
            known = one in names
        else:
            known = one in range(len(names)) and isinstance(one, int | np.integer)
        if isinstance(one, bool) or not known:  # True is the number 1 in Python.
            raise InvalidProblemError(
                f"integer must name controls, some of {', '.join(names)}, or give "
                f"their numbers, got {one!r}"
            )
        found.add(names.index(one) if isinstance(one, str) else int(one))
    for role, sides in limits.items():
        for j in found if sides is not None else ():
            bounds = [float(side[j]) for side in sides or ()]
            if any(np.isfinite(b) and b != np.rint(b) for b in bounds):
                raise InvalidProblemError(
                    f"{role} of {names[j]!r}, which takes whole numbers, must be "
                    f"whole, got {bounds}"
                )
    return tuple(sorted(found))


def whole(
    controls: Array, integer: Sequence[int], limits: tuple[Array, Array]
) -> Array:
    """Return controls rounded to whole numbers if required; a copy.

    Args:
        controls: Shape (nu, N).
        integer: Numbers of the controls that take whole numbers.
        limits: Lower and upper bounds of all controls, each (nu,).
    """
    rounded, rows = controls.copy(), list(integer)
    lower, upper = (side[rows, None] for side in limits)
    # A half is rounded up, as in whole_symbols; np.rint would round it to even.
    rounded[rows] = np.clip(np.floor(controls[rows] + 0.5), lower, upper)
    return rounded


def whole_symbols(
    controls: _Symbolic, integer: Sequence[int], limits: tuple[Array, Array]
) -> _Symbolic:
    """Return controls in symbols, shape (nu, 1), rounded as by `whole`."""
    rows = ca.vertsplit(controls) if integer else []
    for j in integer:
        lower, upper = (float(side[j]) for side in limits)
        rounded = ca.floor(rows[j] + 0.5)
        rounded = ca.fmax(rounded, lower) if np.isfinite(lower) else rounded
        rows[j] = ca.fmin(rounded, upper) if np.isfinite(upper) else rounded
    return ca.vertcat(*rows) if integer else controls


def widened(limits: tuple[Array, Array], integer: Sequence[int]) -> tuple[Array, Array]:
    """Return bounds of a search that make all whole numbers equally likely."""
    lower, upper = (side.copy() for side in limits)
    rows = list(integer)
    lower[rows] -= _HALF
    upper[rows] += _HALF
    return lower, upper


def sum_up_rounded(
    relaxed: Array,
    integer: Sequence[int],
    limits: tuple[Array, Array],
    lengths: Sequence[int],
) -> Array:
    """Return whole-number controls whose sums stay near those of the relaxed ones.

    Args:
        relaxed: Relaxed controls of each block of intervals, shape (nu, blocks).
        integer: Numbers of the controls that take whole numbers.
        limits: Lower and upper bounds of all controls, each (nu,).
        lengths: Lengths of the blocks, in intervals.
    """
    rounded = relaxed.copy()
    for j in integer:
        behind = 0.0  # Sum of relaxed minus rounded controls.
        for k, length in enumerate(lengths):
            behind += relaxed[j, k] * length
            nearest = np.floor(behind / length + 0.5)
            rounded[j, k] = np.clip(nearest, limits[0][j], limits[1][j])
            behind -= rounded[j, k] * length
    return rounded


def neighbours(
    controls: Array, integer: Sequence[int], limits: tuple[Array, Array]
) -> Array:
    """Return all controls, (k, nu, N), that differ from given ones by a small change.

    One whole number is changed by a unit; or a unit is moved between it and
    the number of the next interval. Controls beyond the bounds are left out.
    """
    found = []
    for j in integer:
        for k in range(controls.shape[1]):
            for step in (1.0, -1.0):
                one = controls.copy()
                one[j, k] += step
                found.append(one)
                if k + 1 < controls.shape[1]:
                    both = one.copy()
                    both[j, k + 1] -= step
                    found.append(both)
    moved = np.array(found)
    lower, upper = (side[:, None] for side in limits)
    allowed = ((moved >= lower) & (moved <= upper)).all(axis=(1, 2))
    return np.asarray(moved[allowed])
