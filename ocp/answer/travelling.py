"""Transfer of an answer to a start on another grid, or from another initial state.

    states       interpolated over the time
    controls     means over the new intervals; knots are interpolated
    decided      unchanged: parameters, a free end time, a free start
    multipliers  as in carried.py

If the horizon differs, everything is stretched: start maps to start, end to end. States
of joined phases, which count their intervals, are omitted on another grid.
"""

from collections.abc import Sequence

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.answer.plan import Plan
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.nlp.carried import Carried
from swarmstart.ocp.nlp.duals import duals_of
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.statement.free import Free
from swarmstart.ocp.statement.lowering import Lowered, lowered
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraint_forms import label


def guess_of(
    plan: Plan, stated: OptimalControlProblem, problem: OptimalControlProblem
) -> Start:
    """Return a plan as a start of another problem with the same names.

    Args:
        plan: The plan, with its states.
        stated: The problem that it answers.
        problem: The problem to solve.

    Raises:
        InvalidProblemError: If states, controls, constraints or decisions have other
            names, or controls another shape.
    """
    _require_same(stated, problem)
    before, after = lowered(stated), lowered(problem)
    decided = {
        before.core.model.state_names[one.states[0]]: float(plan.x0[one.states[0]])
        for one in before.core.free_starts
    }
    controls = _controls(before.knots(plan.controls, plan.x0), problem, stated)
    carried = None
    if plan.point is not None:
        carried = Carried(
            duals=duals_of(plan.point),
            program=plan.point.program,
            stretch=_length(after, decided) / before.end_time(plan.x0),
        )
    # Joined phases count their intervals in a state.
    counts = bool(stated.clock) and problem.intervals != stated.intervals
    return Start(
        controls=controls,
        states=None if counts else _states(plan, before, after, controls),
        is_guess=not counts,
        carried=carried,
        decided=decided,
    )


def _length(after: Lowered, decided: dict[str, float]) -> float:
    """Return the length of the new horizon [s]; a free one keeps it, in bounds."""
    horizon = after.stated.horizon
    if not isinstance(horizon, Free):
        return after.stated.length
    names = after.core.model.state_names
    (place,) = after.places["end time"]
    guess = decided.get(names[place], horizon.first)
    return float(np.clip(guess, horizon.lower, horizon.upper))


def _controls(
    given: Array, problem: OptimalControlProblem, stated: OptimalControlProblem
) -> Array:
    """Return controls, or knots, over the intervals of a problem."""
    N, before = problem.intervals, stated.intervals
    if problem.has_knots:
        at = np.linspace(0.0, before, N + 1)
        return np.array([np.interp(at, np.arange(before + 1), row) for row in given])
    if N == before:
        return given.copy()
    edges, old = np.linspace(0.0, 1.0, N + 1), np.linspace(0.0, 1.0, before + 1)
    totals = np.hstack([np.zeros((given.shape[0], 1)), np.cumsum(given, axis=1)])
    means = [np.diff(np.interp(edges, old, row)) * N / before for row in totals]
    return np.array(means).reshape((given.shape[0], N))


def _states(plan: Plan, before: Lowered, after: Lowered, controls: Array) -> Array:
    """Return the states of the new core at its nodes."""
    old = np.linspace(0.0, 1.0, plan.states.shape[1])
    new = np.linspace(0.0, 1.0, after.core.nodes)
    names = before.core.model.state_names
    found = np.zeros((after.core.model.nx, new.size))
    for i, name in enumerate(after.core.model.state_names):
        if name in names:
            found[i] = np.interp(new, old, plan.states[names.index(name)])
    places = after.places["previous"]
    if places:  # These states jump.
        nodes = np.arange(new.size) // after.core.checks
        held = np.hstack([found[places, :1], controls[: len(places)]])
        found[places] = held[:, nodes]
    return found


def _require_same(
    stated: OptimalControlProblem, problem: OptimalControlProblem
) -> None:
    """Raise unless two problems have the same names."""
    if not isinstance(problem, OptimalControlProblem):
        raise InvalidProblemError(
            f"as_guess takes an OptimalControlProblem, got {type(problem).__name__}"
        )
    for what, own, others in zip(
        ("states", "controls", "path constraints", "terminal constraints", "decisions"),
        _names(stated),
        _names(problem),
        strict=True,
    ):
        if own != others:
            raise InvalidProblemError(
                f"an answer is a guess of the same problem only: its {what} are "
                f"{_listed(own)}, those of the new one {_listed(others)}"
            )
    if problem.has_knots != stated.has_knots:
        shapes = stated.control_shape, problem.control_shape
        raise InvalidProblemError(
            f"an answer is a guess of the same problem only: its controls are "
            f"{shapes[0]}, those of the new one {shapes[1]}"
        )


def _names(problem: OptimalControlProblem) -> list[list[str]]:
    model = problem.model
    every = [*problem.stated, *problem.soft]
    free = ["end time"] if isinstance(problem.horizon, Free) else []
    return [
        [*model.state_names],
        [*model.control_names],
        sorted(map(label, every)),
        sorted(map(label, problem.terminal_constraints)),
        sorted([*free, *problem.decided]),
    ]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
