"""Collocation brought to where the evaluator is: deferred correction.

An answer of the NLP keeps its limits on the collocated path, and an evaluator that
integrates otherwise may not agree. With x_k, u_k of the answer and c_k the inner
unknowns that lead from x_k to where the evaluator gets to, the rows of motion D(c) = 0
are shifted,

    D(c) = D(c_k),     x after(c) - x_k+1 = x after(c_k) - where the evaluator gets to,

so that each interval leads where the evaluator leads it. An NLP with these rows,
solved from the answer, is nearer to the evaluator by as much as collocation is exact;
this is repeated until both agree.

Source: Auzinger, Hofstaetter, Kreuzer and Weinmueller (2004), Modified defect
correction algorithms for ODEs, part I, Numerical Algorithms 36.
"""

import numpy as np

from swarmstart.ocp.collocation import layout_of
from swarmstart.ocp.nlp_assembly import decided_states, inputs_of
from swarmstart.ocp.optimality import NlpPoint
from swarmstart.ocp.scaling import Sizes
from swarmstart.ocp.transcription import Array, Given, Limits

MOST_CORRECTIONS = 5
"""Times at most that an NLP is solved again."""


def corrected(
    point: NlpPoint, sizes: Sizes, parameters: Array, signals: Array
) -> tuple[Array, Limits] | None:
    """Return where to begin again, and limits whose rows of motion are shifted.

    Algebraic equations stay as they are.

    Args:
        point: The NLP's answer.
        sizes: The sizes.
        parameters: Shape (np,).
        signals: At the nodes, shape (ns, nodes).

    Returns:
        None if the evaluator gets to what is not finite, or nothing is collocated.
    """
    program, problem = point.program, point.program.problem
    guess, layout = program.inner_guess, layout_of(problem)
    if guess is None or layout is None:
        return None
    nx, N = problem.model.nx, problem.intervals
    ends = _ends(point) * sizes.states[:, None]
    controls, _ = program.split(point.w, sizes)
    pieces = guess.followed(controls, ends[:, :-1], parameters, signals)
    if not np.isfinite(pieces).all():
        return None
    given = Given(controls, pieces, parameters, signals)
    w = program.with_points(point.w, given, sizes)
    height = program.parts.interval.value.numel_out(0)
    g = np.array(program.derivatives["jac_g"](w, point.q)[0]).ravel()[: height * N]
    shift = g.reshape((N, height))[:, : nx + layout.states].copy()
    shift[:, :nx] += ((ends[:, 1:] - pieces[:, -1]) / sizes.states[:, None]).T
    lbg, ubg = point.limits.lbg.copy(), point.limits.ubg.copy()
    for bounds in (lbg, ubg):
        columns = bounds[: height * N].reshape((N, height))  # A view.
        columns[:, : nx + layout.states] = shift
    return w, point.limits._replace(lbg=lbg, ubg=ubg)


def _ends(point: NlpPoint) -> Array:
    """Return the scaled states between the intervals, shape (nx, N + 1)."""
    problem = point.program.problem
    free = decided_states(problem)
    start, inner = point.q[: problem.model.nx].copy(), point.w.size - len(free)
    start[free] = point.w[inner:]
    both = point.w[:inner].reshape((-1, problem.intervals), order="F")
    return np.hstack([start[:, None], both[inputs_of(problem) :]])
