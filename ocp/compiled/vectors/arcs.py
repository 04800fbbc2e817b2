"""Angles of a sine, a cosine or a tangent, on vectors; see elementary.py."""

import math

from swarmstart.ocp.compiled.vectors.coefficients import table
from swarmstart.ocp.compiled.vectors.elementary import rational
from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR


def asin(ir: VectorIR, x: str) -> str:
    """Return asin x; near 1 it is pi/2 - 2 asin sqrt((1 - |x|) / 2)."""
    value, large = _asin_parts(ir, ir.intrinsic("fabs", x))
    high, low, _ = table(ir.form).pi_2
    left = ir.fma(ir.constant(2.0), value, ir.constant(-low))
    value = ir.select(large, ir.sub(ir.constant(high), left), value)
    return ir.intrinsic("copysign", value, x)


def acos(ir: VectorIR, x: str) -> str:
    """Return acos x; near 1 it is 2 asin sqrt((1 - x) / 2)."""
    high, low, _ = table(ir.form).pi_2
    value, large = _asin_parts(ir, ir.intrinsic("fabs", x))
    signed = ir.intrinsic("copysign", value, x)
    middle = ir.sub(ir.constant(high), ir.sub(signed, ir.constant(low)))
    twice = ir.add(value, value)
    left = ir.sub(ir.constant(2 * high), ir.sub(twice, ir.constant(2 * low)))
    negative = ir.compare("olt", x, ir.constant(0.0))
    return ir.select(large, ir.select(negative, left, twice), middle)


def _asin_parts(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return asin x for 0 <= x <= 1/2, asin sqrt((1 - x) / 2) above, and the mask.

    The mask is of the lanes above 1/2; above 1 the value is not a number.
    """
    half = ir.constant(0.5)
    large = ir.compare("ugt", x, half)
    above = ir.fma(x, ir.constant(-0.5), half)
    z = ir.select(large, above, ir.mul(x, x))
    root = ir.select(large, ir.intrinsic("sqrt", above), x)
    rest = ir.polynomial(z, table(ir.form).asin)
    return ir.fma(ir.mul(root, z), rest, root), large


def atan(ir: VectorIR, x: str) -> str:
    """Return atan x; odd, reduced to a small |t| at 0, pi/4 or pi/2."""
    base, low, small = _atan_parts(ir, ir.intrinsic("fabs", x))
    value = ir.add(base, ir.add(small, low))
    return ir.intrinsic("copysign", value, x)


def _atan_parts(ir: VectorIR, x: str) -> tuple[str, str, str]:
    """Return base, low and small, with atan x = (base + low) + small for x >= 0.

    The base is 0, pi/4 or pi/2 rounded, low its rounding error.
    """
    known = table(ir.form)
    top_coefficients, bottom_coefficients, limit = known.atan
    one = ir.constant(1.0)
    large = ir.compare("ogt", x, ir.constant(2.41421356237309504880))
    middle = ir.compare("ogt", x, ir.constant(limit))
    top = ir.select(middle, ir.sub(x, one), x)
    bottom = ir.select(middle, ir.add(x, one), one)
    t = ir.div(ir.select(large, ir.constant(-1.0), top), ir.select(large, x, bottom))
    base, low = (
        ir.select(
            large,
            ir.constant(part),
            ir.select(middle, ir.constant(part / 2), ir.constant(0.0)),
        )
        for part in known.pi_2[:2]
    )
    z = ir.mul(t, t)
    ratio = rational(ir, z, top_coefficients, bottom_coefficients)
    return base, low, ir.fma(ir.mul(t, z), ratio, t)


def atan2(ir: VectorIR, y: str, x: str) -> str:
    """Return the angle of (x, y), with the signs of zeros as C has them."""
    high, rest, _ = table(ir.form).pi_2
    a, b = ir.intrinsic("fabs", y), ir.intrinsic("fabs", x)
    ratio = ir.select(ir.compare("oeq", a, b), ir.constant(1.0), ir.div(a, b))
    ratio = ir.select(ir.compare("oeq", a, ir.constant(0.0)), a, ratio)
    not_a_number = ir.compare("uno", x, y)
    ratio = ir.select(not_a_number, ir.constant(math.nan), ratio)
    base, low, small = _atan_parts(ir, ratio)
    # On the left pi less the angle, part by part: pi - base is exact.
    left = ir.emit(f"icmp slt {ir.integers} {ir.bits(x)}, {ir.integer(0)}")
    base = ir.select(left, ir.sub(ir.constant(2 * high), base), base)
    low = ir.select(left, ir.sub(ir.constant(2 * rest), low), low)
    small = ir.select(left, ir.neg(small), small)
    return ir.intrinsic("copysign", ir.add(base, ir.add(small, low)), y)
