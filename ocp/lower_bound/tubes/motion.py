"""Upper bounds of the rates of trajectories in given directions, over cells of space.

f(t, x, u) is the right-hand side; t, x and u are time, states and controls. A cell is a
part of a moving face of a polytope (`faces.py`) during a slab of time [t_a, t_b]: the
points (t, x, u) with

    x = W z + e,  z_0 = s(t) = s_a + slope (t - t_a),  |e_i| <= misfit,
    z_j in [lower_j, upper_j] (j > 0),  t in [t_a, t_b],  u in a box

z are the face's own coordinates, s is the level of the face, and s_a is s(t_a). The
bound of d'f over the cell, for a direction d, is the better one of two: d'f in
intervals, and the mean-value form

    d'f(t, x, u) <= d'f(c) + |d'f_t + d'f_x W_0 slope| (t_b - t_a) / 2
                    + sum over j of |d'f_x W_j| (half width of z_j)
                    + |d'f_u| (half width of u) + |d'f_x| misfit,

with c the middle of the cell, and derivatives over the whole cell. The overestimate of
this form falls with the square of the cell's size. Both bounds take f as weighted sums
of terms, some of which may cancel in d'f:

    f_i(y) = sum over j of A_ij w_j(y),    y = (t, x, u)

The terms w_j are the inputs, the number 1, and the values that are not sums, each once;
the weights A_ij are numbers. With x1' = -x1 + r and x2' = -x2 - r, for example, r
cancels in x1' + x2'; intervals of x1' and x2' would count the width of r twice.

f must be continuous. If it has a jump that the derivatives of f do not show (atan2 at
y = 0, x <= 0), the second bound is left out, see
`terminal_set/interval_arithmetic/smoothness.py`.

Source: Moore, Kearfott and Cloud (2009), Introduction to Interval Analysis,
section 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.tape import OPERATIONS, Node, Tape
from swarmstart.terminal_set.interval_arithmetic import (
    IntervalEvaluation,
    Kinks,
    expanded_tape,
    interval_function,
)

PAD = 2.0**-44
"""Padding, relative to the sum of the sizes of all terms. A float operation has a
relative error of at most 2^-53, so this is enough for sums of products of about 200
operations."""
_CONTROL_CELLS = 4
"""Number of parts of a control's range, for a control in which f is not affine."""
_MOST_CONTROL_BOXES = 32

_CODES = {name: code for code, name in OPERATIONS.items()}
_ONE = -1
"""Number of the term 1."""
_UNDERFLOW = 1e-280
"""Added to sizes of numbers, for products too small for a float."""

_Form = dict[int, tuple[float, float]]
"""Term -> its weight in a value, and the sum of the sizes of the weight's summands."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Motion:
    """The right-hand side f of a statement as functions of boxes of (t, x, u).

    Attributes:
        n: Number of states.
        terms: The terms that f is a weighted sum of.
        slopes: Derivatives of the terms, column after column: by t, by x, by u.
        weights: The weights of the sums, shape (n, terms).
        errors: Error bounds of the weights, shape (n, terms).
        kinks: Jumps of f that the derivatives of f do not show.
        controls: Boxes that give the extremes of f over the control box, lower and
            upper corners, shape (2, m, number).
    """

    n: int
    terms: IntervalEvaluation
    slopes: IntervalEvaluation
    weights: Array
    errors: Array
    kinks: Kinks
    controls: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Cells:
    """N parts of moving faces, as points (t, x) with x = W z + e.

    z_0 = s(t) is the level of the face, linear from t_a to t_b; every other z_j is in
    an interval, and e is a rounding error with |e_i| <= misfit.

    Attributes:
        times: t_a and t_b.
        directions: Direction d in which the rate is bounded, shape (N, n).
        frames: W, shape (N, n, n).
        levels: s at t_a and at t_b, shape (2, N).
        lower: Lower ends of z_j, j > 0, shape (N, n - 1).
        upper: Upper ends of z_j, same shape.
        misfit: Bound of |e_i|.
    """

    times: tuple[float, float]
    directions: Array
    frames: Array
    levels: Array
    lower: Array
    upper: Array
    misfit: float


def motion_of(statement: Statement) -> Motion:
    """Return the right-hand side of a statement as functions of boxes.

    Raises:
        UnknownIntervalOperationError: If f jumps, or has an operation without interval
            form.
    """
    y = ca.vertcat(statement.time, statement.states, statement.controls)
    rate = ca.densify(ca.vec(statement.rate))
    dynamics = ca.Function("dynamics", [y], [rate])
    sums = terms_of(dynamics)
    slopes = ca.densify(ca.vec(ca.jacobian(sums.terms, sums.symbols)))
    return Motion(
        n=statement.n,
        terms=interval_function(ca.Function("dynamics", [sums.symbols], [sums.terms])),
        slopes=interval_function(
            ca.Function("dynamics", [sums.symbols], [slopes]), takes_jumps=True
        ),
        weights=sums.weights,
        errors=sums.errors,
        kinks=Kinks(dynamics),
        controls=_control_boxes(statement),
    )


def _control_boxes(statement: Statement) -> Array:
    """Return boxes of u over which f has the same extremes as over all u.

    For a control in which f is affine for all values of the others, its two ends are
    enough.
    """
    low, high = statement.control_box
    parts = []
    for k in range(statement.m):
        u = statement.controls[k]
        if not ca.depends_on(ca.jacobian(statement.rate, u), u):
            parts.append([(low[k], low[k]), (high[k], high[k])])
        else:
            cuts = np.linspace(low[k], high[k], _CONTROL_CELLS + 1)
            parts.append(list(pairwise(cuts)))
    # One box is valid too: its bounds are only less tight.
    if np.prod([len(part) for part in parts]) > _MOST_CONTROL_BOXES:
        parts = [[(low[k], high[k])] for k in range(statement.m)]
    boxes = list(product(*parts))
    ends = np.array(boxes, dtype=np.float64).reshape(len(boxes), statement.m, 2)
    return np.ascontiguousarray(ends.transpose(2, 1, 0))


def rates_over(motion: Motion, cells: Cells) -> Array:
    """Return upper bounds of d'f(t, x, u) over cells, which include all controls u.

    The bound of a cell is infinite if none is known; d is the direction of the cell.

    Args:
        motion: The right-hand side f.
        cells: N cells.

    Returns:
        Bounds, shape (N,) [1/s].
    """
    start, stop = cells.times
    middle = 0.5 * (start + stop)
    z_low = np.column_stack([cells.levels.min(axis=0), cells.lower])
    z_high = np.column_stack([cells.levels.max(axis=0), cells.upper])
    z_middle = 0.5 * (z_low + z_high)
    low, high = _products(cells.frames, z_low, z_high)
    point = np.einsum("kij,kj->ki", cells.frames, z_middle)
    controls = motion.controls
    count, times = controls.shape[2], len(low)
    boxes = [
        np.vstack(
            [
                np.full(times * count, time),
                np.repeat(x, count, axis=0).T,
                np.tile(u, times),
            ]
        )
        for time, x, u in (
            (start, low - cells.misfit, controls[0]),
            (stop, high + cells.misfit, controls[1]),
            (middle, point, 0.5 * (controls[0] + controls[1])),
        )
    ]
    rates = _bounds(motion, _repeated(cells, count), boxes, 0.5 * (z_high - z_low))
    return np.asarray(rates.reshape(times, count).max(axis=1))


def _repeated(cells: Cells, count: int) -> Cells:
    """Return the cells, each repeated for every box of controls."""
    return Cells(
        times=cells.times,
        directions=np.repeat(cells.directions, count, axis=0),
        frames=np.repeat(cells.frames, count, axis=0),
        levels=np.repeat(cells.levels, count, axis=1),
        lower=np.repeat(cells.lower, count, axis=0),
        upper=np.repeat(cells.upper, count, axis=0),
        misfit=cells.misfit,
    )


def _bounds(motion: Motion, cells: Cells, boxes: list[Array], half: Array) -> Array:
    """Return the better of the two bounds of d'f (see above) for each box.

    Args:
        motion: The right-hand side f.
        cells: A cell for each box.
        boxes: Lower corners, upper corners and middles, each (1 + n + m, boxes).
        half: Half widths of the cells in z, before the cells were repeated.
    """
    low, high, middle = boxes
    number = low.shape[1]
    sums = _weights(motion, cells.directions)
    # One call for both bounds: the boxes, and their middles without width.
    values = motion.terms(np.hstack([low, middle]), np.hstack([high, middle]))
    over, at = (
        _greatest(sums, values[0][:, part].T, values[1][:, part].T)
        for part in (slice(number), slice(number, None))
    )
    half = np.repeat(half, number // len(half), axis=0)
    mean = at + _variation(motion, cells, sums, (low, high), half)
    jumps = motion.kinks(low, high)[1]
    mean[jumps | np.isnan(mean)] = np.inf
    return np.fmin(over, mean)


def _weights(motion: Motion, directions: Array) -> tuple[Array, Array]:
    """Return the weights of the terms in d'f, and their error bounds."""
    size = np.abs(directions)
    return (
        directions @ motion.weights,
        size @ (motion.errors + PAD * np.abs(motion.weights)),
    )


def _greatest(sums: tuple[Array, Array], low: Array, high: Array) -> Array:
    """Return the upper end of d'f for terms in [low, high], shape (N,)."""
    weights, errors = sums
    with np.errstate(invalid="ignore"):
        terms = np.maximum(weights * low, weights * high)
        off = (errors + PAD * np.abs(weights)) * np.maximum(np.abs(low), np.abs(high))
    is_part = (weights != 0.0) | (errors != 0.0)
    total = np.where(is_part, terms + off, 0.0).sum(
        axis=1
    )  # Not NaN: 0 times infinity.
    total[np.isnan(total)] = np.inf
    return np.asarray(total)


def _variation(
    motion: Motion,
    cells: Cells,
    sums: tuple[Array, Array],
    box: tuple[Array, Array],
    half: Array,
) -> Array:
    """Return a bound of the distance of d'f from its value in the middle of a cell."""
    n, number = motion.n, box[0].shape[1]
    weights, errors = (part[:, None, :] for part in sums)
    low, high = (
        ends.reshape(-1, weights.shape[2], number).transpose(2, 1, 0)
        for ends in motion.slopes(*box)
    )
    with np.errstate(invalid="ignore", over="ignore"):
        # Middle and radius of the terms' derivatives, (N, terms, 1 + n + m); of d'f's.
        value = 0.5 * (low + high)
        radius = 0.5 * (high - low) + PAD * np.abs(value)
        off = errors @ (np.abs(value) + radius)
        value, radius = _combined(weights, value, radius)
        radius += off
        along_x, radius_x = value[:, :, 1 : 1 + n], radius[:, :, 1 : 1 + n]
        along_z, radius_z = _combined(
            along_x, cells.frames, np.zeros_like(cells.frames)
        )
        radius_z += np.einsum("kij,kjl->kil", radius_x, np.abs(cells.frames))
        slope = (cells.levels[1] - cells.levels[0]) / (cells.times[1] - cells.times[0])
        span = 0.5 * (cells.times[1] - cells.times[0])
        in_time = np.abs(value[:, 0, 0] + along_z[:, 0, 0] * slope)
        in_time += radius[:, 0, 0] + radius_z[:, 0, 0] * np.abs(slope)
        in_time += PAD * np.abs(along_z[:, 0, 0] * slope)
        in_face = (np.abs(along_z) + radius_z)[:, 0, 1:] * half[:, 1:]
        controls = box[0][1 + n :].T, box[1][1 + n :].T
        # The middle of a box of controls is rounded: by less than PAD of their size.
        reach = 0.5 * (controls[1] - controls[0]) + PAD * np.abs(controls[1])
        in_control = (np.abs(value) + radius)[:, 0, 1 + n :] * reach
        astray = (np.abs(along_x) + radius_x)[:, 0].sum(axis=1) * cells.misfit
        total = in_time * span + in_face.sum(axis=1) + in_control.sum(axis=1) + astray
        # The pad holds the roundings of the halves and of these sums, all terms >= 0.
        return np.asarray(total * (1.0 + PAD))


def _combined(rows: Array, value: Array, radius: Array) -> tuple[Array, Array]:
    """Return rows @ [value +- radius], as middle and radius, padded."""
    combined = rows @ value
    size = np.abs(rows) @ (PAD * np.abs(value) + radius * (1.0 + PAD))
    return combined, size


def _products(frames: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the range of W z for z in [low, high], without rounding, each (N, n)."""
    one, other = frames * low[:, None, :], frames * high[:, None, :]
    return np.minimum(one, other).sum(axis=2), np.maximum(one, other).sum(axis=2)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Terms:
    """A function of y as weighted sums A w(y) of terms w.

    Attributes:
        symbols: y, shape (inputs, 1).
        terms: w, shape (number, 1), of y.
        weights: A in floats, shape (outputs, number).
        errors: Error bounds of these floats, shape (outputs, number).
    """

    symbols: ca.SX
    terms: ca.SX
    weights: Array
    errors: Array


def terms_of(function: ca.Function) -> Terms:
    """Return a function as weighted sums of terms.

    Args:
        function: Function y (n, 1) -> a column.

    Raises:
        UnknownIntervalOperationError: If the function has an operation that is unknown.
    """
    tape = expanded_tape(function)
    forms: list[_Form] = []
    for number, node in enumerate(tape.nodes):
        forms.append(_form(number, node, forms))
    outputs = [forms[number] for number in tape.outputs[0]]
    used = sorted({term for form in outputs for term in form})
    column = {term: j for j, term in enumerate(used)}
    weights, sizes = np.zeros((2, len(outputs), len(used)))
    for i, form in enumerate(outputs):
        for term, (weight, size) in form.items():
            weights[i, column[term]], sizes[i, column[term]] = weight, size + _UNDERFLOW
    symbols = ca.SX.sym("y", function.numel_in(0))
    values = _replayed(tape, symbols)
    terms = [ca.SX(1) if term == _ONE else values[term] for term in used]
    # Each of the tape's operations rounds a number once at most.
    roundings = max(PAD, len(tape.nodes) * 2.0**-51)
    return Terms(
        symbols=symbols,
        terms=ca.densify(ca.vertcat(*terms)),
        weights=weights,
        errors=roundings * sizes,
    )


def _form(number: int, node: Node, forms: list[_Form]) -> _Form:
    """Return a value as a sum of terms; as a term itself if it is not a sum."""
    if node.operation == "constant" and np.isfinite(node.value):
        return {_ONE: (node.value, abs(node.value))}
    itself = {number: (1.0, 1.0)}
    if node.operation in ("constant", "input"):
        return itself
    one, other = (forms[node.arguments[k]] for k in (0, -1))
    if node.operation in ("add", "sub"):
        return _sum(one, _scaled(other, 1.0 if node.operation == "add" else -1.0))
    if node.operation in ("neg", "twice"):
        return _scaled(one, -1.0 if node.operation == "neg" else 2.0)
    if node.operation in ("mul", "div"):
        return _product(one, other, is_quotient=node.operation == "div") or itself
    return itself


def _product(one: _Form, other: _Form, *, is_quotient: bool) -> _Form | None:
    """Return a product with, or quotient by, a number; None if neither is a number."""
    factor, divisor = _number(one), _number(other)
    if is_quotient:
        return _scaled(one, 1.0 / divisor) if divisor else None
    if factor is not None:
        return _scaled(other, factor)
    return _scaled(one, divisor) if divisor is not None else None


def _number(form: _Form) -> float | None:
    """Return the exact number that a value is; None if it is not an exact number."""
    weight, size = form.get(_ONE, (0.0, 0.0))
    # A number that is a rounded sum is not exact: it stays a term.
    return weight if set(form) == {_ONE} and abs(weight) == size else None


def _sum(one: _Form, other: _Form) -> _Form:
    total = dict(one)
    for term, (weight, size) in other.items():
        before = total.get(term, (0.0, 0.0))
        total[term] = before[0] + weight, before[1] + size
    return total


def _scaled(form: _Form, factor: float) -> _Form:
    return {
        term: (weight * factor, size * abs(factor))
        for term, (weight, size) in form.items()
    }


def _replayed(tape: Tape, symbols: ca.SX) -> list[ca.SX]:
    """Return all values of a tape of one argument as expressions."""
    values: list[ca.SX] = []
    for node in tape.nodes:
        if node.operation == "constant":
            values.append(ca.SX(node.value))
        elif node.operation == "input":
            values.append(symbols[node.arguments[1]])
        else:
            arguments = [values[a] for a in node.arguments]
            code = _CODES[node.operation]
            if len(arguments) == 1:
                values.append(ca.SX.unary(code, *arguments))
            else:
                values.append(ca.SX.binary(code, *arguments))
    return values
