"""A controller of the library as the numbers and functions that a C file is made of."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.export.paths import ExportError
from swarmstart.ocp.answer.plan import NOISE
from swarmstart.ocp.lanes.one_lane import OneLane, one_lane
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import random_starts
from swarmstart.ocp.loop.controller import RecedingHorizon
from swarmstart.ocp.loop.dual_mode import DualMode
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.guesses import Appended
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.held import held_signals
from swarmstart.terminal_set import TerminalSet

KNOTS = 6
"""Number of values between which a seeded start is linear."""
_LONGEST = 12_000
"""Largest number of instructions of an interval's part of a kernel: some 100 kB of
code. The lanes themselves take 40,000."""
_SAME = 1e-9
"""Largest change of a target, relative to its size, that counts as rest."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedController:
    """The numbers and functions that a C file is made of.

    Attributes:
        shooting: Functions of the problem.
        x0: Initial state of the core, that is, of the problem after all rewrites. All
            numbers are divided by sizes that are computed at this state.
        known: Parameters and signals of the core at the start.
        stated: Number of states of the user's problem, the first ones of the core;
            further states of the core hold past controls.
        lane: The kernels (machine code) and arrays of a local solve from one start.
        remembered: Initial values of the further states.
        first: Controls of a plan that the library makes at `x0`, with which the C code
            begins, shape (nu, N).
        starts: Random controls, given at knots, from which plans are solved if the last
            plan leads to no feasible one, shape (starts, nu, knots).
        append: Name of the rule for the controls that a shifted plan ends with.
        terminal_set: The set in which the linear law acts; None if no law is used.
        noise: Largest rise of the cost that counts as noise.
    """

    shooting: Shooting
    x0: Array
    known: Known
    stated: int
    lane: OneLane
    remembered: Array
    first: Array
    starts: Array
    append: Appended
    terminal_set: TerminalSet | None
    noise: float

    @property
    def problem(self) -> OptimalControlProblem:
        """The core: the problem after all rewrites."""
        return self.shooting.problem

    @property
    def interval(self) -> ca.Function:
        """Function of an interval: (x, u, p, S) -> (x after it, cost, violation).

        x is the state, u the controls, p the parameters with the weights of rows
        (shooting.py), and S the signals at the nodes of the interval.
        """
        return self.shooting.stage_without_path

    @property
    def end(self) -> ca.Function:
        """Function at the end of the horizon: (x, p, s) -> (cost, violation).

        x and p are as in `interval`, and s are the signals at that time.
        """
        return self.shooting.terminal

    @property
    def begin(self) -> ca.Function | None:
        """Function at the start of the horizon: (x, p, s) -> (cost, violation).

        x, p and s are as in `end`. None: the start adds neither cost nor violation.
        """
        return self.shooting.begin if self.shooting.has_begin else None


def posed_controller(  # noqa: PLR0913 - what a file is made of, by name
    controller: RecedingHorizon | DualMode,
    x0: ArrayLike,
    *,
    starts: int,
    iterations: int,
    exactness: tuple[float, float],
    seen: Sequence[ArrayLike] = (),
    rng: np.random.Generator,
) -> PosedController:
    """Return the numbers and functions of a controller from which a C file is made.

    The sizes by which numbers are divided, and the first plan, are computed at `x0`.

    Args:
        controller: The controller of one vehicle.
        x0: Initial state of the stated problem, shape (nx,).
        starts: Number of seeded starts.
        iterations: Largest number of steps of a local solve.
        exactness: Largest scaled error at which a local solve ends, and the rounding
            error of its cost.
        seen: Rows of signals that follow those of the reference.
        rng: Source of the starts, and of the first plan's search.

    Raises:
        ExportError: If the controller cannot be written as C; the message names what
            would make it possible.
        InvalidProblemError: If a shape is not the problem's, or a value not finite.
    """
    loop, terminal_set = _parts(controller)
    _require_plain(loop)
    planner = loop.planner
    rows = tuple(np.atleast_2d(np.asarray(one, dtype=np.float64)) for one in seen)
    known = loop.known(0.0, rows)
    start, core_known, _ = planner.posed(x0, known)
    state = np.asarray(start, dtype=np.float64)
    shooting, problem = planner.fitness.shooting, planner.problem
    try:
        lane = one_lane(
            shooting,
            state,
            core_known,
            most=iterations,
            longest=_LONGEST,
            tolerance=exactness[0],
            rounding=exactness[1],
        )
    except NoLanesError as error:
        raise ExportError(
            f"the controller cannot be written as C: {error}. Fewer substeps, or "
            "another statement of the problem, would make it possible"
        ) from error
    nx = planner.stated.model.nx
    if terminal_set is not None and state.size > nx:
        raise ExportError(
            "the controller cannot be written as C: its problem remembers controls "
            f"({', '.join(problem.model.state_names[nx:])}), which its terminal set "
            "does not: leave out one of them"
        )
    sized = planner.fitness.arguments.sizes(state, core_known).cost
    return PosedController(
        shooting=shooting,
        x0=state,
        known=core_known,
        stated=nx,
        lane=lane,
        remembered=state[nx:],
        first=_first_plan(loop, np.asarray(x0, dtype=np.float64), rows, rng),
        starts=_knots(problem, starts, rng),
        append=loop.append,
        terminal_set=terminal_set,
        noise=NOISE * sized,
    )


def _parts(
    controller: RecedingHorizon | DualMode,
) -> tuple[RecedingHorizon, TerminalSet | None]:
    """Return the controller that plans, and the set in which the linear law acts."""
    if isinstance(controller, RecedingHorizon):
        return controller, None
    if len(controller.sets) != 1:
        raise ExportError(
            f"a C file is the controller of one vehicle, found {len(controller.sets)}: "
            "export the controller of each, with the plans of the others as signals"
        )
    (one,), (target,) = controller.sets, controller.targets
    loop = controller.team.agents[0].controller
    at = [np.asarray(target(time), dtype=np.float64) for time in (0.0, 1.0, 1e3)]
    if any(np.abs(x - at[0]).max() > _SAME * (1 + np.abs(at[0]).max()) for x in at):
        raise ExportError(
            "the target of the terminal set moves, found another one after 1 s: state "
            "the problem in coordinates that move with it"
        )
    if np.abs(at[0] - one.x_ref).max() > _SAME * (1 + np.abs(at[0]).max()):
        raise ExportError(
            f"the target {at[0].tolist()} is not the reference {one.x_ref.tolist()} "
            "that the terminal set is proven for: make the set at the target"
        )
    return loop, one


def _require_plain(loop: RecedingHorizon) -> None:
    """Raise unless a loop has only features that a C file has."""
    planner = loop.planner
    stated, search = planner.stated, planner.search
    beyond = [
        link.rewrite.role
        for link in planner.lowered.links
        if not link.rewrite.is_remembered
        and (link.after.model.nx, link.after.model.ns, link.after.model.np)
        != (link.before.model.nx, link.before.model.ns, link.before.model.np)
    ]
    reasons = {
        "it searches at every step (when='always'), and a C file has no population: "
        "take when='needed'": search is not None and search.when == "always",
        "it has no polish, whose method the C file has: give it one": planner.polish
        is None,
        "its end time is free: fix the horizon": isinstance(stated.horizon, Free),
        "its plans become shorter (until): a C file plans over one length": loop.until
        is not None,
        "its controls are linear between knots: hold them": stated.has_knots,
        "a state of it is far from zero: state the problem in its distance from a "
        "number near it": bool(
            planner.lowered.origin.any()
        ),
        "it is an ensemble: export the problem of one member": stated.risk is not None,
        "its horizon has one interval: take two or more": stated.intervals == 1,
        "its plans are not shifted: take shift=True": not loop.shift,
        "it is given candidates at each step: leave them out": loop.candidates
        is not None,
        "its plans have a time (within): a C file counts operations instead; leave it "
        "out": loop.within is not None,
        "its integrator has no fixed number of steps: take 'rk4' with substeps":
        planner.problem.is_adaptive,
        "signals of it are held over intervals (HeldSignals, between: hold), and a C "
        "file takes them as linear: give them as linear": bool(held_signals(stated)),
        f"it has a feature that a C file has not ({', '.join(map(str, beyond))}): "
        "state it by signals and states": bool(beyond),
        "it decides its start, which a closed loop measures: leave `start` out": bool(
            planner.problem.free_starts
        ),
    }  # fmt: skip
    for reason, is_so in reasons.items():
        if is_so:
            raise ExportError(f"the controller cannot be written as C: {reason}")


def _first_plan(
    loop: RecedingHorizon, x0: Array, seen: tuple[Array, ...], rng: np.random.Generator
) -> Array:
    """Return the controls of the loop's first plan, shape (nu, N)."""
    plan = loop.plan(0.0, x0, None, seen=seen, rng=rng)
    return np.asarray(plan.controls)


def _knots(
    problem: OptimalControlProblem, count: int, rng: np.random.Generator
) -> Array:
    """Return the knots of seeded starts, shape (count, nu, knots)."""
    knots = min(KNOTS, problem.intervals)
    controls, _ = random_starts(problem, 2 * count, rng)
    # Every second one has KNOTS knots, which are values of the controls.
    coarse = controls[:, :, ::2]
    at = np.linspace(0, problem.intervals - 1, knots)
    place = np.arange(problem.intervals)
    found = np.empty((count, problem.model.nu, knots))
    for i in range(count):
        for row in range(problem.model.nu):
            found[i, row] = np.interp(at, place, coarse[row, :, i])
    return found


def start_controls(knots: Array, intervals: int) -> Array:
    """Return the controls of a seeded start, shape (nu, N).

    Args:
        knots: Values of the start at its knots, shape (nu, knots).
        intervals: Number N of intervals, at least 2.
    """
    count = knots.shape[1]
    at = np.arange(intervals) * ((count - 1) / (intervals - 1))
    return np.array([np.interp(at, np.arange(count), row) for row in knots])
