"""Deferred correction: collocation made to agree with the evaluator's integrator.

An answer of the NLP keeps its limits on the collocated path, but an evaluator with
another integrator may disagree. Let x_k, u_k be the answer, and c_k the inner unknowns
that lead from x_k to the state that the evaluator reaches. The rows of motion D(c) = 0
are shifted to

    D(c) = D(c_k),     x after(c) - x_k+1 = x after(c_k) - evaluator's state,

so that each interval leads to the evaluator's state. The solution of an NLP with these
rows, started from the answer, is closer to the evaluator by the accuracy of the
collocation. This is repeated until both agree.

Source: Auzinger, Hofstaetter, Kreuzer and Weinmueller (2004), Modified defect
correction algorithms for ODEs, part I, Numerical Algorithms 36.
"""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.collocation import layout_of
from swarmstart.ocp.nlp.nlp_assembly import decided_states, inputs_of
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.transcription import Given, Limits
from swarmstart.ocp.rollout.scaling import Sizes

MOST_CORRECTIONS = 5
"""Largest number of times that an NLP is solved again."""


def corrected(
    point: NlpPoint, sizes: Sizes, parameters: Array, signals: Array
) -> tuple[Array, Limits] | None:
    """Return the next start and the limits with shifted rows of motion.

    Algebraic equations are not changed.

    Args:
        point: The answer of the NLP.
        sizes: The natural sizes.
        parameters: Shape (np,).
        signals: At the nodes, shape (ns, nodes).

    Returns:
        The new guess and limits; None if the evaluator's states are not finite, or
        nothing is collocated.
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
