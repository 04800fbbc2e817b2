"""Chain of rewrites from a stated problem to its core.

    stated: x, u, p, s   ->   core: (x, states of each rewrite), u, (known p, t0),
                                     (the model's s, tau, other s)

In the core all decisions besides the controls are states with a free start, which
search, NLP and verification can handle. The states of the stated problem come first and
keep their names and units; a rewrite may subtract a number from them (counted_from.py).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.common.limits import numbers_of
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.guesses import given_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.decided import Decided
from swarmstart.ocp.statement.rewrites.delay import TransportDelay
from swarmstart.ocp.statement.rewrites.end_time import END_TIME, EndTime
from swarmstart.ocp.statement.rewrites.linear_controls import LinearControls
from swarmstart.ocp.statement.rewrites.minimised import Minimised
from swarmstart.ocp.statement.rewrites.periodic import Periodic
from swarmstart.ocp.statement.rewrites.previous import Previous
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite
from swarmstart.ocp.statement.rewrites.risk_costs import RiskCosts
from swarmstart.ocp.statement.rewrites.time import Time

REWRITES: tuple[Rewrite, ...] = (
    Minimised(),
    Time(),
    EndTime(),
    Decided(),
    Periodic(),
    LinearControls(),
    Previous(),
    RiskCosts(),
)
"""Rewrites of every problem, in their order; its own features come after the first."""
FEATURES = {feature.key: feature for feature in (TransportDelay,)}
"""Key of a control in YAML -> the feature, made from {control: value}."""


@dataclass(frozen=True, slots=True, eq=False)
class _Link:
    """One applied rewrite, between the problems before and after it."""

    rewrite: Rewrite
    before: OptimalControlProblem
    after: OptimalControlProblem

    @property
    def places(self) -> list[int]:
        """Indices of the states that the rewrite appended."""
        return list(range(self.before.model.nx, self.after.model.nx))

    def along(self, x0: Array, controls: Array, at: Array) -> Array:
        """Return values, over the horizon, of the states that the rewrite appended.

        Args:
            x0: Initial state of the core.
            controls: Controls of the rewritten problem (core), shape (nu, N).
            at: Times, in intervals since the start, shape (n,).

        Returns:
            Shape (number of appended states, n).
        """
        return self.rewrite.along(self.before, x0[self.places], controls, at)


@dataclass(frozen=True, eq=False)
class Lowered:
    """A stated problem with its core, the problem after all rewrites.

    Attributes:
        stated: The problem as the user stated it.
        links: The rewrites that apply to it, in order.
    """

    stated: OptimalControlProblem
    links: tuple[_Link, ...]

    @property
    def core(self) -> OptimalControlProblem:
        """The problem after the last rewrite."""
        return self.links[-1].after if self.links else self.stated

    @cached_property
    def origin(self) -> Array:
        """The number that is subtracted from each state of the core, shape (nx,)."""
        found = np.zeros(self.core.model.nx)
        for link in self.links:
            found[: link.before.model.nx] += link.rewrite.origin(link.before)
        return found

    def as_stated(self, states: Array) -> Array:
        """Return states of the core as stated, with the subtracted numbers added again.

        Args:
            states: Shape (nx,) or (nx, n).

        Returns:
            The same shape; the states themselves if nothing is subtracted.
        """
        if not self.origin.any():
            return states
        return states + self.origin.reshape((-1,) + (1,) * (states.ndim - 1))

    @property
    def known_parameters(self) -> list[int]:
        """Indices of the model's parameters that are not decided."""
        names = symbol_names(self.stated.model.parameters)
        return [i for i, name in enumerate(names) if name not in self.stated.decided]

    @cached_property
    def places(self) -> dict[str, list[int]]:
        """Indices of the core's states, by the role of the rewrite that appended them.

        The entry "states" has the states of the stated problem. A free end time is not
        in the entry "decided" of the decided parameters, but has an entry of its own.
        """
        roles = [END_TIME, *[rewrite.role for rewrite in REWRITES]]
        found: dict[str, list[int]] = {role: [] for role in ("states", *roles)}
        found["states"] = list(range(self.stated.model.nx))
        for link in self.links:
            found.setdefault(link.rewrite.role, []).extend(link.places)
        if isinstance(self.stated.horizon, Free):
            found[END_TIME], found["decided"] = (
                found["decided"][:1],
                found["decided"][1:],
            )
        return found

    @property
    def time_row(self) -> int | None:
        """Row of tau, the scaled time, in the core's signals; None if it has none."""
        rows = [k.before.model.ns for k in self.links if isinstance(k.rewrite, Time)]
        return rows[0] if rows else None

    def end_time(self, x0: Array) -> float:
        """Return the length of an answer's horizon [s].

        Args:
            x0: Initial state of the rewritten problem (core), which holds a free end
                time.
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
            previous: Controls of the interval before, shape (nu,), or of several
                intervals, the last one last, shape (nu, m); None: the allowed value
                nearest to zero.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a number is
                missing.
        """
        state = numbers_of("x0", x0).ravel()
        if self.stated.risk is not None:
            state = self.stated.risk.start(state, self.stated.model.nx)
        if state.size != self.stated.model.nx:
            raise InvalidProblemError(
                f"x0 must have shape ({self.stated.model.nx},), got {np.shape(x0)}"
            )
        for link in self.links:
            more = link.rewrite.start(link.before, state, previous)
            state = state - link.rewrite.origin(link.before)
            state = np.concatenate([state, more])
        state = state.copy()
        for one in self.core.free_starts:
            guess = state[one.states[0]]
            value = one.value.first if np.isnan(guess) else guess
            state[list(one.states)] = np.clip(value, one.value.lower, one.value.upper)
        return state

    def with_decided(self, x0: Array, guesses: Mapping[str, float]) -> Array:
        """Return the core's initial state with guesses for its decisions, in bounds.

        Args:
            x0: Initial state of the core; copied.
            guesses: Name of a decided state of the core -> its guess, as the user
                states it, with nothing subtracted. Other names are ignored.
        """
        state, names = x0.copy(), self.core.model.state_names
        for one in self.core.free_starts:
            place = one.states[0]
            guess = guesses.get(names[place])
            if guess is not None:
                own = guess - self.origin[place]
                value = np.clip(own, one.value.lower, one.value.upper)
                state[list(one.states)] = value
        return state

    def guess(self, x0: Array, controls: Array) -> tuple[Array, Array]:
        """Return the core's initial state and controls from a guess of the controls.

        Args:
            x0: Initial state of the core; not changed.
            controls: Guess as the problem states it: held controls, shape (nu, N), or
                knots, shape (nu, N + 1).

        Raises:
            InvalidProblemError: If the shape is not the problem's, or a value is not
                finite.
        """
        state = x0.copy()
        for link in self.links:
            more, controls = link.rewrite.guess(
                link.before, state[link.places], controls
            )
            state[link.places] = more
        return state, given_controls(self.core, controls)

    def knots(self, controls: Array, x0: Array) -> Array:
        """Return controls as the problem states them: held ones, or knots.

        Args:
            controls: Controls of the rewritten problem (core), shape (nu, N).
            x0: Initial state of the core.

        Returns:
            Shape (nu, N), or (nu, N + 1) for linear controls.
        """
        for link in reversed(self.links):
            controls = link.rewrite.controls(x0[link.places], controls)
        return controls

    def acting(self, controls: Array, x0: Array) -> Array | None:
        """Return the controls that the model's equations receive, such as delayed ones.

        Args:
            controls: Controls of the rewritten problem (core), shape (nu, N).
            x0: Initial state of the core.

        Returns:
            Shape (nu, N); None if the equations receive `controls` themselves.
        """
        if all(type(link.rewrite).acting is Rewrite.acting for link in self.links):
            return None
        for link in reversed(self.links):
            controls = link.rewrite.acting(link.before, x0[link.places], controls)
        return controls

    def along(self, x0: Array, controls: Array, at: Array) -> Array:
        """Return the states that the core adds, over the horizon.

        Args:
            x0: Initial state of the core.
            controls: Controls of the rewritten problem (core), shape (nu, N).
            at: Times, in intervals since the start, shape (n,).

        Returns:
            Shape (the core's nx - nx, n). Decisions, accrued costs, and states that
            follow from signals have their initial values at all times; `signalled` sets
            the states that follow from signals.
        """
        rows = [link.along(x0, controls, at) for link in self.links]
        return np.vstack([np.empty((0, at.size)), *rows])

    def signalled(self, states: Array, signals: Array, at: Array) -> Array:
        """Return states of the core in which those that follow from signals are set.

        Args:
            states: Shape (the core's nx, n); not changed.
            signals: The core's signals at its nodes, shape (ns, nodes).
            at: Times, in intervals since the first node, shape (n,).
        """
        found = states.copy()
        for link in self.links:
            rows = link.rewrite.signalled(link.before, signals, at)
            if rows is not None:
                found[link.places] = rows
        return found

    def states(self, states: Array, controls: Array, x0: Array) -> Array:
        """Return the core's states at its nodes.

        Args:
            states: States of the stated problem, shape (nx, nodes), with or without
                those that the core adds.
            controls: Controls of the rewritten problem (core), shape (nu, N).
            x0: Initial state of the core.
        """
        given = np.asarray(states, dtype=np.float64)
        rows = given - self.origin[: len(given), None]
        at = np.arange(rows.shape[1]) / self.core.checks
        if rows.shape[0] != self.core.model.nx:
            return np.vstack([rows, self.along(x0, controls, at)])
        found = rows.copy()
        for link in self._remembering:
            found[link.places] = link.along(x0, controls, at)
        return found

    def after(self, start: Array, x0: Array, controls: Array) -> Array:
        """Return the initial state of the next plan, one interval after a plan's start.

        States that remember controls, such as the previous ones, get the values that
        the plan gives them after its first interval.

        Args:
            start: Initial state of the core for the next plan, in which these states
                are not set yet; copied.
            x0: Initial state of the core from which the plan was made.
            controls: Controls of the plan, shape (nu, N).
        """
        found, end = start.copy(), np.ones(1)
        for link in self._remembering:
            found[link.places] = link.along(x0, controls, end)[:, 0]
        return found

    @property
    def _remembering(self) -> Sequence[_Link]:
        return [link for link in self.links if link.rewrite.is_remembered]

    def known(
        self, parameters: ArrayLike, signals: ArrayLike, time: float
    ) -> tuple[ArrayLike, ArrayLike]:
        """Return the core's parameters and signals at its nodes.

        Args:
            parameters: Values of the parameters that are not decided, in the model's
                order; or the parameters of the core, which are returned unchanged.
            signals: Signals of the stated problem at the nodes.
            time: Time at the start of the horizon [s].

        Raises:
            InvalidProblemError: If the shape of the signals is not the problem's.
        """
        for link in self.links:
            parameters, signals, time = link.rewrite.known(
                link.before, parameters, signals, time
            )
        return parameters, signals


def lowered(stated: OptimalControlProblem) -> Lowered:
    """Return a problem with its core; they are the same if no rewrite applies.

    Raises:
        InvalidProblemError: If features of the problem do not go together.
    """
    if isinstance(stated.horizon, Free) and END_TIME in symbol_names(
        stated.model.parameters
    ):
        raise InvalidProblemError(
            f"a parameter must not be named {END_TIME!r} if the end time is decided"
        )
    links: list[_Link] = []
    first, *rest = REWRITES
    # Else the features would be applied again to a core that is taken as a statement.
    problem = replace(stated, features=()) if stated.features else stated
    for rewrite in (first, *stated.features, *rest):
        if not isinstance(rewrite, Rewrite):
            raise InvalidProblemError(f"a feature must be a Rewrite, got {rewrite!r}")
        if rewrite.accepts(problem):
            after = rewrite.apply(problem)
            links.append(_Link(rewrite, problem, after))
            problem = after
    return Lowered(stated, tuple(links))


def has_decisions(stated: OptimalControlProblem) -> bool:
    """Return whether a problem leaves anything open: controls, or `Free` numbers."""
    return bool(stated.model.nu or lowered(stated).core.free_starts)
