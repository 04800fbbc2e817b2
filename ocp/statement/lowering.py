"""Conversion of a stated problem, and of guesses, to its core.

In the core all decisions are states; it is described in core_problem.py. Maximised
costs are multiplied by -1.

A decision is then a free start of one of these states, which search, NLP and
verification can handle. The states of the stated problem come first and keep their
names, bounds and units.

    stated: x, u, p, s   ->   core: (x, T, decided p, copies, previous u, u as it is and
                                     its knot, members' costs, t, e, r of risk.py), u,
                                    (known p, t0), (the model's s, tau, other s)

Guesses of a control sequence, shape (nu, N), are zero, the middle of the bounds, a
user's own within the bounds, or an earlier plan shifted by one interval.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.common.limits import numbers_of
from swarmstart.ocp.statement.control_shape import split_knots
from swarmstart.ocp.statement.core_problem import END_TIME, core_of, risk_states
from swarmstart.ocp.statement.decisions import Free, whole
from swarmstart.ocp.statement.problem import OptimalControlProblem

_ROUNDING = 1e-9
"""Relative rounding of a control at its bound."""


@dataclass(frozen=True, eq=False)
class Lowered:
    """A stated problem with its core.

    Attributes:
        stated: The problem as the user stated it.
        core: The equivalent problem, minimised, without free end time, decided
            parameters, periodic states, previous controls and time.
    """

    stated: OptimalControlProblem
    core: OptimalControlProblem

    @property
    def known_parameters(self) -> list[int]:
        """Numbers of the model's parameters that are not decided."""
        names = symbol_names(self.stated.model.parameters)
        return [i for i, name in enumerate(names) if name not in self.stated.decided]

    @cached_property
    def places(self) -> dict[str, list[int]]:
        """Numbers of the core's states, by their role."""
        knots = self.stated.has_knots
        sizes = {
            "states": self.stated.model.nx,
            END_TIME: int(isinstance(self.stated.horizon, Free)),
            "decided": len(self.stated.decided),
            "copies": len(self.stated.periodic),
            "previous": 0 if knots else int(self.stated.previous.numel()),
            "knots": 2 * self.stated.model.nu if knots else 0,
            "risk": risk_states(self.stated),
        }
        ends = np.cumsum([0, *sizes.values()]).tolist()
        return {
            role: list(range(first, last))
            for role, first, last in zip(sizes, ends, ends[1:], strict=False)
        }

    def end_time(self, x0: Array) -> float:
        """Return the length of an answer's horizon [s].

        Args:
            x0: Initial state of the core.
        """
        place = self.places[END_TIME]
        return float(x0[place[0]]) if place else self.stated.length

    def decided(self, x0: Array) -> dict[str, float]:
        """Return the decided parameters and end time of an answer, by name."""
        end_time = [(END_TIME, float(x0[i])) for i in self.places[END_TIME]]
        return dict(end_time) | self.decided_parameters(x0)

    def decided_parameters(self, x0: Array) -> dict[str, float]:
        """Return the decided parameters of an answer, by name."""
        places = self.places["decided"]
        return {
            name: float(x0[i])
            for name, i in zip(self.stated.decided, places, strict=True)
        }

    def start(self, x0: ArrayLike, previous: ArrayLike | None = None) -> Array:
        """Return the core's initial state, with guesses for the decisions.

        Args:
            x0: Initial state, shape (nx,); NaN for a decided entry without a guess. For
                an ensemble, the state of one member is used for all.
            previous: Control of the interval before, shape (nu,); None: the allowed
                value nearest to zero.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a number is
                missing.
        """
        given = numbers_of("x0", x0).ravel()
        if self.stated.risk is not None:
            given = self.stated.risk.start(given, self.stated.model.nx)
        if given.size != self.stated.model.nx:
            raise InvalidProblemError(
                f"x0 must have shape ({self.stated.model.nx},), got {np.shape(x0)}"
            )
        place = self.places
        state = np.full(self.core.model.nx, np.nan)
        # Costs accrue from 0.
        state[place["states"]], state[place["risk"]] = given, 0.0
        if place["previous"]:
            state[place["previous"]] = self._before(previous)
        if place["knots"]:
            # The control itself begins at its first knot.
            state[place["knots"]] = np.tile(self._first_knot(previous), 2)
        for copy, name in zip(place["copies"], self.stated.periodic, strict=True):
            state[copy] = given[self.stated.model.state_names.index(name)]
        for one in self.core.free_starts:
            guess = state[one.states[0]]
            value = one.value.first if np.isnan(guess) else guess
            state[list(one.states)] = np.clip(value, one.value.lower, one.value.upper)
        return state

    def with_decided(self, x0: Array, guesses: Mapping[str, float]) -> Array:
        """Return the core's initial state with guesses for its decisions, in bounds.

        Args:
            x0: Initial state of the core; copied.
            guesses: Guesses by the name of the core's state; other names are ignored.
        """
        state, names = x0.copy(), self.core.model.state_names
        for one in self.core.free_starts:
            guess = guesses.get(names[one.states[0]])
            if guess is not None:
                value = np.clip(guess, one.value.lower, one.value.upper)
                state[list(one.states)] = value
        return state

    def _before(self, previous: ArrayLike | None) -> Array:
        """Return the controls before the first interval, shape (nu,)."""
        if previous is None:
            return zero_controls(self.stated)[:, 0]
        given, nu = numbers_of("previous", previous).ravel(), self.stated.model.nu
        if given.size and given.size == self.stated.flown_controls:
            # A plant has the controls of one member, and all members begin with them.
            given = np.tile(given, nu // given.size)
        return _sized("previous", given, nu)

    def _first_knot(self, previous: ArrayLike | None) -> Array:
        """Return the first knots, or a guess of those that are decided, in bounds."""
        found, (lower, upper) = self._before(previous), self.stated.control_limits
        within = np.clip(found, lower, upper)
        room = _ROUNDING * np.maximum(np.abs(found), np.abs(within))
        is_given = self.stated.control_shape == "continuous"
        if is_given and (np.abs(found - within) > room).any():
            raise InvalidProblemError(
                "continuous controls begin at the previous ones, which must be within "
                f"the bounds {lower} and {upper}, got {found}"
            )
        return within

    def knots(self, controls: Array, x0: Array) -> Array:
        """Return controls as the problem states them: held ones, or knots.

        Args:
            controls: Controls of the core, shape (nu, N).
            x0: Initial state of the core.

        Returns:
            Shape (nu, N), or (nu, N + 1) for linear controls.
        """
        place = self.places["knots"]
        if not place:
            return controls
        return np.hstack([x0[place[: controls.shape[0]], None], controls])

    def with_first_knot(self, x0: Array, knots: Array) -> Array:
        """Return the core's initial state with a guess of the first knot, in bounds.

        Args:
            x0: Initial state of the core; copied.
            knots: Guess of the controls, shape (nu, N + 1) or (nu, N).
        """
        state, problem = x0.copy(), self.core
        if self.stated.control_shape == "linear":
            given = split_knots(knots, problem.intervals)[0]
            lower, upper = problem.control_limits
            state[self.places["knots"]] = np.tile(np.clip(given, lower, upper), 2)
        return state

    def with_knots(self, states: Array, controls: Array, x0: Array) -> Array:
        """Return the core's states at the nodes, including those of linear controls.

        Args:
            states: States of the core, shape (nx, nodes); copied.
            controls: Controls of the core, shape (nu, N).
            x0: Initial state of the core.
        """
        found, knots, N = states.copy(), self.knots(controls, x0), controls.shape[1]
        part = np.arange(states.shape[1]) / self.core.checks
        now = [np.interp(part, np.arange(N + 1), row) for row in knots]
        first = knots[:, part.astype(int)]
        found[self.places["knots"]] = np.vstack([np.empty((0, part.size)), *now, first])
        return found

    def states(self, states: Array, x0: Array) -> Array:
        """Return the core's states at the nodes.

        Args:
            states: States of the stated problem, shape (nx, nodes); states of the core
                are returned unchanged.
            x0: The core's initial state.
        """
        rows = np.asarray(states, dtype=np.float64)
        if rows.shape[0] == self.core.model.nx:
            return rows
        # As a guess, the states that the core adds stay at their start.
        more = np.repeat(x0[rows.shape[0] :, None], rows.shape[1], axis=1)
        return np.vstack([rows, more])

    def parameters(self, values: ArrayLike, time: float) -> Array:
        """Return the core's parameters.

        Args:
            values: Values of the parameters that are not decided, in the model's order.
            time: At the start of the horizon [s].
        """
        given = np.asarray(values)
        # If there is one more, the values are already those of the core.
        if self.stated.model.time.numel() and given.size == len(self.known_parameters):
            return np.append(given, time)
        return given

    def signals(self, values: ArrayLike) -> Array:
        """Return the core's signals at the nodes from those of the stated problem.

        Raises:
            InvalidProblemError: If the shape is not the problem's.
        """
        given = np.asarray(values)
        nodes = self.core.nodes
        if not self.stated.model.time.numel():
            return given
        tau, own = np.linspace(0.0, 1.0, nodes)[None, :], self.stated.model.ns
        rows = given if given.size else np.empty((0, nodes))
        if rows.shape != (self.stated.ns, nodes):
            raise InvalidProblemError(
                f"signals must have shape ({self.stated.ns}, {nodes}), got {rows.shape}"
            )
        return np.vstack([rows[:own], tau, rows[own:]])


def lowered(stated: OptimalControlProblem) -> Lowered:
    """Return a problem with its core; they are the same if nothing is converted.

    Raises:
        InvalidProblemError: If a discrete-time model has a free end time.
    """
    given, stated = stated, _minimised(stated)
    free_end = isinstance(stated.horizon, Free)
    remembers = bool(stated.previous.numel())
    if not (
        free_end
        or stated.decided
        or stated.periodic
        or remembers
        or stated.has_knots
        or stated.model.time.numel()
        or risk_states(stated)
    ):
        return Lowered(given, stated)
    if free_end and stated.model.is_discrete:
        raise InvalidProblemError(
            "a discrete-time model has no end time to decide: its horizon must be a "
            "number"
        )
    return Lowered(given, core_of(stated))


def has_decisions(stated: OptimalControlProblem) -> bool:
    """Return whether a problem leaves anything open: controls, or `Free` numbers."""
    return bool(stated.model.nu or lowered(stated).core.free_starts)


def _minimised(stated: OptimalControlProblem) -> OptimalControlProblem:
    """Return an equivalent problem whose costs are minimised."""
    if not stated.maximize:
        return stated
    return replace(
        stated,
        stage_cost=-stated.stage_cost,
        step_cost=-stated.step_cost,
        initial_cost=-stated.initial_cost,
        terminal_cost=-stated.terminal_cost,
        risk=None if stated.risk is None else stated.risk.negated(),
        maximize=False,
    )


def _sized(role: str, values: ArrayLike, size: int) -> Array:
    """Return finite numbers, after a check of their count."""
    found = numbers_of(role, values).ravel()
    if found.size != size or not np.isfinite(found).all():
        raise InvalidProblemError(
            f"{role} must be {size} finite numbers, got {values!r}"
        )
    return found


def zero_controls(problem: OptimalControlProblem) -> Array:
    """Return zero controls, or the bound nearest to zero if zero is not allowed.

    Args:
        problem: The problem.

    Returns:
        Controls, shape (nu, N).
    """
    lower, upper = problem.control_limits
    nearest = np.clip(np.zeros(problem.model.nu), lower, upper)
    return np.repeat(nearest[:, None], problem.intervals, axis=1)


def cold_controls(problem: OptimalControlProblem) -> list[Array]:
    """Return the controls to start from if nothing is known: zero, then the middle."""
    zero, middle = zero_controls(problem), middle_controls(problem)
    return [zero] if np.array_equal(zero, middle) else [zero, middle]


def middle_controls(problem: OptimalControlProblem) -> Array:
    """Return the middle of the controls' bounds; zero controls if one is missing."""
    limits, zero = np.array(problem.control_limits), zero_controls(problem)
    ends = np.isfinite(limits).all(axis=0)
    # Infinite bounds are replaced before the mean, which would be inf - inf.
    middle = np.where(ends, np.where(ends, limits, 0).mean(axis=0), zero[:, 0])
    return np.repeat(middle[:, None], problem.intervals, axis=1)


def bounded_controls(problem: OptimalControlProblem, guess: ArrayLike) -> Array:
    """Return a guess clipped to the bounds, with one value in each block; a copy.

    Args:
        problem: The problem that the guess is for.
        guess: Controls, shape (nu, N), finite; clipped to the bounds. A block gets the
            mean of its intervals.

    Raises:
        InvalidProblemError: If the shape is wrong, or a value is not finite.
    """
    controls = np.array(guess, dtype=np.float64)
    shape = (problem.model.nu, problem.intervals)
    if controls.shape != shape:
        raise InvalidProblemError(
            f"a guess must have shape {shape}, got {controls.shape}"
        )
    if not np.isfinite(controls).all():
        raise InvalidProblemError(f"a guess must be finite, got {controls}")
    lower, upper = problem.control_limits
    within = problem.averaged(controls)
    within = np.clip(within, lower[:, None], upper[:, None])
    return whole(within, problem.integer, problem.control_limits)


Appended = Literal["zero", "last"]
"""End of a shifted plan: zero controls, or the plan's own last ones."""


def shifted_controls(
    problem: OptimalControlProblem, controls: Array, append: Appended = "zero"
) -> Array:
    """Return a plan one interval later: the first interval dropped, one appended.

    Args:
        problem: The problem that the plan was made for.
        controls: The last plan, shape (nu, N); not changed.
        append: The appended controls: "zero" or the plan's "last" ones.

    Returns:
        Controls, shape (nu, N).
    """
    end = controls[:, -1:] if append == "last" else zero_controls(problem)[:, :1]
    return np.hstack([controls[:, 1:], end])
