"""CasADi's interpolants, read from their serialisation, as scalar expressions.

An interpolant in an SX expression is a call, which machine code cannot make. Its grid
and values, or its knots and coefficients, are in `Function.serialize({"debug": True})`,
each after its name: a vector is "V", "J" and its length, then "d" or "J" and eight
bytes for each number; a byte is two letters, a to p, the lower half first. Derivatives
that CasADi has already made are stored between the knots and the coefficients, with
similar names. The result is compared with the interpolant before it is used.

Source: CasADi 3.8.2, casadi/core/serializing_stream.cpp, interpolant_impl.hpp and
bspline_impl.hpp.
"""

import itertools
import math
import re
import struct
from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.interpolation.splines import Spline

Splines = tuple[Spline, ...]
"""One spline for each output of an interpolant."""

_CLOSE = 1e-9
"""Largest relative difference between an interpolant and the expression read."""
_MOST_INPUTS = 2
_LONGEST = 100_000
"""Largest number of values of an interpolant; expressions of more are too large."""


def without_interpolants(function: ca.Function) -> ca.Function:
    """Return an SX function with its interpolants as expressions, if all can be read.

    Args:
        function: An SX function. It is returned unchanged if it has no calls, or if a
            call is not an interpolant with one or two inputs.
    """
    if not function.find_functions(0):
        return function
    symbols = function.sx_in()
    replaced = _Replaced()
    try:
        outputs = [replaced.of(e) for e in function.call(symbols)]
    except _UnreadableError:
        return function
    return ca.Function(
        function.name(), symbols, outputs, function.name_in(), function.name_out()
    )


class _UnreadableError(Exception):
    """A call of another function, or an interpolant that cannot be read."""


class _Replaced:
    """Replacement of interpolants in expressions, node by node."""

    def __init__(self) -> None:
        self._new: dict[int, ca.SX] = {}
        self._old: list[ca.SX] = []  # Kept, so that no hash is reused.
        self._read: dict[int, Splines | None] = {}

    def of(self, expression: ca.SX) -> ca.SX:
        """Return an expression without interpolants.

        Raises:
            _UnreadableError: If it calls another function.
        """
        entries = [self._node(expression.nz[i]) for i in range(expression.nnz())]
        return ca.SX(expression.sparsity(), ca.vertcat(ca.SX(0, 1), *entries))

    def _node(self, top: ca.SX) -> ca.SX:
        stack = [top]
        while stack:
            node = stack[-1]
            key = node.element_hash()
            if key in self._new:
                stack.pop()
                continue
            caller = node.dep(0) if node.is_output() else node
            below = [] if node.is_leaf() else _dependencies(caller)
            missing = [d for d in below if d.element_hash() not in self._new]
            if missing:
                stack += missing
                continue
            stack.pop()
            self._old.append(node)
            self._new[key] = self._made(node, caller, below)
        return self._new[top.element_hash()]

    def _made(self, node: ca.SX, caller: ca.SX, below: Sequence[ca.SX]) -> ca.SX:
        given = [self._new[d.element_hash()] for d in below]
        if node.is_output():
            called = caller.which_function()
            key = hash(called)
            if key not in self._read:
                self._read[key] = read_interpolant(called)
            splines = self._read[key]
            if splines is None:
                raise _UnreadableError
            return splines[node.which_output()].expression(*given)
        same = zip(given, below, strict=True)
        if all(g.element_hash() == d.element_hash() for g, d in same):
            return node
        if len(given) == 1:
            return ca.SX.unary(node.op(), given[0])
        return ca.SX.binary(node.op(), *given)


def _dependencies(node: ca.SX) -> list[ca.SX]:
    return [node.dep(i) for i in range(node.n_dep())]


def read_interpolant(function: ca.Function) -> Splines | None:
    """Return the splines of an interpolant, one for each output.

    Args:
        function: Any function.

    Returns:
        The splines; None if the function is not an interpolant with a fixed grid and
        fixed values and one or two inputs, or if CasADi's format is unknown.
    """
    kind = function.class_name()
    if kind not in ("LinearInterpolant", "BSplineInterpolant") or function.n_in() != 1:
        return None
    data = _bytes(function.serialize({"debug": True}))
    try:
        outputs = function.numel_out(0)
        is_linear = kind == "LinearInterpolant"
        splines = _linear(data) if is_linear else _bspline(data, outputs)
    except (StopIteration, struct.error, ValueError):
        return None
    inputs = len(splines[0].knots)
    fits = inputs <= _MOST_INPUTS and function.numel_in(0) == inputs
    return splines if fits and _agree(function, splines) else None


def _linear(data: bytes) -> Splines:
    grids = _stacked(data, b"Interpolant::")
    values = next(_vectors(data, b"Interpolant::values", b"d"))
    knots = [np.concatenate([g[:1], g, g[-1:]]) for g in grids]
    return _splines(knots, [1] * len(knots), values, "extrapolate")


def _bspline(data: bytes, outputs: int) -> Splines:
    degrees = [int(d) for d in next(_vectors(data, b"BSplineCommon::degree", b"J"))]
    knots = _stacked(data, b"BSplineCommon::")
    sizes = [k.size - d - 1 for k, d in zip(knots, degrees, strict=True)]
    count = outputs * math.prod(sizes)  # A derivative has fewer.
    found = _vectors(data, b"BSpline::coeffs", b"d")
    coefficients = next(one for one in found if one.size == count)
    return _splines(knots, degrees, coefficients, "zero")


def _splines(
    knots: Sequence[Array], degrees: Sequence[int], stacked: Array, outside: str
) -> Splines:
    """Return a spline for each output; the output's number changes fastest."""
    sizes = [k.size - d - 1 for k, d in zip(knots, degrees, strict=True)]
    each = np.reshape(stacked, (-1, *sizes), order="F")
    if not each.size:
        raise ValueError("there are no coefficients")
    return tuple(
        Spline(
            knots=tuple(knots),
            degrees=tuple(degrees),
            coefficients=coefficients,
            outside="zero" if outside == "zero" else "extrapolate",
        )
        for coefficients in each
    )


def _stacked(data: bytes, owner: bytes) -> list[Array]:
    """Return the grid or the knots of each input."""
    name = b"grid" if owner == b"Interpolant::" else b"knots"
    numbers = next(_vectors(data, owner + name, b"d"))
    offsets = next(_vectors(data, owner + b"offset", b"J")).astype(int)
    if len(offsets) == 0 or offsets[-1] != numbers.size:
        raise ValueError("the grid does not have its stated length")
    return [numbers[a:b] for a, b in itertools.pairwise(offsets)]


def _vectors(data: bytes, name: bytes, kind: bytes) -> Iterator[Array]:
    """Yield the numbers after each occurrence of a name.

    Raises:
        ValueError: If they are not in the expected format.
    """
    form = "<cq" if kind == b"J" else "<cd"
    for head in re.finditer(re.escape(name + b"VJ"), data):
        (count,) = struct.unpack_from("<q", data, head.end())
        if not 0 <= count <= _LONGEST:
            raise ValueError(f"expected at most {_LONGEST} numbers, found {count}")
        first = head.end() + 8
        found = [struct.unpack_from(form, data, first + 9 * i) for i in range(count)]
        if any(mark != kind for mark, _ in found):
            raise ValueError(f"expected numbers behind {name!r}")
        yield np.array([number for _, number in found], dtype=np.float64)


def _bytes(text: str) -> bytes:
    """Return the bytes of a serialisation."""
    halves = np.frombuffer(text.encode(), dtype=np.uint8) - ord("a")
    return bytes(halves[0::2] | (halves[1::2] << 4))


def _agree(function: ca.Function, splines: Splines) -> bool:
    """Return whether splines agree with an interpolant, inside and outside its grid."""
    # A fixed seed: a function is always judged in the same way.
    rng = np.random.default_rng(0)
    points = []
    for knots in splines[0].knots:
        first, last = knots[0], knots[-1]
        room = (last - first) / 4
        inside = rng.uniform(first, last, 30)
        around = rng.uniform(first - room, last + room, 10)
        points.append(np.concatenate([[first, last], inside, around]))
    x = ca.SX.sym("x", len(points))
    entries = [x[i] for i in range(len(points))]
    outputs = ca.vertcat(*[s.expression(*entries) for s in splines])
    columns, n = np.stack(points), len(points[0])
    with np.errstate(all="ignore"):
        wanted = np.array(function.map(n)(columns))
        found = np.array(ca.Function("found", [x], [outputs]).map(n)(columns))
    if wanted.shape != found.shape:
        return False
    size = np.abs(wanted).max(axis=1, keepdims=True)
    return bool((np.abs(found - wanted) <= _CLOSE * size).all())
