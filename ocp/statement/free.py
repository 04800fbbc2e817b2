"""Decisions besides the controls: an end time, parameters, a start.

Each is a `Free` with bounds. The core of a problem (lowering.py) turns all of them into
decisions about the initial state: a parameter becomes a constant state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.limits import require_number


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
            return self.lower + (self.upper - self.lower) / 2
        return float(np.clip(0.0, self.lower, self.upper))


@dataclass(frozen=True, kw_only=True, slots=True)
class FreeStart:
    """One decision about the state at the start.

    Attributes:
        states: Numbers of the states that start at it, at least one.
        value: Its bounds, including those of the states, and its guess.
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
            guess = float(np.clip(guess, lower, upper))
        found.append(FreeStart(states=states, value=Free(lower, upper, guess)))
    every = [i for one in found for i in one.states]
    if len(every) != len(set(every)):
        raise InvalidProblemError(
            f"start must name a state once, got {', '.join(map(str, start))}"
        )
    return tuple(found)
