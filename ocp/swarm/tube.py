"""Path of a vehicle of any model along a plan, and the tube that contains it.

The plan's controls come first, then those of the linear law of a certified terminal
set, u = u_ref - K (x - c). If the plan ends in the set about its reference, the centre
c is this reference. Else the set is moved along positions on which no rate depends,
since the same law keeps the vehicle in it at every such place. Its centre c is then the
one at which V = (x - c)' P (x - c) is least at the plan's end.

Under the linear law V decreases from one step to the next, and within a step it grows
by the certificate's factor g at most. Below the level of the certificate's core V need
not decrease, but at the steps it stays below that level. So let V be the value at the
beginning of a step, or the level of the core if that is larger. From this step on the
positions C x stay for ever in a ball about C c,

    |C (x - c)| <= r = sqrt(g V largest eigenvalue of C P^-1 C').

Where the path is computed step by step, the tube of a step is its chord, widened by the
sum of two distances. The first is the largest distance from the chord at m + 1 points
of the integrator. The second is for the path between these points: (dt / m)^2 / 8 times
twice the largest second derivative at these points.

A plant that differs from the model is led back to the states x_k and controls u_k of
the path by u = u_k - K_k (x - x_k). The gains are those of the Riccati recursion, which
begins with P at the plan's end and goes back along the plan (Anderson and Moore,
Optimal control: linear quadratic methods, 1990, 2.4).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.integration.integrators import held_step
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.swarm.swarm import AXES
from swarmstart.ocp.system.model import right_hand_side
from swarmstart.terminal_set import TerminalSet, Weights

CURVED = 2.0
"""Factor of the second derivatives at points, for those between them."""
ROUNDING = 1e-9
"""Relative increase of a ball, more than its rounding."""


class NoRestError(InvalidProblemError):
    """A plan does not end in a set in which the vehicle can stay for ever."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Rest:
    """End of a plan, at which the vehicle can stay for ever.

    Attributes:
        centre: State at which the linear law comes to rest, shape (nx,).
        is_goal: Whether the centre is the terminal set's own reference.
    """

    centre: Array
    is_goal: bool


@dataclass(kw_only=True, slots=True, eq=False)
class Path:
    """Path along a plan, then by the linear law; it is extended when needed.

    Attributes:
        first: Step of the first state.
        ends: Step from which on the linear law acts.
        states: States at steps, each (nx,).
        controls: Controls between them, each (nu,).
        gains: Gains K on the deviation from the state at the beginning of each step,
            each (nu, nx).
        bulges: Largest distances of the path from the chords between successive states
            [m].
        rest: End of the plan.
    """

    first: int
    ends: int
    states: list[Array]
    controls: list[Array] = field(default_factory=list)
    gains: list[Array] = field(default_factory=list)
    bulges: list[float] = field(default_factory=list)
    rest: Rest


class Body:
    """Motion of a vehicle, and the set in which its plans end.

    Attributes:
        rows: Rows of the states that are its position, one to three.
        parameters: Parameters of the model, shape (np,).
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        rows: tuple[int, ...],
        terminal_set: TerminalSet,
        parameters: Array,
    ) -> None:
        """Build the functions of a step.

        Args:
            problem: Planning problem of the vehicle, without rewrites.
            rows: Rows of the states that are its position, one to three.
            terminal_set: Certified set of the vehicle, with the weights of its design.
            parameters: Parameters of the model, shape (np,).

        Raises:
            InvalidProblemError: If the set has no weights.
        """
        self.rows = rows
        self.parameters = parameters
        self._problem, self._set = problem, terminal_set
        self._weights = _weights_of(terminal_set)
        pieces = problem.checks * problem.substeps
        self._piece = problem.dt / pieces
        self._step = held_step(
            problem.model, self._piece, method=problem.integrator
        ).mapaccum("step", pieces)
        self._slopes = _slopes(problem, pieces)
        self._bends = _bends(problem, rows).map(pieces + 1)
        self._free = _free_rows(problem, rows)
        inverse = np.linalg.inv(terminal_set.P)
        self._spread = np.diag(inverse)
        self._reach = float(np.linalg.eigvalsh(inverse[np.ix_(rows, rows)])[-1])
        self._core, self._growth = _levels(terminal_set)

    def position(self, state: Array) -> Array:
        """Return the position at a state, shape (3,) [m]; 0 on axes without a state."""
        place = np.zeros(AXES)
        place[: len(self.rows)] = state[list(self.rows)]
        return place

    def value(self, state: Array, rest: Rest) -> float:
        """Return V = (x - c)' P (x - c) at a state x, c the centre of the rest."""
        return float(self._set.value(state - rest.centre))

    def radius(self, value: float) -> float:
        """Return the radius of the ball in which positions stay for ever [m].

        Args:
            value: Value, as of `value`, at the state from which the linear law acts.
        """
        level = max(value, self._core) * self._growth
        return float(np.sqrt(level * self._reach) * (1.0 + ROUNDING))

    def rest_of(self, state: Array) -> Rest:
        """Return the `Rest` of a vehicle if its plan ends in this state.

        Raises:
            NoRestError: If the state is in no certified set.
        """
        goal = self._set.x_ref
        if self._set.contains(state - goal):
            return Rest(centre=goal, is_goal=True)
        centre, free = goal.copy(), np.array(self._free, dtype=np.int64)
        fixed = np.setdiff1d(np.arange(goal.size), free)
        P, error = self._set.P, state - goal
        moved = np.linalg.solve(
            P[np.ix_(free, free)], P[np.ix_(free, fixed)] @ error[fixed]
        )
        centre[free] = state[free] + moved
        found = Rest(centre=centre, is_goal=False)
        value = self.value(state, found)
        if not value <= self._set.alpha:
            raise NoRestError(
                f"a plan must end in a certified set: e'Pe is {value:.4g} at its end, "
                f"above the proven level {self._set.alpha:.4g}"
            )
        self._require_bounds(found, value)
        return found

    def _require_bounds(self, rest: Rest, value: float) -> None:
        """Raise if the set at another place exceeds a bound of a position."""
        spread = np.sqrt(max(value, self._core) * self._growth * self._spread)
        lower, upper = self._problem.state_limits
        for row in self._free:
            low, high = rest.centre[row] - spread[row], rest.centre[row] + spread[row]
            if not lower[row] <= low <= high <= upper[row]:
                name = self._problem.model.state_names[row]
                raise NoRestError(
                    f"a plan must end in a set within the bounds of {name}, "
                    f"[{lower[row]:g}, {upper[row]:g}]; its set reaches from "
                    f"{low:.4g} to {high:.4g}"
                )

    def path(self, first: int, start: Array, controls: Array) -> Path:
        """Return the path of a plan.

        Args:
            first: Step at which the plan begins.
            start: State there, shape (nx,).
            controls: Controls of the plan, shape (nu, N).

        Raises:
            NoRestError: If the plan ends in no certified set.
        """
        states, bulges = [start], list[float]()
        for u in controls.T:
            end, bulge = self._moved(states[-1], u)
            states.append(end)
            bulges.append(bulge)
        return Path(
            first=first, ends=first + controls.shape[1], states=states,
            controls=list(controls.T),
            gains=self._gains(states, controls), bulges=bulges,
            rest=self.rest_of(states[-1]),
        )  # fmt: skip

    def grow(self, path: Path, steps: int) -> None:
        """Extend a path by the linear law until it has a number of steps."""
        lower, upper = self._problem.control_limits
        while len(path.controls) < steps:
            error = path.states[-1] - path.rest.centre
            law = self._set.u_ref + self._set.feedback(error)
            u = np.clip(law, lower, upper)
            end, bulge = self._moved(path.states[-1], u)
            path.states.append(end)
            path.controls.append(u)
            path.gains.append(self._set.K)
            path.bulges.append(bulge)

    def control(self, path: Path, step: int, state: Array) -> Array:
        """Return the control that follows a path from a measured state, shape (nu,)."""
        number = step - path.first
        self.grow(path, number + 1)
        error = state - path.states[number]
        found = path.controls[number] - path.gains[number] @ error
        return np.clip(found, *self._problem.control_limits)

    def tube(self, path: Path, first: int, pieces: int) -> tuple[Array, Array]:
        """Return samples and bulges of a path from a step on, as `Plans` has them.

        Args:
            path: The path.
            first: Step of the first sample.
            pieces: Number of pieces.

        Returns:
            Samples, shape (pieces + 1, 3), and bulges, shape (pieces + 1,) [m].
        """
        begin = first - path.first
        self.grow(path, begin + pieces)
        last = begin + pieces - 1
        ball = self.radius(self.value(path.states[last], path.rest))
        places = [self.position(x) for x in path.states[begin : last + 1]]
        # From the last state on, path and chord are in the ball.
        bulges = [*path.bulges[begin:last], 2.0 * ball, ball]
        return np.array([*places, self.position(path.rest.centre)]), np.array(bulges)

    def _moved(self, x: Array, u: Array) -> tuple[Array, float]:
        """Return the state after a step, and the distance of its path from the chord.

        A piece of a path with the second derivative a is a h^2 / 8 off its chord.
        """
        found = np.hstack([x[:, None], self._step(x, u, self.parameters).full()])
        places = found[list(self.rows)]
        share = np.linspace(0.0, 1.0, found.shape[1])
        chord = np.outer(places[:, 0], 1.0 - share) + np.outer(places[:, -1], share)
        off = np.linalg.norm(places - chord, axis=0).max()
        bends = np.linalg.norm(self._bends(found, u, self.parameters).full(), axis=0)
        return found[:, -1], float(off + CURVED * bends.max() * self._piece**2 / 8.0)

    def _gains(self, states: list[Array], controls: Array) -> list[Array]:
        """Return the gains of the Riccati recursion along a plan, each (nu, nx)."""
        P, Q, R = self._set.P, self._weights.Q, self._weights.R
        found = list[Array]()
        for x, u in zip(states[-2::-1], controls.T[::-1], strict=True):
            A, B = (part.full() for part in self._slopes(x, u, self.parameters))
            K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
            P = Q + A.T @ P @ (A - B @ K)
            P = (P + P.T) / 2.0
            found.append(K)
        return found[::-1]


def joined(before: Path, made: Path, step: int) -> Path:
    """Return the path that follows `before` from a step on, and later `made`.

    Args:
        before: The path that is followed until `made` begins; it has all states up to
            there.
        made: The path that is followed afterwards.
        step: First step of the result.
    """
    kept = slice(step - before.first, made.first - before.first)
    return Path(
        first=step,
        ends=made.ends,
        states=before.states[kept] + made.states,
        controls=before.controls[kept] + made.controls,
        gains=before.gains[kept] + made.gains,
        bulges=before.bulges[kept] + made.bulges,
        rest=made.rest,
    )


def _weights_of(terminal_set: TerminalSet) -> Weights:
    certificate = terminal_set.certificate
    weights = None if certificate is None else certificate.weights
    if weights is None:
        raise InvalidProblemError(
            "a terminal set of committed plans must have the weights of its design, "
            "as from terminal_set_of"
        )
    return weights


def _levels(terminal_set: TerminalSet) -> tuple[float, float]:
    """Return the level of V that is kept, and the growth of V between samples."""
    certificate = terminal_set.certificate
    if certificate is None or certificate.held is None:
        raise InvalidProblemError(
            "a terminal set of committed plans must be certified for a held input"
        )
    return certificate.core, certificate.growth


def _free_rows(
    problem: OptimalControlProblem, rows: tuple[int, ...]
) -> tuple[int, ...]:
    """Return the rows of a position on which no rate depends."""
    model = problem.model
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    rate = right_hand_side(model)(x, u, ca.SX.sym("p", model.np))
    return tuple(row for row in rows if not ca.depends_on(rate, x[row]))


def _bends(problem: OptimalControlProblem, rows: tuple[int, ...]) -> ca.Function:
    """Return (x, u, p) -> second derivative of the position with u held."""
    model = problem.model
    x, u, p = (
        ca.SX.sym(name, n)
        for name, n in (("x", model.nx), ("u", model.nu), ("p", model.np))
    )
    rate = right_hand_side(model)(x, u, p)
    bend = ca.jtimes(rate[list(rows)], x, rate)
    return ca.Function("bends", [x, u, p], [bend])


def _slopes(problem: OptimalControlProblem, pieces: int) -> ca.Function:
    """Return (x, u, p) -> derivatives of the state after a step by x and u."""
    model = problem.model
    whole = held_step(model, problem.dt, method=problem.integrator, substeps=pieces)
    x, u, p = (
        ca.MX.sym(name, n)
        for name, n in (("x", model.nx), ("u", model.nu), ("p", model.np))
    )
    end = whole(x, u, p)
    return ca.Function("slopes", [x, u, p], [ca.jacobian(end, x), ca.jacobian(end, u)])
