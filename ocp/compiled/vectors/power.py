"""Powers on vectors: base^exponent = exp(exponent log base).

The logarithm is a sum of two doubles, accurate to 2^-64, so that the power is accurate
to 2 ulp for any exponent. If the base is not positive and normal, or the result is out
of range, the C library computes it, lane by lane; see elementary.py. Single precision
is computed in double. The coefficients interpolate at the nodes of Chebyshev
polynomials (computed with mpmath).
"""

import math

from swarmstart.ocp.compiled.vectors.elementary import (
    exp_of_sum,
    exponent_and_rest,
    served_by_library,
)
from swarmstart.ocp.compiled.vectors.vector_ir import DOUBLE, VectorIR, converted

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


def power(ir: VectorIR, base: str, exponent: str) -> str:
    """Return base^exponent = exp(exponent log base), the logarithm to 2^-64."""
    return served_by_library(ir, "pow", _power, base, exponent)


def _power(ir: VectorIR, base: str, exponent: str) -> tuple[str, str]:
    """Return base^exponent, and the mask of the lanes in which it is right."""
    wide = ir.in_format(DOUBLE)
    given = [converted(ir, v, ir.form, DOUBLE) for v in (base, exponent)]
    value, served = _power_of_doubles(wide, *given)
    return converted(ir, value, DOUBLE, ir.form), served


def _power_of_doubles(ir: VectorIR, base: str, exponent: str) -> tuple[str, str]:
    high, low = _long_log(ir, base)
    product = ir.mul(exponent, high)
    rest = ir.fma(exponent, low, ir.fma(exponent, high, ir.neg(product)))
    served = ir.compare("oge", base, ir.constant(DOUBLE.smallest))
    finite = ir.compare("olt", base, ir.constant(math.inf))
    limit = ir.constant(_LARGEST_LOG)
    inside = ir.compare("olt", ir.intrinsic("fabs", product), limit)
    served = ir.mask_op("and", served, ir.mask_op("and", finite, inside))
    return exp_of_sum(ir, product, rest), served


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
