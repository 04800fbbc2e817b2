"""Population search for starts of an NLP whose states are eliminated.

Each control is piecewise linear through a few knots; all other remaining variables are
searched directly. Individuals are compared by cost + weight * violation
(`traded_order`). The violation is the sum of all excesses over the bounds of the
remaining rows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Box,
    Initial,
    minimize,
)
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.backend import CasadiMap
from swarmstart.ocp.compiled.interpreter import Interpreted, interpreted
from swarmstart.ocp.foreign_nlp.elimination import Elimination, GivenNlp
from swarmstart.ocp.nlp.nlp_sources import Indices, Numbers
from swarmstart.ocp.search.settings import SearchSettings, population_of, traded_order

Values = Callable[[Array], tuple[Array, Array]]
"""Search variables, shape (nz, size) -> cost and violation, each (size,)."""

Evaluator = Interpreted | CasadiMap

KNOTS = 12
"""Number of knots of each control."""
BASINS = 3
"""Number of distinct basins kept for the NLP solver."""
RADIUS = 0.08
"""Smallest distance of two basins, as a fraction of the box's widths."""
STRETCH = 4.0
"""A variable without bounds that is no control is searched between its initial value
divided by this factor and multiplied by it."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RollOut:
    """NLP as functions of the search's variables z.

    The variables that remain after the elimination of states are

        clip(spread @ z, lower, upper)

    with lower and upper their bounds.

    Attributes:
        found: The NLP with its states eliminated.
        evaluate: Function (z, p, lower bounds of g, limits of the remaining rows and of
            the remaining variables) -> (cost, violation).
        spread: Matrix from z to the remaining variables, shape (nf, nz).
        sequences: For each control, and for each remaining variable that belongs to no
            control: the times of its knots, the times of its remaining variables, and
            the indices of these variables in x. A single variable has one time.
    """

    found: Elimination
    evaluate: Evaluator
    spread: Array
    sequences: list[tuple[Array, Array, Indices]]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ranges:
    """Ranges of the search.

    Attributes:
        lower: Lower bounds of the variables that remain after the elimination of
            states, shape (nf,).
        upper: Upper bounds of the same variables, shape (nf,).
        box: Bounds of the search's variables z, see `RollOut`.
        start: The user's own start in the search's variables z, shape (nz,).
    """

    lower: Array
    upper: Array
    box: Box
    start: Array


def roll_out_of(found: Elimination, controls: Sequence[Indices]) -> RollOut:
    """Return the NLP as functions of the search's variables.

    Args:
        found: The NLP with its states eliminated.
        controls: Controls over time, each as indices in x, shape (times,).
    """
    place = {int(index): k for k, index in enumerate(found.free)}
    of_controls = {int(i) for control in controls for i in control}
    others = (np.array([i]) for i in found.free if int(i) not in of_controls)
    columns, sequences = [], []
    for sequence in (*controls, *others):
        times = np.flatnonzero([int(i) in place for i in sequence])
        if not times.size:
            continue
        indices = sequence[times]
        count = min(KNOTS, times.size)
        at = np.linspace(times[0], times[-1], count)
        for knot in np.eye(count):  # A hat function for each knot.
            column = np.zeros(found.free.size)
            column[[place[int(i)] for i in indices]] = np.interp(times, at, knot)
            columns.append(column)
        sequences.append((at, times.astype(np.float64), indices))
    spread = np.stack(columns, axis=1)
    return RollOut(
        found=found,
        evaluate=_evaluator(found, spread),
        spread=spread,
        sequences=sequences,
    )


def _evaluator(found: Elimination, spread: Array) -> Evaluator:
    """Return `RollOut.evaluate`."""
    z = ca.SX.sym("z", spread.shape[1])
    p, lower = (
        ca.SX.sym(name, found.value.numel_in(i)) for i, name in ((1, "p"), (2, "lower"))
    )
    limits = [
        ca.SX.sym(name, size)
        for name, size in (
            ("least", found.kept.size),
            ("most", found.kept.size),
            ("free_from", found.free.size),
            ("free_to", found.free.size),
        )
    ]
    least, most, free_from, free_to = limits
    free = ca.mtimes(ca.sparsify(ca.DM(spread)), z)  # Most entries are 0.
    cost, rows = found.value(ca.fmin(ca.fmax(free, free_from), free_to), p, lower)
    excess = ca.sum1(ca.fmax(ca.fmax(least - rows, rows - most), 0))
    # fmax drops a NaN, and an infinite value may lie within infinite bounds.
    finite = ca.fabs(cost) + ca.sum1(ca.fabs(rows)) < ca.inf
    violation = ca.if_else(finite, excess, ca.inf)
    arguments = [z, p, lower, *limits]
    return interpreted(ca.Function("roll_out", arguments, [cost, violation]))


def starts(
    roll_out: RollOut,
    ranges: Ranges,
    numbers: Numbers,
    *,
    search: SearchSettings,
    rng: np.random.Generator,
) -> list[Array]:
    """Search for starts; return the best distinct points x, each of shape (nx,).

    Args:
        roll_out: The NLP as functions of the search's variables.
        ranges: The ranges of the search.
        numbers: Values of the parameters, bounds of the rows, and start of the NLP.
        search: Settings of the search; if they have no order, individuals are compared
            by cost + weight * violation.
        rng: Source of all randomness.
    """
    found = roll_out.found
    shared = (
        numbers.p,
        numbers.lower_g,
        numbers.lower_g[found.kept],
        numbers.upper_g[found.kept],
        ranges.lower,
        ranges.upper,
    )
    bound = roll_out.evaluate.bind(shared)

    def values(z: Array) -> tuple[Array, Array]:
        cost, violation = bound(z)
        return cost, violation

    result = minimize(
        values,
        ranges.box,
        algorithm=population_of(search.algorithm),
        budget=search.budget,
        order=search.order or traded_order(values, ranges.box, rng),
        initial=Initial(sampling=search.sampling, points=ranges.start[:, None]),
        basins=search.basins,
        radius=search.radius,
        rng=rng,
    )
    if not np.isfinite([result.cost, result.violation]).all():
        return []
    points = [result.x, *(b.x for b in result.basins)]
    kept: list[Array] = []
    for z in points:
        if not any(np.array_equal(z, other) for other in kept):
            kept.append(z)
    frees = (np.clip(roll_out.spread @ z, ranges.lower, ranges.upper) for z in kept)
    wholes = (found.whole(free, numbers.p, numbers.lower_g) for free in frees)
    return [x for x in (np.array(w).ravel() for w in wholes) if np.isfinite(x).all()]


def ranges_of(
    nlp: GivenNlp,
    roll_out: RollOut,
    numbers: Numbers,
    asked: Sequence[tuple[Indices, float, float]],
) -> Ranges:
    """Return the ranges of the search.

    Args:
        nlp: The NLP.
        roll_out: The NLP as functions of the search's variables.
        numbers: Values of the parameters, bounds of the rows, and start of the NLP.
        asked: Bounds given by the user: (indices in x, lower, upper).

    Raises:
        InvalidProblemError: If bounds are missing or empty.
    """
    found = roll_out.found
    lower, upper = _limits(nlp, numbers, asked)
    of_controls = {
        int(i)
        for _, times, indices in roll_out.sequences
        if times.size > 1
        for i in indices
    }
    _fill_missing(nlp, found, of_controls, numbers.start, lower, upper)
    ranges, begin = [], []
    for at, times, indices in roll_out.sequences:
        ranges += [(lower[indices].min(), upper[indices].max())] * at.size
        begin += np.interp(at, times, numbers.start[indices]).tolist()
    least, most = (np.array(side) for side in zip(*ranges, strict=True))
    middle = least + (most - least) / 2
    return Ranges(
        lower=lower[found.free],
        upper=upper[found.free],
        box=Box(lower=least, upper=most),
        start=np.clip(np.where(np.isfinite(begin), begin, middle), least, most),
    )


def _limits(
    nlp: GivenNlp, numbers: Numbers, asked: Sequence[tuple[Indices, float, float]]
) -> tuple[Array, Array]:
    """Return the bounds of each variable from rows of it alone and from the user."""
    lower, upper = (np.full(nlp.x.numel(), side) for side in (-np.inf, np.inf))
    for row, index, slope, offset in _simple_rows(nlp, numbers.p):
        ends = sorted(
            (side[row] - offset) / slope for side in (numbers.lower_g, numbers.upper_g)
        )
        lower[index] = max(lower[index], ends[0])
        upper[index] = min(upper[index], ends[1])
    for indices, least, most in asked:
        flat = indices.ravel()
        lower[flat] = np.maximum(lower[flat], least)
        upper[flat] = np.minimum(upper[flat], most)
    for index in np.flatnonzero(~(lower <= upper)).tolist():
        raise InvalidProblemError(
            f"bounds of {nlp.name(index)} are empty: expected lower <= upper, got "
            f"{lower[index]:g} and {upper[index]:g}"
        )
    return lower, upper


def _simple_rows(nlp: GivenNlp, p: Array) -> list[tuple[int, int, float, float]]:
    """Return the rows slope * x_i + offset, as (row, i, slope, offset)."""
    sparsity = nlp.jacobian.sparsity_out(0)
    rows, columns = (np.array(part) for part in sparsity.get_triplet())
    rng = np.random.default_rng(2)  # Fixed: one NLP is always read alike.
    points = [np.zeros(nlp.x.numel()), *rng.normal(0.0, 1.0, (2, nlp.x.numel()))]
    slopes = [np.array(nlp.jacobian(x, p).nonzeros()) for x in points]
    # The same bits at all points: a slope that depends on x hardly has them.
    constant = (slopes[0] == slopes[1]) & (slopes[1] == slopes[2]) & (slopes[0] != 0.0)
    offsets = np.array(nlp.rows(points[0], p)).ravel()
    per_row = np.bincount(rows.astype(np.int64), minlength=nlp.g.numel())
    return [
        (int(row), int(columns[k]), float(slopes[0][k]), float(offsets[row]))
        for k, row in enumerate(rows)
        if per_row[row] == 1 and constant[k] and np.isfinite(offsets[row])
    ]


def _fill_missing(
    nlp: GivenNlp,
    found: Elimination,
    of_controls: set[int],
    start: Array,
    lower: Array,
    upper: Array,
) -> None:
    """Fill in missing bounds from the initial value, if that gives a size."""
    for index in found.free.tolist():
        if np.isfinite([lower[index], upper[index]]).all():
            continue
        value = start[index]
        if index in of_controls or value == 0.0 or index in found.torn:
            raise InvalidProblemError(
                f"the search needs finite bounds on {nlp.name(index)}, got "
                f"[{lower[index]:g}, {upper[index]:g}]: add them, to the search alone "
                "by bounds={variable: (lower, upper)}, or as a constraint"
            )
        ends = sorted((value / STRETCH, value * STRETCH))
        lower[index] = max(lower[index], min(ends[0], upper[index]))
        upper[index] = min(upper[index], max(ends[1], lower[index]))
