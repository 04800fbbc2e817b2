"""Detection of comparisons across which expressions stay smooth, as in spline tables.

A comparison x < k with a number k is smooth in an expression if its value, slope and
curvature in x are the same at k on both sides. The functions of x alone that use the
comparison are tested one by one, at x = k with the comparison held true and false. If
one agrees on both sides, all that uses it is smooth, too. If one that does not agree is
used by a function of other variables, or is a result, the comparison stays a kink.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array

Flags = NDArray[np.bool_]

_ORDERED = (ca.OP_LT, ca.OP_LE)
_TIGHT, _LOOSE = 1e-9, 1e-6
"""Relative differences allowed for a value, and for its derivatives."""
_ROUNDING = 1e-11
"""Relative rounding error of a value, which its derivatives amplify."""


@dataclass(frozen=True, slots=True)
class _Comparison:
    """A comparison of a value with a number.

    Attributes:
        node: Hash of the comparison.
        of: Hash of the value.
        at: The number compared with.
        below: Whether the comparison is true below the number.
    """

    node: int
    of: int
    at: float
    below: bool


def smooth_comparisons(nodes: Sequence[ca.SX], results: Sequence[ca.SX]) -> set[int]:
    """Return the hashes of the comparisons across which all results stay smooth.

    Args:
        nodes: All different scalar expressions, each after its dependencies.
        results: The expressions among them that are used outside.
    """
    by_value: dict[int, list[_Comparison]] = {}
    for comparison in filter(None, map(_comparison, nodes)):
        by_value.setdefault(comparison.of, []).append(comparison)
    if not by_value:
        return set()
    dependencies = {n.element_hash(): _dependencies(n) for n in nodes}
    constant = {n.element_hash() for n in nodes if n.is_constant()}
    used: dict[int, list[int]] = {}
    for user, below in dependencies.items():
        for node in below:
            used.setdefault(node, []).append(user)
    ends = {r.element_hash() for r in results}
    smooth: set[int] = set()
    for of, comparisons in by_value.items():
        alone = _functions_of(of, dependencies, constant)
        seen_by_others = np.array(
            [n in ends or any(u not in alone for u in used.get(n, ())) for n in alone]
        )
        functions = [n for n in nodes if n.element_hash() in alone]
        rough = _rough(functions, comparisons, {n: i for i, n in enumerate(alone)},
                       dependencies)  # fmt: skip
        kinked = (rough & seen_by_others[:, None]).any(axis=0)
        at = _places(comparisons)
        smooth |= {c.node for c in comparisons if not kinked[at.index(c.at)]}
    return smooth


def _dependencies(node: ca.SX) -> tuple[int, ...]:
    if node.is_leaf():
        return ()
    return tuple(node.dep(i).element_hash() for i in range(node.n_dep()))


def _comparison(node: ca.SX) -> _Comparison | None:
    """Return the comparison of a value with a number; None for any other node."""
    if node.is_leaf() or node.op() not in _ORDERED:
        return None
    for number, value, below in ((1, 0, True), (0, 1, False)):
        if node.dep(number).is_constant() and not node.dep(value).is_constant():
            return _Comparison(
                node.element_hash(),
                node.dep(value).element_hash(),
                float(node.dep(number)),
                below,
            )
    return None


def _places(comparisons: Sequence[_Comparison]) -> list[float]:
    return sorted({c.at for c in comparisons})


def _functions_of(
    value: int, dependencies: Mapping[int, tuple[int, ...]], constant: set[int]
) -> dict[int, None]:
    """Return the functions of one value and of numbers alone, in order."""
    alone: dict[int, None] = {}  # A set that keeps its order.
    for node, below in dependencies.items():
        depends = any(d in alone or d == value for d in below)
        if depends and all(d in alone or d in constant or d == value for d in below):
            alone[node] = None
    return alone


def _rough(
    functions: Sequence[ca.SX],
    comparisons: Sequence[_Comparison],
    row: Mapping[int, int],
    dependencies: Mapping[int, tuple[int, ...]],
) -> Flags:
    """Return whether each function is not smooth at each place, (functions, places)."""
    at = _places(comparisons)
    agree = _agreeing(functions, comparisons, at)
    switches = {c.node: at.index(c.at) for c in comparisons}
    rough = np.zeros(agree.shape, dtype=bool)
    for i, node in enumerate(functions):
        key = node.element_hash()
        for below in dependencies[key]:
            if below in row:
                rough[i] |= rough[row[below]]
        if key in switches:
            rough[i, switches[key]] = True
        # A function that agrees on both sides ends the kink of its arguments.
        rough[i] &= ~agree[i]
    return rough


def _agreeing(
    functions: Sequence[ca.SX], comparisons: Sequence[_Comparison], at: Sequence[float]
) -> Flags:
    """Return whether value, slope and curvature agree on both sides of each place."""
    x, flags = ca.SX.sym("x"), ca.SX.sym("flags", len(comparisons))
    values = _values(functions, comparisons, x, flags)
    slopes = ca.jtimes(values, x, ca.SX(1))
    curvatures = ca.jtimes(slopes, x, ca.SX(1))
    sides = ca.Function("sides", [x, flags], [values, slopes, curvatures])
    places = np.array(at)
    numbers = np.array([[c.at] for c in comparisons])
    below = np.array([[c.below] for c in comparisons])
    around = _around(functions, comparisons)

    def evaluated(x: Array, is_left: Flags) -> list[Array]:
        outcomes = np.where(is_left, below, ~below).astype(float)
        return [np.array(ca.DM(v)) for v in sides.map(x.size)(x[None, :], outcomes)]

    left = evaluated(places, places <= numbers)
    right = evaluated(places, places < numbers)
    beside = evaluated(around, around < numbers)
    gap = np.diff(np.unique(np.concatenate([places, around]))).min()
    agree = np.ones((len(functions), len(at)), dtype=bool)
    error = np.zeros((len(functions), 1))
    for part, (one, other, some) in enumerate(zip(left, right, beside, strict=True)):
        seen = np.abs(np.hstack([one, some]))
        size = np.where(np.isfinite(seen), seen, 0.0).max(axis=1, keepdims=True)
        # Each derivative divides the rounding of the values by their distance.
        error = error / gap if part else _ROUNDING * size
        allowed = (_LOOSE if part else _TIGHT) * size + error
        with np.errstate(invalid="ignore"):
            agree &= np.abs(one - other) <= allowed  # NaN does not agree.
    return agree


def _around(functions: Sequence[ca.SX], comparisons: Sequence[_Comparison]) -> Array:
    """Return points at which the size of the functions is evaluated.

    They span the numbers that the value is compared with, or that are subtracted from
    it.
    """
    of, numbers = comparisons[0].of, {c.at for c in comparisons}
    for node in functions:
        if node.op() in (ca.OP_ADD, ca.OP_SUB):
            for one, other in ((0, 1), (1, 0)):
                if node.dep(one).element_hash() == of and node.dep(other).is_constant():
                    taken = float(node.dep(other))
                    numbers.add(taken if node.op() == ca.OP_SUB else -taken)
    low, high = min(numbers), max(numbers)
    room = (high - low) / 10 or max(1.0, abs(high))  # A single number has no span.
    return np.linspace(low - room, high + room, 8)


def _values(
    functions: Sequence[ca.SX],
    comparisons: Sequence[_Comparison],
    x: ca.SX,
    flags: ca.SX,
) -> ca.SX:
    """Return the functions of x, with given outcomes of the comparisons."""
    made = {c.of: x for c in comparisons}
    made |= {c.node: flags[i] for i, c in enumerate(comparisons)}
    for node in functions:
        key = node.element_hash()
        if key in made:
            continue
        given = [
            made.get(d.element_hash(), d)
            for d in (node.dep(i) for i in range(node.n_dep()))
        ]
        one = len(given) == 1
        op = node.op()
        made[key] = ca.SX.unary(op, *given) if one else ca.SX.binary(op, *given)
    return ca.vertcat(*[made[node.element_hash()] for node in functions])
