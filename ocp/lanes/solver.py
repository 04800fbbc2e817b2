"""Many starts of one problem solved at once; built once, for any initial state."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.scan import MOST_INSTRUCTIONS
from swarmstart.ocp.lanes.answers import LaneAnswers, Optimum, distinct_optima
from swarmstart.ocp.lanes.ddp import solve_by_sweeps
from swarmstart.ocp.lanes.posed import Posed, posed
from swarmstart.ocp.lanes.slopes import Slopes, compile_slopes, solve_by_slopes
from swarmstart.ocp.lanes.stages import LaneOptions, stages
from swarmstart.ocp.lanes.sweep_kernels import Sweeps, compile_sweeps
from swarmstart.ocp.nlp.optimality import unmet
from swarmstart.ocp.nlp.transcription import NonlinearProgram, multiple_shooting
from swarmstart.ocp.rollout.fitness import (
    NOTHING,
    Arguments,
    Known,
    shared_arguments,
    started,
)
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.tape import UnknownOperationError

_SWEPT = 8
"""Least ratio of instructions, those of a sweep over an interval by those of the
interval (16 to 80 were seen). Sweeps that must be too long are so refused without
counting, which would take seconds."""
LIGHT, HEAVY = (0.1, 1.0), (10.0, 1e4)
"""Ranges of the first weight of the end rows, log-uniform, each for half of the lanes.
The weight influences more than the guess which optimum a lane finds."""
FORWARD, SLOPED = 2.0, 2.0
"""Roll-outs per iteration by sweeps, and by slopes (forward and back): one full step,
and on average one more that is tried shorter."""
FINISHED = 1e-3
"""Largest sum of what a lane's answer leaves of the first-order conditions, for a cost
of natural size: when polished, it moves by less than a thousandth of that."""
PATH = 1.0
"""First weight of the rows of intervals; with heavier ones lanes zigzag."""


class NoLanesError(Exception):
    """A problem cannot be solved in lanes; the message says why."""


class LaneSolver:
    """Local solves of one problem in lanes.

    Attributes:
        problem: The core of the problem, whose controls and starts are optimised.
    """

    def __init__(
        self,
        problem: OptimalControlProblem | Shooting,
        *,
        options: LaneOptions | None = None,
        constrained_slopes: bool = True,
        program: NonlinearProgram | None = None,
        threads: int = 1,
    ) -> None:
        """Compile the kernels of the lanes.

        Args:
            problem: The problem, or its functions.
            program: Its NLP, if that is built already.
            options: Conditions at which lanes end; None means the defaults.
            constrained_slopes: Whether gradients may replace second-order steps that
                are too long even if there are constraints. Lanes then seldom meet them:
                none of 256 starts of shuttle_reentry did.
            threads: Largest number of threads for the lanes.

        Raises:
            NoLanesError: If the problem has a feature that lanes do not support, or
                machine code cannot be made.
        """
        shooting = shooting_of(problem)
        reason = refused_by_lanes(shooting.problem)
        if reason:
            raise NoLanesError(reason)
        self._program = program or multiple_shooting(shooting)
        self._options = options or LaneOptions()
        try:
            self._step = _step_of(
                self._program, self._options, constrained_slopes, threads
            )
        except (NoCompilerError, UnknownOperationError) as error:
            raise NoLanesError(str(error)) from error
        self.problem = shooting.problem
        self._arguments = Arguments(shooting)
        self._threads = threads
        self._rollout_instructions = shooting.stage_without_path.n_instructions()

    def __call__(
        self,
        x0: ArrayLike,
        controls: Array,
        starts: Array | None = None,
        *,
        known: Known = NOTHING,
        rng: np.random.Generator,
    ) -> LaneAnswers:
        """Return the local optima that starts lead to.

        Args:
            x0: Initial state of the core, shape (nx,).
            controls: Shape (nu, N, n), finite; clipped to the bounds.
            starts: Decisions about the start, shape (ny, n), one row for each of
                `problem.free_starts`; None means those of x0.
            known: Parameters and signals.
            rng: Draws the first weights.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value not finite.
        """
        problem = self.problem
        first = self._first(x0, controls, starts)
        lower, upper = problem.control_limits
        within = np.clip(controls, lower[:, None, None], upper[:, None, None])
        n = within.shape[2]
        light = np.arange(n) % 2 == 0
        exponent = rng.uniform(size=n)
        ends = [low * (high / low) ** exponent for low, high in (LIGHT, HEAVY)]
        weights = np.full(n, PATH), np.where(light, *ends)
        return self.solved(self.posed(x0, known), within, first, weights)

    def solved(
        self, posed: Posed, controls: Array, starts: Array, weights: tuple[Array, Array]
    ) -> LaneAnswers:
        """Return the local optima that starts lead to, with given first weights.

        Args:
            posed: The problem from one initial state.
            controls: Shape (nu, N, n), within their bounds.
            starts: Decisions about the start, (ny, n), within their bounds.
            weights: First weights of the rows of intervals and of the end, each (n,).
        """
        step, options = self._step, self._options
        if isinstance(step, Sweeps):
            return solve_by_sweeps(
                posed, step, controls, starts, weights=weights, options=options,
                threads=self._threads,
            )  # fmt: skip
        return solve_by_slopes(
            posed, step, controls, starts, weights=weights, options=options
        )

    @property
    def method(self) -> str:
        """Method of the lanes: "sweeps" (second order) or "slopes" (gradients)."""
        return "sweeps" if isinstance(self._step, Sweeps) else "slopes"

    @property
    def rollouts_per_iteration(self) -> float:
        """Cost of an iteration of a lane, in rollouts.

        It is the ratio of instructions in the functions of one interval, for a sweep
        (back and forward) or a slope (forward and back), shorter steps included.
        """
        step, rollout = self._step, self._rollout_instructions
        if isinstance(step, Sweeps):
            back, forward = step.backward.code, step.forward.code
            once = back.instructions + FORWARD * forward.instructions
        else:
            once = SLOPED * (step.adjoint.instructions + step.roll.instructions)
        return max(once / rollout, 1.0)

    def posed(self, x0: ArrayLike, known: Known = NOTHING) -> Posed:
        """Return the problem from one initial state, as `solve_lanes` takes it."""
        return posed(self._program, self._arguments, x0, known)

    def optima(
        self,
        answers: LaneAnswers,
        x0: ArrayLike,
        known: Known = NOTHING,
        *,
        stand_for: NDArray[np.int64] | None = None,
    ) -> tuple[Optimum, ...]:
        """Return the answers that are local optima, the cheapest first.

        To first order: the conditions hold up to `FINISHED`, in the NLP's numbers.

        Args:
            answers: Answers of lanes.
            x0: Initial state of the core, shape (nx,).
            known: Parameters and signals.
            stand_for: As `distinct_optima` takes it.
        """
        problem, program = self.problem, self._program
        state, parameters, flat = shared_arguments(problem, x0, known)
        sizes = self._arguments.sizes(x0, known)
        limits, scale = program.limits(sizes), sizes.states[:, None]

        def finished(lane: int) -> bool:
            start = started(problem, state, answers.starts[:, lane])
            q = program.arguments(start, parameters, flat, sizes)
            states = answers.states[:, :, lane] * scale
            w = program.variables(answers.controls[:, :, lane], states, sizes)
            w = program.with_slacks(w, q, limits)
            return unmet(program, w, q, limits) <= FINISHED

        found = distinct_optima(answers, stand_for=stand_for, finished=finished)
        return tuple(replace(one, states=one.states * scale) for one in found)

    def _first(self, x0: ArrayLike, controls: Array, starts: Array | None) -> Array:
        """Return the decisions about the start, clipped to their bounds, (ny, n)."""
        problem, decided = self.problem, self.problem.free_starts
        shape = (problem.model.nu, problem.intervals)
        if controls.ndim != 3 or controls.shape[:2] != shape:  # noqa: PLR2004
            raise InvalidProblemError(
                f"controls must have shape ({shape[0]}, {shape[1]}, n), "
                f"got {controls.shape}"
            )
        n = controls.shape[2]
        if starts is None:
            state = np.asarray(x0, dtype=np.float64).ravel()
            one = np.array([state[one.states[0]] for one in decided])
            starts = np.repeat(one[:, None], n, axis=1)
        if starts.shape != (len(decided), n):
            raise InvalidProblemError(
                f"starts must have shape ({len(decided)}, {n}), got {starts.shape}"
            )
        if not (np.isfinite(controls).all() and np.isfinite(starts).all()):
            raise InvalidProblemError("controls and starts must be finite")
        lower, upper = (
            np.array([getattr(one.value, side) for one in decided])[:, None]
            for side in ("lower", "upper")
        )
        return np.asarray(np.clip(starts, lower, upper))


def _step_of(
    program: NonlinearProgram,
    options: LaneOptions,
    constrained_slopes: bool,
    threads: int,
) -> Sweeps | Slopes:
    """Return the machine code of sweeps; of slopes if sweeps would be too long."""
    problem, interval = program.problem, program.parts.interval.values
    rows = [one.rows.numel() for one in stages(program) if one is not None]
    sweeps_alone = bool(sum(rows)) and not constrained_slopes
    least = _SWEPT * interval.n_instructions()
    if sweeps_alone and least > MOST_INSTRUCTIONS:
        raise NoLanesError(
            "second-order steps are too long: expected at most "
            f"{MOST_INSTRUCTIONS // _SWEPT} instructions in an interval, found "
            f"{interval.n_instructions()}"
        )
    try:
        return compile_sweeps(program, options)
    except NoCompilerError as error:
        if sweeps_alone:
            raise NoLanesError(f"second-order steps are too long: {error}") from error
        starts = [(one.value.lower, one.value.upper) for one in problem.free_starts]
        limits = (*problem.control_limits, np.array(starts))
        # The descent by gradients needs bounds on both sides.
        if not all(np.isfinite(part).all() for part in limits):
            raise
        return compile_slopes(program, options, threads=threads)


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


def random_starts(
    problem: OptimalControlProblem,
    n: int,
    rng: np.random.Generator,
    *,
    limits: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Return smooth random controls (nu, N, n) and starts (ny, n).

    Controls are piecewise linear between random values at knots: 6 knots for one half
    of the individuals, 12 for the other. They lie around the middle of the bounds, with
    an amplitude from a tenth to all of their half width: large controls lead to many
    optima, most of them bad. Without bounds, controls and starts lie in [-1, 1].

    Args:
        problem: A core.
        n: Number of starts.
        rng: Source of all randomness.
        limits: Lower and upper bounds that the controls are drawn in, each (nu,); None
            means the problem's own.
    """
    N = problem.intervals
    lower, upper = (
        np.where(np.isfinite(side), side, other)
        for side, other in zip(
            limits or problem.control_limits, (-1.0, 1.0), strict=True
        )
    )
    controls = np.empty((lower.size, N, n))
    for first, knots in enumerate((6, 12)):
        # A view of every second individual, which is written below.
        columns, count = controls[:, :, first::2], max(2, min(knots, N))
        places = np.linspace(0, count - 1, N)
        left = np.minimum(places.astype(int), count - 2)
        values = rng.uniform(-1, 1, (lower.size, count, columns.shape[2]))
        part = (places - left)[None, :, None]
        shape = (1 - part) * values[:, left] + part * values[:, left + 1]
        reach = rng.uniform(0.1, 1.0, columns.shape[2])
        middle, half = ((upper + sign * lower) / 2 for sign in (1, -1))
        columns[...] = middle[:, None, None] + half[:, None, None] * reach * shape
    ends = [one.value for one in problem.free_starts]
    starts = np.empty((len(ends), n))
    for row, value in zip(starts, ends, strict=True):
        low = value.lower if np.isfinite(value.lower) else min(-1.0, value.upper)
        high = value.upper if np.isfinite(value.upper) else max(1.0, low)
        row[:] = rng.uniform(low, high, n)
    return controls, starts
