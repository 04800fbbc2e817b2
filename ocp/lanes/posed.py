"""The numbers that all lanes of one solve share, with conversions to and from them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.nlp_assembly import Part, inputs_of
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.rollout.fitness import Arguments, Known, at_nodes, shared_arguments
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.statement.problem import OptimalControlProblem

_Known = tuple[Array, Array, Array, Array]
"""Shared numbers, signals, lower and upper limits of the rows, as kernels take them."""


class NoLanesError(Exception):
    """A problem cannot be solved in lanes; the message says why."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed:
    """A problem with one initial state, in the scaled numbers of its NLP.

    Attributes:
        intervals: Number N of intervals.
        sizes: Sizes that numbers are divided by.
        x0: Initial state, with a guess of its decided entries, shape (nx,).
        tied: Matrix, shape (nx, ny): entry (i, j) is 1 if state i starts at decision j,
            else 0.
        least: Lower bounds of an interval's variables besides its state, the controls
            and the ne excesses over soft constraints, shape (nu + ne,).
        most: Upper bounds, same shape.
        first_least: Lower bounds of the decisions about the start, shape (ny,).
        first_most: Upper bounds, same shape.
        x_least: Lower bounds of states, shape (nx,).
        x_most: Upper bounds, same shape.
        windows: Numbers of the nodes of each interval.
        interval: Known arguments of an interval.
        end: Known arguments of the end.
        begin: Known arguments of the start; None if nothing is decided.
    """

    intervals: int
    sizes: Sizes
    x0: Array
    tied: Array
    least: Array
    most: Array
    first_least: Array
    first_most: Array
    x_least: Array
    x_most: Array
    windows: list[NDArray[np.int64]]
    interval: _Known
    end: _Known
    begin: _Known | None

    @property
    def start_sizes(self) -> Array:
        """Sizes of the decisions about the start, (ny, 1)."""
        firsts = self.tied.argmax(axis=0) if self.tied.size else np.zeros(0, int)
        return np.asarray(self.sizes.states[firsts][:, None])

    @property
    def first_limits(self) -> tuple[Array, Array]:
        """Bounds of the decisions about the start, each (ny, 1)."""
        return self.first_least[:, None], self.first_most[:, None]

    def scaled(self, controls: Array) -> Array:
        """Return controls (nu, N, n) in the form of lanes, (N (nu + ne), n).

        Each interval has ne excesses over soft constraints after its controls; they
        are set to 0.
        """
        nu, N, n = controls.shape
        rows = np.zeros((N, self.least.size, n))
        rows[:, :nu] = np.moveaxis(controls, 1, 0) / self.sizes.controls[:nu, None]
        return rows.reshape(N * self.least.size, n)

    def states(self, inner: Array, end: Array) -> Array:
        """Return states (nx, N + 1, n) from those of intervals and those at the end.

        Those of intervals have shape (N nx, n), those at the end (nx, n).
        """
        rows = inner.reshape(self.intervals, self.x0.size, end.shape[1])
        return np.concatenate([np.moveaxis(rows, 0, 1), end[:, None]], axis=1)

    def controls(self, lanes: Array) -> Array:
        """Return controls (nu, N, n) from the form of lanes, as `scaled` makes it."""
        nu, n = self.sizes.controls.size, lanes.shape[1]
        rows = lanes.reshape(self.intervals, self.least.size, n)[:, :nu]
        return np.moveaxis(rows, 0, 1) * self.sizes.controls[:, None, None]


def posed(
    program: NonlinearProgram,
    arguments: Arguments,
    x0: ArrayLike,
    known: Known,
) -> Posed:
    """Return a problem with one initial state, in the scaled numbers of its NLP.

    Args:
        program: NLP of the problem.
        arguments: Object that computes the sizes from x0 and `known`.
        x0: Initial state, shape (nx,), with a guess of its decided entries.
        known: Values of the parameters and signals.

    Raises:
        InvalidProblemError: If a shape is not the problem's, or a value not finite.
    """
    problem, parts = program.problem, program.parts
    state, parameters, flat = shared_arguments(problem, x0, known)
    sizes = arguments.sizes(x0, known)
    limits = program.limits(sizes)
    q = program.arguments(state, parameters, flat, sizes)
    _, shared, *weights, _ = np.split(q, np.cumsum(parts.argument_sizes(problem)[:-1]))
    signals, checks, N = at_nodes(problem, flat), problem.checks, problem.intervals
    windows = [np.arange(k * checks, (k + 1) * checks + 1) for k in range(N)]
    own = np.concatenate([signals[:, w].ravel(order="F") for w in windows])
    nu, rows = inputs_of(problem), parts.interval.rows
    lower, upper = (side * weights[0] for side in rows[1:3])
    starts = problem.free_starts
    tied = np.zeros((state.size, len(starts)))
    for number, one in enumerate(starts):
        tied[list(one.states), number] = 1.0
    firsts = [one.states[0] for one in starts]
    return Posed(
        intervals=N,
        sizes=sizes,
        x0=state / sizes.states,
        tied=tied,
        least=limits.lbx[:nu],
        most=limits.ubx[:nu],
        first_least=np.array([one.value.lower for one in starts])
        / sizes.states[firsts],
        first_most=np.array([one.value.upper for one in starts]) / sizes.states[firsts],
        x_least=problem.state_limits[0] / sizes.states,
        x_most=problem.state_limits[1] / sizes.states,
        windows=windows,
        interval=(np.concatenate([shared, weights[0]]), own, lower, upper),
        end=_end_known(parts.end, shared, weights[1], signals[:, -1]),
        begin=None
        if parts.begin is None
        else _end_known(parts.begin, shared, weights[2], signals[:, 0]),
    )


def refused_by_lanes(problem: OptimalControlProblem) -> str:
    """Return the reason why lanes cannot solve a problem; empty if they can."""
    reasons = {
        "it has no controls": not problem.model.nu,
        "it has blocks of intervals": bool(problem.blocks),
        "its members share controls for a while": problem.ties_controls,
        "it has whole numbers": bool(problem.integer),
        "its risk needs decisions of the NLP": problem.epigraph is not None,
        "its model is stiff": problem.integrator == "stiff",
        "its polish collocates": problem.collocation is not None,
    }
    return next((reason for reason, is_so in reasons.items() if is_so), "")


def _end_known(part: Part, shared: Array, weights: Array, signals: Array) -> _Known:
    """Return known arguments of the end or start; rows without limits are equations."""
    equations = np.zeros(part.height - weights.size)
    lower, upper = (
        np.concatenate([equations, side * weights]) for side in part.rows[1:3]
    )
    return np.concatenate([shared, weights]), signals, lower, upper
