"""Multipliers of an NLP without its scaling, as a start for another solve.

An NLP (transcription.py) divides its rows, variables and cost by sizes that depend on
the initial state and the guess. Without these sizes, the multipliers are those of the
core:

    of a row    lam_g * (size of the cost) / (size of the row)
    of a bound  lam_x * (size of the cost) / (size of the variable)

A receding horizon shifts them by one interval, as it does with its plan. The costates
and multipliers of the last interval are repeated at the end.

Source: Diehl, Bock and Schloeder (2005), A real-time iteration scheme for nonlinear
optimization in optimal feedback control, SIAM J. Control Optim. 43, for the shift.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.collocation import layout_of
from swarmstart.ocp.nlp.nlp_assembly import decided_states, inputs_of
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.statement.blocks import ties


@dataclass(frozen=True, slots=True, eq=False)
class Duals:
    """Multipliers of an NLP's rows and bounds, in the units of the core.

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
    """Return the multipliers of a point without scaling."""
    rows, bounds = units_of(point.program, point.q, point.cost_size)
    return Duals(point.lam_g * rows, point.lam_x * bounds)


def units_of(
    program: NonlinearProgram, q: Array, cost_size: float
) -> tuple[Array, Array]:
    """Return the units of the multipliers of rows (ng,) and of bounds (nw,).

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
    equations = parts.end.value.numel_out(0) - weights[1].size
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
    """Return rows (height, N) and bounds (inputs + nx, N) of the intervals, views."""
    core, N = program.problem, program.problem.intervals
    height = program.parts.interval.value.numel_out(0)
    width = inputs_of(core) + core.model.nx
    return (
        duals.rows[: height * N].reshape((N, height)).T,
        duals.bounds[: width * N].reshape((N, width)).T,
    )


def shifted_duals(program: NonlinearProgram, duals: Duals) -> Duals:
    """Return multipliers one interval later; those of the last interval are repeated.

    Args:
        program: The NLP that they belong to.
        duals: Not changed.
    """
    found = Duals(duals.rows.copy(), duals.bounds.copy())
    for now, before in zip(
        columns_of(program, found), columns_of(program, duals), strict=True
    ):
        now[:, :-1] = before[:, 1:]
    return found
