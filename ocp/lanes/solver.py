"""Many starts of one problem solved at once; built once, for any initial state."""

from dataclasses import fields, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.lanes.answers import LaneAnswers, Optimum, distinct_optima, reached
from swarmstart.ocp.lanes.interior import MOST, InteriorLanes
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.steps import are_short, is_divisible, stepwise
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.rollout.fitness import NOTHING, Known
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import OptimalControlProblem

RHO = 100.0
"""First price of broken rows. With 1, lanes from random controls leave the equations of
motion and then end infeasible, or in one optimum: of 128 on a way among four discs in 7
s, 56 are feasible and 1 is the best; with 100, 126 and 36 (10: 97 and 24; 1000: 96 and
37). On eight shipped problems 1, 10 and 100 lead to the same optima as often."""
_LONGEST = 30_000
"""Largest number of instructions of an interval's part of a kernel. LLVM takes 7 s for
10,000, and 2 minutes for 39,000, for which the first answer would have to wait. A
longer interval is divided into its steps (steps.py)."""
STEPS = 1.5
"""Sweeps per iteration: 1.04 to 1.9 were seen on seven problems. As many trials, which
are shorter, are assumed."""


class LaneSolver:
    """Local solves of one problem in lanes.

    Attributes:
        problem: The problem after all rewrites (core); its controls and starts are
            optimised.
    """

    def __init__(
        self,
        problem: OptimalControlProblem | Shooting,
        *,
        program: NonlinearProgram | None = None,
        threads: int = 1,
        most: int = MOST,
    ) -> None:
        """Compile the kernels of the lanes.

        Args:
            problem: The problem, or its functions.
            program: NLP of the problem, if it is built already.
            threads: Largest number of threads for the lanes.
            most: Largest number of steps of a lane.

        Raises:
            NoLanesError: If the problem has a feature that lanes do not support, or
                machine code cannot be made.
        """
        shooting = shooting_of(problem)
        self.problem, self._steps = shooting.problem, None
        made = partial(InteriorLanes, most=most, longest=_LONGEST)
        try:
            self._lanes = made(shooting, program=program)
            self._kernels = self._lanes.kernels()
        except NoLanesError:
            if not (is_divisible(self.problem) and are_short(shooting, _LONGEST)):
                raise
            self._steps = stepwise(self.problem)
            shooting = shooting_of(self._steps.problem)
            self._lanes = made(shooting)
            self._kernels = self._lanes.kernels()
        self._threads, self._most = threads, most
        self._rollout_instructions = shooting.stage_without_path.n_instructions()

    def __call__(
        self,
        x0: ArrayLike,
        controls: Array,
        starts: Array | None = None,
        states: Array | None = None,
        *,
        known: Known = NOTHING,
    ) -> LaneAnswers:
        """Return the local optima that starts lead to.

        Args:
            x0: Initial state of the rewritten problem (core), shape (nx,).
            controls: Controls, shape (nu, N, n), finite; moved inside the bounds.
            starts: Decisions about the start, shape (ny, n), one row for each of
                `problem.free_starts`; None means those of x0.
            states: Guess of the states between intervals, shape (nx, N + 1, n); None:
                those that the controls lead to, and, if a lane then ends with broken
                constraints, states that stay at the initial one.
            known: Values of the parameters and signals.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value not finite.
        """
        first, steps = self._first(x0, controls, starts), self._steps
        if steps is None:
            return self._solved(x0, controls, first, states, known)
        found = self._solved(
            steps.x0(x0),
            steps.controls(controls),
            steps.starts(controls, first),
            None if states is None else steps.states(controls, states),
            steps.known(known),
        )
        return steps.back(found)

    def _solved(
        self,
        x0: ArrayLike,
        controls: Array,
        first: Array,
        states: Array | None,
        known: Known,
    ) -> LaneAnswers:
        """Return the local optima, of the problem that the lanes are made for."""
        instances, common = self._lanes.repeated(x0, known, controls.shape[2])
        solve = partial(self._lanes, common=common, rho=RHO, threads=self._threads)
        found = solve(instances, controls, first, states)
        lost = np.flatnonzero(~reached(found) & (found.iterations < self._most))
        if not lost.size or states is not None:
            return found
        held = np.repeat(instances.x0[:, None, lost], controls.shape[1] + 1, axis=1)
        again = solve(instances.at(lost), controls[:, :, lost], first[:, lost], held)
        return _with(found, lost, again)

    @property
    def rollouts_per_iteration(self) -> float:
        """Cost of an iteration of a lane, in rollouts.

        It is the number of instructions of an iteration divided by that of a rollout,
        each for one interval; at least 1.
        """
        kernels = self._kernels
        each = (kernels.backward, kernels.along, kernels.trial, kernels.keep)
        once = STEPS * sum(kernel.code.instructions for kernel in each)
        return max(once / self._rollout_instructions, 1.0)

    def prepare(self) -> None:
        """Wait for machine code that is still being compiled.

        Raises:
            NoCompilerError: If it cannot be made.
        """
        for kernel in self._kernels:
            # Reading an address waits.
            bool(kernel.code.address)

    def optima(
        self,
        answers: LaneAnswers,
        x0: ArrayLike,
        known: Known = NOTHING,
        *,
        stand_for: NDArray[np.int64] | None = None,
    ) -> tuple[Optimum, ...]:
        """Return the answers that are shown to be local optima, the cheapest first.

        Args:
            answers: Answers of lanes.
            x0: Initial state of the rewritten problem (core), shape (nx,).
            known: Values of the parameters and signals.
            stand_for: Number of answers that each one represents; see
                `distinct_optima`.
        """
        if self._steps is not None:
            x0, known = self._steps.x0(x0), self._steps.known(known)
        scale = self._lanes.sizes(x0, known).states[: self.problem.model.nx, None]
        found = distinct_optima(answers, stand_for=stand_for, shown=True)
        return tuple(replace(one, states=one.states * scale) for one in found)

    def _first(self, x0: ArrayLike, controls: Array, starts: Array | None) -> Array:
        """Return the decisions about the start, (ny, n)."""
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
        return starts


def _with(
    found: LaneAnswers, lanes: NDArray[np.int64], again: LaneAnswers
) -> LaneAnswers:
    """Return answers with those of some lanes replaced, and their iterations added."""
    both = {one.name: np.array(getattr(found, one.name)) for one in fields(LaneAnswers)}
    for name, values in both.items():
        values[..., lanes] = getattr(again, name)
    both["iterations"][lanes] += found.iterations[lanes]
    return LaneAnswers(**both)


def random_starts(
    problem: OptimalControlProblem,
    n: int,
    rng: np.random.Generator,
    *,
    limits: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Return smooth random controls (nu, N, n) and decided starts (ny, n).

    Controls are piecewise linear between random values at knots: 6 knots for one half
    of the individuals, 12 for the other. They lie around the middle of the bounds, with
    an amplitude from a tenth to all of their half width: large controls lead to many
    optima, most of them bad. Without bounds, controls and starts lie in [-1, 1].

    Args:
        problem: A rewritten problem (core).
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
