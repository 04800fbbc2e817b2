"""A tape without controls, evaluated with Taylor models, elementary functions included.

A function g of a model a = a_0 + N, with |N| <= rho over the box, is

    sum for k <= ORDER of g_k N^k  +  g^(ORDER+1)(xi) / (ORDER+1)! N^(ORDER+1)

with g_k = g^(k)(a_0)/k! and xi within rho of a_0 (Taylor, Lagrange's remainder). Each
elementary function gives g_0 ... g_3, sizes that bound their relative errors, and a
bound of the last factor.

NumPy's exp, log, sqrt, sin, cos and arctan are assumed to be right to 16 units in the
last place of the result's size (of 1 for sin and cos, so that cancellation does not
matter).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction

import numpy as np

from swarmstart.ocp.lower_bound.checker.controls import Node, Split
from swarmstart.ocp.lower_bound.checker.models import (
    GROWTH,
    ORDER,
    TINY,
    Array,
    Model,
)
from swarmstart.terminal_set.checker import NEVER, Deadline

ELEMENTARY = 2.0**-44
"""Relative error of the float formulas of g_k below: 16 ulp and a few roundings."""
_FARTHEST_ANGLE = 1e6
_STEPS_A_LOOK = 32  # instructions between looks at the clock
_LARGEST_WHOLE = 64  # exponents up to here are products, others exp(b log a)

Value = Model | Fraction
"""A value over boxes: models, or one number for all boxes."""


def composed(a: Model, factors: list[Array], last: Array, sizes: list[Array]) -> Model:
    """Return g(a) from Taylor coefficients of g.

    Args:
        a: The argument.
        factors: g_0, ..., g_ORDER at a's middle, each (N,).
        last: Upper bound of |g^(ORDER+1)| / (ORDER+1)! within a's spread of its middle.
        sizes: For each factor a size, (N,); its error is at most ELEMENTARY times that.
    """
    moving = a.coefficients.copy()
    moving[0] = 0.0
    rest = Model(a.algebra, moving, a.error)
    total = rest.scaled(factors[ORDER])
    for k in range(ORDER - 1, 0, -1):
        total = total.shifted(factors[k]) * rest
    total = total.shifted(factors[0])
    rho = rest.spread
    # Of the factors, of underflow, and of Lagrange's remainder.
    noise = sum(ELEMENTARY * size * rho**k for k, size in enumerate(sizes))
    error = noise + TINY * (1.0 + rho**ORDER) + last * rho ** (ORDER + 1)
    return total.widened(error * GROWTH)


def _composed(a: Model, factors: list[Array], last: Array) -> Model:
    # The remainder's own rounding is far below this share of it.
    sizes = [np.abs(factor) for factor in factors]
    return composed(a, factors, last * (1.0 + ELEMENTARY), sizes)


def _least_size(a: Model) -> Array:
    """Lower bound of |a| over the box; NaN if 0 may be in it."""
    least = np.maximum(a.lower, -a.upper)
    return np.where(least > 0.0, least, np.nan)


def _positive(a: Model) -> Array:
    """Lower bound of a over the box; NaN if it may reach 0."""
    low = a.lower
    return np.where(low > 0.0, low, np.nan)


def inverse(a: Model) -> Model:
    """Return 1/a."""
    r = 1.0 / a.middle
    factors = [r, -(r**2), r**3, -(r**4)]
    # |g^(4)| / 4! is largest at the end of the box that is nearest to 0.
    return _composed(a, factors, 1.0 / _least_size(a) ** 5)


def exponential(a: Model) -> Model:
    """Return e^a."""
    e = np.exp(a.middle)
    return _composed(a, [e, e, e / 2.0, e / 6.0], np.exp(a.upper) / 24.0)


def logarithm(a: Model) -> Model:
    """Return log(a)."""
    low, r = _positive(a), 1.0 / a.middle
    factors = [np.log(a.middle), r, -(r**2) / 2.0, r**3 / 3.0]
    return _composed(a, factors, 1.0 / (4.0 * low**4))


def root(a: Model) -> Model:
    """Return sqrt(a), for a > 0 over the box."""
    low, y = _positive(a), np.sqrt(a.middle)
    r = 1.0 / a.middle
    factors = [y, y * r / 2.0, -y * r**2 / 8.0, y * r**3 / 16.0]
    return _composed(a, factors, 5.0 / 128.0 / (low**3 * np.sqrt(low)))


def _angles(a: Model, turns: int) -> Model:
    sine, cosine = np.sin(a.middle), np.cos(a.middle)
    cycle = [sine, cosine, -sine, -cosine, sine, cosine, -sine, -cosine]
    scales = (1.0, 1.0, 2.0, 6.0)
    factors = [cycle[turns + k] / scales[k] for k in range(ORDER + 1)]
    one = np.ones_like(sine)
    # Beyond it, neither the spacing of floats nor the library's reduction is reliable.
    far = ~(np.abs(a.middle) <= _FARTHEST_ANGLE)
    # |g^(4)| <= 1, over 4!.
    found = composed(a, factors, one / 24.0 * GROWTH, [one] * (ORDER + 1))
    return _unless(far, found)


def _unless(bad: np.ndarray, model: Model) -> Model:
    """Return the model, or [-1, 1] in bad boxes."""
    if not bad.any():
        return model
    coefficients, error = model.coefficients.copy(), model.error.copy()
    coefficients[:, bad] = 0.0
    error[bad] = 1.0
    return Model(model.algebra, coefficients, error)


def sine(a: Model) -> Model:
    """Return sin(a)."""
    return _angles(a, 0)


def cosine(a: Model) -> Model:
    """Return cos(a)."""
    return _angles(a, 1)


def arctangent(a: Model) -> Model:
    """Return atan(a); |atan^(n)| <= (n - 1)!."""
    x = a.middle
    w = 1.0 / (1.0 + x * x)
    factors = [np.arctan(x), w, -x * w**2, (3.0 * x * x - 1.0) * w**3 / 3.0]
    sizes = [np.abs(factor) for factor in factors[:ORDER]]
    sizes.append((3.0 * x * x + 1.0) * w**3)  # its difference may cancel
    last = np.full_like(x, 0.25)  # 3! / 4!.
    return composed(a, factors, last, sizes)


def hyperbolic_tangent(a: Model) -> Model:
    """Return tanh(a) = -sign tanh(-sign a), by e^(-2 sign a), which is below 1."""
    sign = np.where(a.middle > 0.0, -1.0, 1.0)
    e = exponential(a.scaled(2.0 * sign))
    return ((e.shifted(-1.0)) * inverse(e.shifted(1.0))).scaled(sign)


def absolute(a: Model) -> Model:
    """Return |a|; over a kink l a + [0, M], for any l in [-1, 1].

    |a| - l a is convex, 0 at a = 0, and so at most its larger end over [low, high].
    """
    low, high = a.lower, a.upper
    with np.errstate(all="ignore"):
        slope = np.clip((high + low) / (high - low), -1.0, 1.0)
    slope = np.where(low >= 0.0, 1.0, np.where(high <= 0.0, -1.0, slope))
    most = np.maximum(high * (1.0 - slope), -low * (1.0 + slope)) * GROWTH
    half = np.where((low >= 0.0) | (high <= 0.0), 0.0, most / 2.0)
    return a.scaled(slope).shifted(half, half)


def power(a: Model, b: Model | float) -> Model:
    """Return a^b; by products if b is a constant whole number."""
    if isinstance(b, Model):
        return exponential(b * logarithm(a))
    if b == int(b) and abs(b) <= _LARGEST_WHOLE:
        raised = _whole_power(a, int(abs(b)))
        return inverse(raised) if b < 0 else raised
    if b == 0.5:  # noqa: PLR2004
        return root(a)
    return exponential(logarithm(a).scaled(b))


def _whole_power(a: Model, n: int) -> Model:
    if n == 0:
        return a.algebra.constant(np.ones_like(a.middle))
    half = _whole_power(a, n // 2) if n > 1 else None
    squared = a if half is None else half * half
    return squared * a if n > 1 and n % 2 else squared


def _halves(a: Model, b: Model, sign: float) -> Model:
    return (a + b + absolute(a - b).scaled(sign)).scaled(0.5)


FUNCTIONS: dict[str, Callable[..., Model]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a * inverse(b),
    "pow": power,
    "fmin": lambda a, b: _halves(a, b, -1.0),
    "fmax": lambda a, b: _halves(a, b, 1.0),
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: a.scaled(2.0),
    "inv": inverse,
    "fabs": absolute,
    "sqrt": root,
    "sin": sine,
    "cos": cosine,
    "tan": lambda a: sine(a) * inverse(cosine(a)),
    "exp": exponential,
    "log": logarithm,
    "atan": arctangent,
    "tanh": hyperbolic_tangent,
}
"""Name of an operation on a tape -> the function of models."""


class Program:
    """The instructions that some wanted values need, in order.

    Attributes:
        wanted: Numbers of the wanted values.
    """

    @classmethod
    def of(cls, split: Split, wanted: Iterable[int]) -> Program:
        """Return the program of a problem, which stops at the problem's deadline."""
        return cls(split.nodes, wanted, split.deadline)

    def __init__(
        self,
        nodes: Sequence[Node],
        wanted: Iterable[int],
        deadline: Deadline = NEVER,
    ) -> None:
        """Select the instructions that the wanted values need."""
        self.wanted, self._deadline = frozenset(wanted), deadline
        needed = set(self.wanted)
        for number in range(len(nodes) - 1, -1, -1):
            if number in needed and nodes[number].operation != "point":
                needed.update(nodes[number].operands)
        self._steps = [(number, nodes[number]) for number in sorted(needed)]
        last: dict[int, int] = {}
        for number, node in self._steps:
            if node.operation != "point":
                last |= dict.fromkeys(node.operands, number)
        # Models of many boxes are large: each is dropped after its last use.
        self._done: dict[int, list[int]] = {}
        for operand, number in last.items():
            if operand not in self.wanted:
                self._done.setdefault(number, []).append(operand)

    def __call__(self, variables: Sequence[Model]) -> dict[int, Value]:
        """Evaluate the wanted values.

        Args:
            variables: Models of t, x and the boxed controls.

        Returns:
            Number of a wanted value -> the value.

        Raises:
            TimeIsUpError: If the deadline has passed.
        """
        values: dict[int, Value] = {}
        for place, (number, node) in enumerate(self._steps):
            # An instruction takes up to some milliseconds, for all boxes together.
            if place % _STEPS_A_LOOK == 0:
                self._deadline.check()
            if node.operation == "const":
                values[number] = node.value
            elif node.operation == "point":
                values[number] = variables[node.operands[0]]
            else:
                operands = [values[operand] for operand in node.operands]
                values[number] = _applied(node.operation, operands, variables[0])
            for operand in self._done.get(number, ()):
                values.pop(operand, None)
        return {number: values[number] for number in self.wanted}


def rounded(number: Fraction) -> tuple[float, float]:
    """Return the nearest float and an upper bound of its distance."""
    try:
        near = float(number)
    except OverflowError:
        return math.nan, math.nan  # Nothing is known, so nothing is proven.
    return near, math.nextafter(float(abs(number - Fraction(near))), math.inf)


def as_model(value: Value, like: Model) -> Model:
    """Return a value as models over the same boxes as another."""
    if isinstance(value, Model):
        return value
    near, error = rounded(value)
    return like.algebra.constant(0.0 * like.error + near, error)


def times(a: Value, b: Value, like: Model) -> Value:
    """Return a product."""
    if isinstance(a, Fraction):
        a, b = b, a
    if isinstance(a, Fraction) and isinstance(b, Fraction):
        return a * b
    if isinstance(a, Model) and isinstance(b, Model):
        return a * b
    if isinstance(a, Model) and isinstance(b, Fraction):
        factor, error = rounded(b)
        scaled = a.scaled(factor)
        return scaled.widened((a.size + a.error) * error) if error > 0.0 else scaled
    raise TypeError  # Not reached: values are models or fractions.


def plus(a: Value, b: Value) -> Value:
    """Return a sum."""
    if isinstance(a, Fraction):
        a, b = b, a
    if isinstance(a, Model):
        return a + b if isinstance(b, Model) else a.shifted(*rounded(b))
    return a + b  # type: ignore[operator]


def _applied(operation: str, operands: list[Value], like: Model) -> Value:
    first, last = operands[0], operands[-1]
    if operation == "mul":
        return times(first, last, like)
    if operation == "add" or (operation == "sub" and isinstance(last, Fraction)):
        return plus(first, last if operation == "add" else -last)
    if operation == "div" and isinstance(first, Fraction):
        return times(inverse(as_model(last, like)), first, like)
    if operation == "div" and isinstance(last, Fraction) and last:
        return times(first, 1 / last, like)
    models = [as_model(operand, like) for operand in operands]
    if operation == "pow" and isinstance(operands[1], Fraction):
        exponent, error = rounded(operands[1])
        # `rounded` reports the smallest float as the error of an exact number.
        if operands[1] == Fraction(exponent) and error < 1e-300:  # noqa: PLR2004
            return power(models[0], exponent)
    return FUNCTIONS[operation](*models)
