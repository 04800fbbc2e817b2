"""Long intervals in lanes: an interval for each step of the integrator.

The sweep of a lane has the second derivatives of a whole interval in its machine code,
which takes minutes to make if an interval has many steps. Here each step is an interval
of its own, and what is held over an interval of the problem is a state v:

    x' = f(x, v),   v' = 0 within a step,   v(0) in the bounds of u
    v+ = u where an interval of the problem begins, else v+ = v

The steps and the costs are the problem's own. Path constraints must hold after each
step, whereas the problem requires them at its checks only; so an optimum may cost more.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.posed import refused_by_lanes
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    Appended,
    changed_fields,
    changed_model,
    replaced,
    with_states,
)

_SWEPT = 12
"""Least ratio of instructions, those of a sweep over a step by those of the step (14 to
174 were seen). So a sweep that must be too long is refused before it is built."""
_MOST_STATES = 24
"""Largest number of states and held controls together; a sweep with 32 of them has
71,000 instructions, whatever the model."""


def are_short(shooting: Shooting, longest: int) -> bool:
    """Return whether the sweep over a step may be short enough for machine code.

    Args:
        shooting: Functions of the rewritten problem (core).
        longest: Largest number of instructions of the sweep.
    """
    problem = shooting.problem
    each = problem.checks * problem.substeps
    least = _SWEPT * shooting.stage_without_path.n_instructions() / each
    return problem.model.nx + problem.model.nu <= _MOST_STATES and least <= longest


def is_divisible(problem: OptimalControlProblem) -> bool:
    """Return whether each step of a problem can be an interval of its own in lanes.

    Costs must be integrals, since sums have a term for each interval. Controls must be
    bounded: those of some short intervals have no effect, and without the barrier of
    their bounds, which moves them to the middle, they would be undetermined.
    """
    model = problem.model
    return (
        not refused_by_lanes(problem)
        and problem.checks * problem.substeps > 1
        and problem.quadrature == "integral"
        and problem.step_cost.is_zero()
        and problem.risk is None
        and not (problem.soft or model.jumps or model.is_discrete)
        and bool(np.isfinite(problem.control_limits).all())
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Steps:
    """A core (rewritten problem) with an interval for each step of its integrator.

    The methods convert what belongs to the stated intervals, such as controls, to these
    short ones, and answers back.

    Attributes:
        whole: The core with the intervals that were stated.
        problem: The core with an interval for each step.
    """

    whole: OptimalControlProblem
    problem: OptimalControlProblem

    @property
    def each(self) -> int:
        """Number of steps of an interval."""
        return self.whole.checks * self.whole.substeps

    def x0(self, x0: ArrayLike) -> Array:
        """Return an initial state, with the middle of the bounds for the held controls.

        The held controls are further states of the problem with short intervals.
        """
        lower, upper = self.whole.control_limits
        state = np.asarray(x0, dtype=np.float64).ravel()
        return np.concatenate([state, (lower + upper) / 2])

    def known(self, known: Known) -> Known:
        """Return known data with signals after each step, and a further signal.

        The further signal is 1 where an interval of the problem begins, else 0.
        """
        whole, count = self.whole, self.problem.nodes
        at = np.linspace(0, whole.nodes - 1, count)
        given = np.reshape(known.signals, (whole.ns, whole.nodes))
        rows = [np.interp(at, np.arange(whole.nodes), row) for row in given]
        begins = (np.arange(count) % self.each == 0).astype(np.float64)
        # Signals of the model come before those of the problem.
        rows.insert(whole.model.ns, begins)
        return known._replace(signals=np.vstack(rows))

    def controls(self, controls: Array) -> Array:
        """Return the controls of steps, shape (nu, N', n).

        At the last step of an interval they are those of the following interval.
        """
        following = np.concatenate([controls[:, 1:], controls[:, -1:]], axis=1)
        found = np.repeat(controls, self.each, axis=1)
        found[:, self.each - 1 :: self.each] = following
        return found

    def starts(self, controls: Array, starts: Array) -> Array:
        """Return the decisions about the start, with the first controls appended."""
        return np.concatenate([starts, controls[:, 0]])

    def states(self, controls: Array, states: Array) -> Array:
        """Return states after each step, with the held controls as further rows.

        Within a stated interval the states are linear.
        """
        N = controls.shape[1]
        at = np.arange(N * self.each + 1) / self.each
        left = np.minimum(at.astype(int), N - 1)
        part = (at - left)[None, :, None]
        between = (1 - part) * states[:, left] + part * states[:, left + 1]
        return np.concatenate([between, controls[:, left]])

    def back(self, found: LaneAnswers) -> LaneAnswers:
        """Return answers to the core with the intervals that were stated."""
        nx, nu, each = self.whole.model.nx, self.whole.model.nu, self.each
        first = found.starts[found.starts.shape[0] - nu :, None]
        later = found.controls[:, each - 1 : -1 : each]
        return replace(
            found,
            controls=np.concatenate([first, later], axis=1),
            starts=found.starts[:-nu],
            states=found.states[:nx, ::each],
            costates=found.costates[:nx],
        )


def stepwise(problem: OptimalControlProblem) -> Steps:
    """Return a divisible problem (`is_divisible`) with an interval for each step."""
    model, u = problem.model, problem.model.controls
    names = [f"{name} held" for name in model.control_names]
    held = ca.vertcat(*[ca.SX.sym(name) for name in names])
    begins = ca.SX.sym("an interval begins")
    signals = ca.vertcat(model.signals, begins)
    changed = replaced(u, held)
    limits = dict(zip(names, zip(*problem.control_limits, strict=True), strict=True))
    scales, first = dict(problem.scales), dict[str, Free]()
    for name, own in zip(names, model.control_names, strict=True):
        lower, upper = map(float, limits[name])
        first[name] = Free(lower, upper)
        if upper > lower:  # Else it is found, as for any other state.
            scales[name] = problem.scales.get(own, upper - lower)
    divided = with_states(
        problem,
        Appended(states=held, after=begins * u + (1 - begins) * held),
        {**changed_model(model, changed), "signals": signals},
        start={**problem.start, **first},
        signals=ca.vertcat(signals, problem.signals[model.ns :, 0]),
        scales=scales,
        intervals=problem.intervals * problem.checks * problem.substeps,
        checks=1,
        substeps=1,
        **changed_fields(problem, changed, changed),
    )
    return Steps(whole=problem, problem=divided)
