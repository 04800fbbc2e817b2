"""A problem brought to its core: what is decided or remembered becomes a state.

What becomes what is in core_problem.py; maximised costs are taken times -1.

What is decided is then a free start of one of these states, which the search, the NLP
and the verification know. The states of the stated problem come first, and keep their
names, bounds and units.

    stated: x, u, p, s   ->   core: (x, T, decided p, copies, previous u, u as it is and
                                     its knot, members' costs, t, e, r of risk.py), u,
                                    (known p, t0), (the model's s, tau, other s)
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.control_shape import split_knots
from swarmstart.ocp.core_problem import END_TIME, core_of, risk_states
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.expressions import symbol_names
from swarmstart.ocp.free import Free
from swarmstart.ocp.guess import zero_controls
from swarmstart.ocp.limits import numbers_of
from swarmstart.ocp.problem import OptimalControlProblem

Array = NDArray[np.float64]
_ROUNDING = 1e-9
"""Of a control that was flown to a bound."""


@dataclass(frozen=True, eq=False)
class Lowered:
    """A stated problem with its core.

    Attributes:
        stated: The problem as the user states it.
        core: The same, minimised, without free end time, decided parameters, periodic
            states, previous controls and time.
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
        """Numbers of the core's states, by what they are."""
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
        """Return the length of the horizon [s] of an answer.

        Args:
            x0: The core's state at its start.
        """
        place = self.places[END_TIME]
        return float(x0[place[0]]) if place else self.stated.length

    def decided(self, x0: Array) -> dict[str, float]:
        """Return what an answer decides about parameters and end time, by name."""
        end_time = [(END_TIME, float(x0[i])) for i in self.places[END_TIME]]
        return dict(end_time) | self.decided_parameters(x0)

    def decided_parameters(self, x0: Array) -> dict[str, float]:
        """Return what an answer decides about parameters, by name."""
        places = self.places["decided"]
        return {
            name: float(x0[i])
            for name, i in zip(self.stated.decided, places, strict=True)
        }

    def start(self, x0: ArrayLike, previous: ArrayLike | None = None) -> Array:
        """Return the core's initial state, with the guesses of what is decided.

        Args:
            x0: Initial state, shape (nx,); NaN where it is decided and no guess known.
                Of an ensemble, that of a member is one for all.
            previous: Control of the interval before, shape (nu,); None: the nearest to
                zero that is allowed.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a number missing.
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
        state[place["states"]], state[place["risk"]] = given, 0.0
        if place["previous"]:
            state[place["previous"]] = self._before(previous)
        if place["knots"]:
            state[place["knots"]] = np.tile(self._first_knot(previous), 2)
        for copy, name in zip(place["copies"], self.stated.periodic, strict=True):
            state[copy] = given[self.stated.model.state_names.index(name)]
        for one in self.core.free_starts:
            guess = state[one.states[0]]
            value = one.value.first if np.isnan(guess) else guess
            state[list(one.states)] = np.clip(value, one.value.lower, one.value.upper)
        return state

    def with_decided(self, x0: Array, guesses: Mapping[str, float]) -> Array:
        """Return the core's initial state with guesses of what is decided, in bounds.

        Args:
            x0: Initial state of the core; copied.
            guesses: By the name of the core's state; others are ignored.
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
        """Return controls as the problem states them: those held, or the knots.

        Args:
            controls: Of the core, shape (nu, N).
            x0: Initial state of the core.

        Returns:
            Shape (nu, N), or (nu, N + 1) of linear controls.
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
        """Return the core's states at the nodes with those of linear controls.

        Args:
            states: Of the core, shape (nx, nodes); copied.
            controls: Of the core, shape (nu, N).
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
            states: Of the stated problem, shape (nx, nodes); those of the core are
                returned as they are.
            x0: The core's initial state.
        """
        rows = np.asarray(states, dtype=np.float64)
        if rows.shape[0] == self.core.model.nx:
            return rows
        more = np.repeat(x0[rows.shape[0] :, None], rows.shape[1], axis=1)
        return np.vstack([rows, more])

    def parameters(self, values: ArrayLike, time: float) -> Array:
        """Return the core's parameters.

        Args:
            values: Of the parameters that are not decided, in the model's order.
            time: At the start of the horizon [s].
        """
        given = np.asarray(values)
        if self.stated.model.time.numel() and given.size == len(self.known_parameters):
            return np.append(given, time)
        return given

    def signals(self, values: ArrayLike) -> Array:
        """Return the core's signals at the nodes, of those of the stated problem.

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
    """Return a problem with its core, which is the same where nothing is lowered.

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


def _minimised(stated: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem whose costs are minimised."""
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
    """Return finite numbers, as many as there must be."""
    found = numbers_of(role, values).ravel()
    if found.size != size or not np.isfinite(found).all():
        raise InvalidProblemError(
            f"{role} must be {size} finite numbers, got {values!r}"
        )
    return found
