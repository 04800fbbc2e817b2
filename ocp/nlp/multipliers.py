"""Multipliers of an answer: in the units of the user, and as a start of another solve.

With the Lagrangian L = cost + costate' (state that an interval leads to - state at the
interval's end) + multiplier' (value - limit), stationary at the answer,

    costate     the gradient of the optimal cost to go with respect to the state at the
                interval's end
    multiplier  the optimal cost changes by -multiplier for each unit by which the limit
                is raised. For minimised costs it is at least 0 at an upper limit and at
                most 0 at a lower one; for maximised costs the signs are reversed

A limit of a path constraint has a multiplier at every check. The multipliers of an
interval are added up, so the sum over all intervals says how much the optimal cost
changes if the limit is raised everywhere.

An NLP (transcription.py) divides its rows, variables and cost by sizes that depend on
the initial state and the guess. From the multipliers lam_g of its rows and lam_x of its
bounds follow those of the rewritten problem (core), from which another solve can start:

    of a row    lam_g * (size of the cost) / (size of the row)
    of a bound  lam_x * (size of the cost) / (size of the variable)

A receding horizon shifts them by one interval, as it does with its plan. The costates
and multipliers of the last interval are repeated at the end.

Source: Nocedal and Wright (2006), Numerical Optimization, section 12.8; Bryson and Ho
(1975), Applied Optimal Control, chapter 2, for the costate as a gradient; Diehl, Bock
and Schloeder (2005), A real-time iteration scheme for nonlinear optimization in optimal
feedback control, SIAM J. Control Optim. 43, for the shift.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.collocation import layout_of
from swarmstart.ocp.nlp.nlp_assembly import decided_states, inputs_of
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.statement.control_shape import ties
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import Constraint
from swarmstart.ocp.system.separation import label


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Multipliers:
    """Multipliers of an answer: how the optimal cost depends on the limits.

    If a limit is raised by one unit, the optimal cost changes by -multiplier. The
    multipliers of an interval's checks are added up. A costate is the gradient of the
    optimal cost to go with respect to the state.

    Attributes:
        costates: Costates at the ends of the intervals, shape (nx, N) [cost / unit of a
            state].
        controls: Multipliers of the bounds of the controls, shape (nu, N).
        states: Multipliers of the bounds of the states, shape (nx, N).
        path: Multipliers of each path constraint, by its name, shape (rows, N). Soft
            constraints come last; the multiplier of a row is at most the cost of a unit
            of its excess.
        terminal: Multipliers of each terminal constraint, by its name, shape (rows,).
        decided: Multipliers of the bounds of decisions besides the controls: starts and
            parameters by their names, a free end time as "end time".
    """

    costates: Array
    controls: Array
    states: Array
    path: Mapping[str, Array]
    terminal: Mapping[str, Array]
    decided: Mapping[str, float]

    def __repr__(self) -> str:
        """Return each constraint with the sums of its multipliers, in a few lines."""
        lines = [
            f"Multipliers of {self.costates.shape[1]} intervals; the first costate: "
            f"{_numbers(self.costates[:, 0])}"
        ]
        sums = [(name, rows.sum(axis=1)) for name, rows in self.path.items()]
        sums += self.terminal.items()
        lines += [f"  {name}: {_numbers(values)}" for name, values in sums]
        return "\n".join(lines)


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def multipliers_of(point: NlpPoint, stated: OptimalControlProblem) -> Multipliers:
    """Return the multipliers of a point in the units of the user.

    Args:
        point: The answer as a point of the NLP.
        stated: The problem that the point answers; the NLP may be that of its core, and
            have margins and more checks.
    """
    core, parts = point.program.problem, point.program.parts
    nx, nu, N = core.model.nx, inputs_of(core), core.intervals
    splits = np.cumsum(parts.argument_sizes(core))[:-1]
    _, _, *weights, _ = np.split(point.q, splits)
    sizes_x, sizes_u = point.state_sizes, point.control_sizes
    cost = stated.sense * point.cost_size
    lam_x, lam_start = np.split(cost * point.lam_x, [(nu + nx) * N])
    of_bounds = lam_x.reshape((nu + nx, N), order="F")
    of_parts = _of_parts(point, cost)
    found = [
        np.zeros((c.rows(c.expression).lower.size, N))
        for c in (*core.path_constraints, *core.terminal_constraints, *core.soft)
    ]
    for part, lam, weight in zip(parts.present, of_parts, weights, strict=True):
        # The end and the start have one column each.
        column = slice(None) if part is parts.interval else slice(0, 1)
        kept = len(lam) - len(weight)  # Rows with limits come last.
        for (number, row), value, w in zip(
            part.rows.places, lam[kept:], weight, strict=True
        ):
            found[number][row, column] += value * w
    own, last = stated.model.nx, len(core.path_constraints)
    soft = len(found) - len(core.soft)
    of_path = [*found[: len(core.stated)], *found[soft:]]
    # Excesses and collocation unknowns follow the controls.
    controls = of_bounds[: core.model.nu] / sizes_u[:, None]
    states = of_bounds[nu:] / sizes_x[:, None]
    if last > len(core.stated):  # Bounds at inner checks.
        states[core.bounded_states] += found[len(core.stated)]
    return Multipliers(
        costates=(of_parts[0][:nx] / sizes_x[:, None])[:own],
        controls=controls,
        states=states[:own],
        path=_named(
            (
                *_as_stated(stated.stated, core.stated),
                *_as_stated(stated.soft, core.soft),
            ),
            of_path,
        ),
        terminal={
            name: values[:, 0]
            for name, values in _named(
                _as_stated(stated.terminal_constraints, core.terminal_constraints),
                found[last:soft],
            ).items()
        },
        decided=_of_starts(core, lam_start / sizes_x[decided_states(core)]),
    )


def _of_parts(point: NlpPoint, cost: float) -> list[Array]:
    """Return the multipliers of each part's rows, shape (rows, its intervals).

    The rows that tie the controls of blocks come last and are left out.
    """
    parts, N = point.program.parts.present, point.program.problem.intervals
    heights = [part.height for part in parts]
    counts = [N, *[1 for _ in parts[1:]]]
    ends = np.cumsum([h * n for h, n in zip(heights, counts, strict=True)])
    return [
        lam.reshape((height, -1), order="F") if height else np.empty((0, count))
        for lam, height, count in zip(
            np.split(cost * point.lam_g, ends)[:-1], heights, counts, strict=True
        )
    ]


def _named(
    constraints: Sequence[Constraint], found: Sequence[Array]
) -> dict[str, Array]:
    """Return multipliers by the names of their constraints, which are made unique."""
    named: dict[str, Array] = {}
    for constraint, values in zip(constraints, found, strict=True):
        name = label(constraint)
        again = sum(1 for used in named if used == name or used.startswith(f"{name} ("))
        named[f"{name} ({again + 1})" if name in named else name] = values
    return named


def _as_stated(
    stated: Sequence[Constraint], core: Sequence[Constraint]
) -> tuple[Constraint, ...]:
    """Return the constraints as they are stated, and those that rewrites append."""
    return (*stated, *core[len(stated) :])


def _of_starts(core: OptimalControlProblem, multipliers: Array) -> dict[str, float]:
    """Return the multipliers of the bounds of each decision about the start."""
    found, place = {}, 0
    for one in core.free_starts:
        count = len(one.states)
        name = core.model.state_names[one.states[0]]
        found[name] = float(multipliers[place : place + count].sum())
        place += count
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Duals:
    """Multipliers of an NLP's rows and bounds, in the units of the rewritten problem.

    Attributes:
        rows: Multipliers of the rows, shape (ng,).
        bounds: Multipliers of the bounds of the variables, shape (nw,).
    """

    rows: Array
    bounds: Array

    def flat(self) -> Array:
        """Return all multipliers in one vector, (ng + nw,)."""
        return np.concatenate([self.rows, self.bounds])


def duals_of(point: NlpPoint) -> Duals:
    """Return the multipliers of a point in the units of the rewritten problem."""
    rows, bounds = units_of(point.program, point.q, point.cost_size)
    return Duals(point.lam_g * rows, point.lam_x * bounds)


def units_of(
    program: NonlinearProgram, q: Array, cost_size: float
) -> tuple[Array, Array]:
    """Return the factors from the NLP's multipliers to those of the rewritten problem.

    They are those of the rows, shape (ng,), and of the bounds, shape (nw,).

    Args:
        program: The NLP.
        q: Arguments of the NLP, which hold the sizes.
        cost_size: Divisor of the cost in the NLP.
    """
    core, parts = program.problem, program.parts
    layout, nx, N = layout_of(core), core.model.nx, core.intervals
    inner = 0 if layout is None else layout.size
    ends = np.cumsum(parts.argument_sizes(core)).tolist()
    weights = [q[a:b] for a, b in pairwise(ends[1:-1])]
    first = ends[0] + core.model.np
    after = first + nx, first + nx + core.model.nu + core.slacks + inner
    x, u = 1.0 / q[first : after[0]], 1.0 / q[after[0] : after[1]]
    inside = [x, weights[0]]
    if layout is not None:
        residuals = 1.0 / q[after[1] : after[1] + layout.lifted]
        moving = np.tile(x[list(layout.moving)], layout.places)
        inside[1:1] = [moving, np.tile(residuals, layout.places + 1)]
    of_rows = [np.tile(np.concatenate(inside), N)]
    equations = parts.end.height - weights[1].size
    of_epigraph = 1.0 if core.epigraph is None else x[core.epigraph.first]
    of_rows += [np.full(equations, of_epigraph), weights[1]]
    if parts.begin is not None:
        tied = [i for one in core.free_starts for i in one.states[1:]]
        of_rows += [x[tied], weights[2]]
    if core.ties_controls:
        of_rows.append(u[ties(core.control_labels)[0] % core.model.nu])
    of_bounds = [np.tile(np.concatenate([u, x]), N), x[decided_states(core)]]
    return cost_size * np.concatenate(of_rows), cost_size * np.concatenate(of_bounds)


def columns_of(program: NonlinearProgram, duals: Duals) -> tuple[Array, Array]:
    """Return views of the multipliers of each interval.

    They are those of the rows, shape (height, N), and of the bounds of the variables,
    shape (inputs + nx, N).
    """
    core, N = program.problem, program.problem.intervals
    height = program.parts.interval.height
    width = inputs_of(core) + core.model.nx
    return (
        duals.rows[: height * N].reshape((N, height)).T,
        duals.bounds[: width * N].reshape((N, width)).T,
    )


def shifted_duals(program: NonlinearProgram, duals: Duals) -> Duals:
    """Return multipliers for a horizon that begins one interval later.

    Those of the last interval are repeated.

    Args:
        program: The NLP that they belong to.
        duals: The multipliers; not changed.
    """
    found = Duals(duals.rows.copy(), duals.bounds.copy())
    for now, before in zip(
        columns_of(program, found), columns_of(program, duals), strict=True
    ):
        now[:, :-1] = before[:, 1:]
    return found
