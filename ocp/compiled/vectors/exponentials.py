"""Powers, hyperbolic and related functions on vectors, by exponentials and logarithms.

A power base^exponent is exp(exponent log base). The logarithm of the base is a sum of
two doubles, accurate to 2^-64, so that the power is accurate to 2 units in the last
place for any exponent. If the base is not positive and normal, or the result is out of
range, the C library computes the power, one individual after another; see
elementary.py. A positive power of 0 is 0, without the C library, since many states
start at 0. Powers in single precision are computed in double. The coefficients of the
logarithm interpolate at the nodes of Chebyshev polynomials (computed with mpmath).

Source: W. Kahan, Branch cuts for complex elementary functions (1987), log(1 + x) and
the inverse hyperbolic functions; other coefficients in coefficients.py.
"""

import math

from swarmstart.ocp.compiled.vectors.coefficients import table
from swarmstart.ocp.compiled.vectors.elementary import (
    exp,
    exp_of_sum,
    exponent_and_rest,
    log_of_parts,
    rational,
    reduced_exponent,
    scaled,
    served_by_library,
    with_ends_of_log,
)
from swarmstart.ocp.compiled.vectors.vector_ir import DOUBLE, VectorIR

# 2/3 in two parts, then the series of log((1 + s) / (1 - s)) / s^5 in s^2.
_TWO_THIRDS = (0.6666666666666666, 3.700743415417188e-17)
_LOG_SERIES = (
    0.11725771221853913,
    0.11705988156496179,
    0.13334813971292214,
    0.15384594791762346,
    0.1818181833699257,
    0.2222222222164882,
    0.2857142857142938,
    0.4,
)
# k times the first part is exact.
_LN2_LONG = (0.6931471805598903, 5.497923018708371e-14)
_LARGEST_LOG = 708.0


def expm1(ir: VectorIR, x: str) -> str:
    """Return exp x - 1 = 2^k ((exp r - 1) + (1 - 2^-k)), accurate near 0."""
    form, known = ir.form, table(ir.form)
    # Below this limit the result is -1 to the last digit; above it 2^-k is finite.
    lowest = -(form.significand + 5) * math.log(2.0)
    r, k = reduced_exponent(ir, x, (lowest, known.exp_range[1]))
    near = ir.fma(ir.mul(r, r), ir.polynomial(r, known.exp[:-2]), r)
    inverse = scaled(ir, ir.constant(1.0), ir.neg(k))
    value = scaled(ir, ir.add(near, ir.sub(ir.constant(1.0), inverse)), k)
    return ir.intrinsic("copysign", value, x)  # -0 keeps its sign.


def log1p(ir: VectorIR, x: str) -> str:
    """Return log(1 + x), accurate near 0: the rounding error of 1 + x is added."""
    one = ir.constant(1.0)
    whole = ir.add(one, x)
    added = ir.sub(whole, one)
    # The exact rounding error of 1 + x, whichever of them is larger.
    lost = ir.add(ir.sub(one, ir.sub(whole, added)), ir.sub(x, added))
    k, f = exponent_and_rest(ir, whole)
    unscaled = ir.compare("oeq", k, ir.constant(0.0))
    # If k is 0, f is x itself, which was not rounded.
    f = ir.select(unscaled, x, f)
    rest = ir.select(unscaled, ir.constant(0.0), ir.div(lost, whole))
    value = ir.intrinsic("copysign", log_of_parts(ir, k, f, rest), x)
    return with_ends_of_log(ir, value, x, -1.0)


def tanh(ir: VectorIR, x: str) -> str:
    """Return tanh x: a rational function near 0, 1 - 2 / (exp 2|x| + 1) elsewhere."""
    magnitude = ir.intrinsic("fabs", x)
    z = ir.mul(x, x)
    ratio = rational(ir, z, *table(ir.form).tanh)
    near = ir.fma(ir.mul(x, z), ratio, x)
    power = exp(ir, ir.add(magnitude, magnitude))
    decayed = ir.div(ir.constant(2.0), ir.add(power, ir.constant(1.0)))
    far = ir.sub(ir.constant(1.0), decayed)
    small = ir.compare("olt", magnitude, ir.constant(0.625))  # As in Cephes.
    return ir.intrinsic("copysign", ir.select(small, near, far), x)


def sinh(ir: VectorIR, x: str) -> str:
    """Return sinh x: a polynomial near 0, (exp |x| - exp -|x|) / 2 elsewhere."""
    z = ir.mul(x, x)
    near = ir.fma(ir.mul(x, z), ir.polynomial(z, table(ir.form).sinh), x)
    grown, decayed = _half_exponentials(ir, x)
    far = ir.intrinsic("copysign", ir.sub(grown, decayed), x)
    small = ir.compare("olt", ir.intrinsic("fabs", x), ir.constant(1.0))
    return ir.select(small, near, far)


def cosh(ir: VectorIR, x: str) -> str:
    """Return cosh x = (exp |x| + exp -|x|) / 2."""
    return ir.add(*_half_exponentials(ir, x))


def _half_exponentials(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return exp |x| / 2, which overflows when sinh does, and exp(-|x|) / 2."""
    known = table(ir.form)
    limits = known.exp_range[0], known.exp_range[1] + 1.0
    r, k = reduced_exponent(ir, ir.intrinsic("fabs", x), limits)
    # The half by its exponent: exp |x| itself may overflow.
    half = ir.sub(k, ir.constant(1.0))
    grown = scaled(ir, ir.polynomial(r, known.exp), half)
    return grown, ir.div(ir.constant(0.25), grown)


def asinh(ir: VectorIR, x: str) -> str:
    """Return asinh x = log1p(|x| + x^2 / (1 + sqrt(1 + x^2))), with the sign of x."""
    one, a = ir.constant(1.0), ir.intrinsic("fabs", x)
    z = ir.mul(a, a)
    root = ir.intrinsic("sqrt", ir.add(one, z))
    near = ir.add(a, ir.div(z, ir.add(one, root)))
    value = _log1p_or_log_of_twice(ir, near, a)
    return ir.intrinsic("copysign", value, x)


def acosh(ir: VectorIR, x: str) -> str:
    """Return acosh x = log1p(t + sqrt(2 t + t^2)), t = x - 1; NaN below 1."""
    t = ir.sub(x, ir.constant(1.0))
    square = ir.mul(t, ir.add(t, ir.constant(2.0)))
    near = ir.add(t, ir.intrinsic("sqrt", square))
    value = _log1p_or_log_of_twice(ir, near, x)
    undefined = ir.compare("olt", t, ir.constant(0.0))
    return ir.select(undefined, ir.constant(math.nan), value)


def _log1p_or_log_of_twice(ir: VectorIR, near: str, x: str) -> str:
    """Return log1p of a number; log 2x if x is so large that 1 is below its rounding.

    log 2x is computed as log1p(x / 2) + 2 ln 2, since 2x might overflow.
    """
    large = ir.compare("ogt", x, ir.constant(2.0 ** (ir.form.significand + 2)))
    value = log1p(ir, ir.select(large, ir.mul(x, ir.constant(0.5)), near))
    more = ir.add(value, ir.constant(2.0 * math.log(2.0)))
    return ir.select(large, more, value)


def atanh(ir: VectorIR, x: str) -> str:
    """Return atanh x = log1p(2 |x| / (1 - |x|)) / 2, with the sign of x."""
    a = ir.intrinsic("fabs", x)
    ratio = ir.div(ir.add(a, a), ir.sub(ir.constant(1.0), a))
    half = ir.mul(ir.constant(0.5), log1p(ir, ratio))
    return ir.intrinsic("copysign", half, x)


def erf(ir: VectorIR, x: str) -> str:
    """Return erf x: a polynomial near 0, 1 - exp(-x^2) Q(1 / (|x| + 3)) elsewhere.

    Q is a polynomial. A negative x gives -erf(-x).
    """
    known, a = table(ir.form), ir.intrinsic("fabs", x)
    z = ir.mul(x, x)
    near = ir.fma(x, ir.polynomial(z, known.erf), x)
    t = ir.div(ir.constant(1.0), ir.add(a, ir.constant(3.0)))
    tail = ir.mul(exp(ir, ir.neg(z)), ir.polynomial(t, known.erf_tail))
    far = ir.intrinsic("copysign", ir.sub(ir.constant(1.0), tail), x)
    small = ir.compare("olt", a, ir.constant(1.0))
    return ir.select(small, near, far)


def power(ir: VectorIR, base: str, exponent: str) -> str:
    """Return base^exponent = exp(exponent log base), the logarithm to 2^-64."""
    return served_by_library(ir, "pow", _power, base, exponent)


def _power(ir: VectorIR, base: str, exponent: str) -> tuple[str, str]:
    """Return base^exponent, and the mask of the lanes in which it is right."""
    wide = ir.in_format(DOUBLE)
    given = [ir.converted(v, ir.form, DOUBLE) for v in (base, exponent)]
    value, served = _power_of_doubles(wide, *given)
    return ir.converted(value, DOUBLE, ir.form), served


def _power_of_doubles(ir: VectorIR, base: str, exponent: str) -> tuple[str, str]:
    high, low = _long_log(ir, base)
    product = ir.mul(exponent, high)
    rest = ir.fma(exponent, low, ir.fma(exponent, high, ir.neg(product)))
    served = ir.compare("oge", base, ir.constant(DOUBLE.smallest))
    finite = ir.compare("olt", base, ir.constant(math.inf))
    limit = ir.constant(_LARGEST_LOG)
    inside = ir.compare("olt", ir.intrinsic("fabs", product), limit)
    served = ir.mask_op("and", served, ir.mask_op("and", finite, inside))
    # By its bits: a power of -0 may be -0.
    zero = ir.compare_integers("eq", ir.bits(base), ir.integer(0))
    zero = ir.mask_op("and", zero, ir.compare("ogt", exponent, ir.constant(0.0)))
    value = ir.select(zero, ir.constant(0.0), exp_of_sum(ir, product, rest))
    return value, ir.mask_op("or", served, zero)


def _long_log(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return log x, positive and normal, as a sum of two doubles.

    With s = f / (2 + f): log x = k ln 2 + 2 s + s^3 (2/3 + s^2 (2/5 + ...)).
    """
    k, f = exponent_and_rest(ir, x)
    below = ir.add(f, ir.constant(2.0))
    s = ir.div(f, below)
    # f - s (2 + f), and the rounding error of 2 + f.
    lost = ir.sub(f, ir.sub(below, ir.constant(2.0)))
    left = ir.fma(ir.neg(s), below, f)
    s_low = ir.div(ir.fma(ir.neg(s), lost, left), below)
    z = ir.mul(s, s)
    z_low = ir.fma(s, s, ir.neg(z))
    z_low = ir.fma(ir.add(s, s), s_low, z_low)
    series = ir.mul(z, ir.polynomial(z, _LOG_SERIES))
    p, p_low = _sum(ir, ir.constant(_TWO_THIRDS[0]), series)
    p_low = ir.add(p_low, ir.constant(_TWO_THIRDS[1]))
    cube, cube_low = _product(ir, (s, s_low), (z, z_low))
    tail, tail_low = _product(ir, (cube, cube_low), (p, p_low))
    first, first_low = _sum(ir, ir.add(s, s), tail)
    first_low = ir.add(first_low, ir.add(ir.add(s_low, s_low), tail_low))
    whole = ir.mul(k, ir.constant(_LN2_LONG[0]))
    # k ln 2 is 0 or the larger of the two.
    total, total_low = _sum(ir, whole, first)
    total_low = ir.add(total_low, first_low)
    total_low = ir.fma(k, ir.constant(_LN2_LONG[1]), total_low)
    apart = ir.compare("oeq", k, ir.constant(0.0))
    high = ir.select(apart, first, total)
    return high, ir.select(apart, first_low, total_low)


def _sum(ir: VectorIR, larger: str, smaller: str) -> tuple[str, str]:
    """Return a sum and its rounding error; the first must be the larger."""
    total = ir.add(larger, smaller)
    return total, ir.sub(smaller, ir.sub(total, larger))


def _product(ir: VectorIR, a: tuple[str, str], b: tuple[str, str]) -> tuple[str, str]:
    """Return the product of two sums of two."""
    high = ir.mul(a[0], b[0])
    low = ir.fma(a[0], b[0], ir.neg(high))
    return high, ir.fma(a[0], b[1], ir.fma(a[1], b[0], low))
