"""Exponentials and logarithms near 1, and functions built on them; see elementary.py.

Source: W. Kahan, Branch cuts for complex elementary functions (1987), log(1 + x) and
the inverse hyperbolic functions; coefficients in coefficients.py.
"""

import math

from swarmstart.ocp.compiled.vectors.coefficients import table
from swarmstart.ocp.compiled.vectors.elementary import (
    exp,
    exponent_and_rest,
    log_of_parts,
    rational,
    reduced_exponent,
    scaled,
    with_ends_of_log,
)
from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR


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
    lost = ir.add(ir.sub(one, ir.sub(whole, added)), ir.sub(x, added))
    k, f = exponent_and_rest(ir, whole)
    unscaled = ir.compare("oeq", k, ir.constant(0.0))
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
    small = ir.compare("olt", magnitude, ir.constant(0.625))
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
    """Return erf x: a polynomial near 0, 1 - exp(-x^2) Q(1 / (|x| + 3)) elsewhere."""
    known, a = table(ir.form), ir.intrinsic("fabs", x)
    z = ir.mul(x, x)
    near = ir.fma(x, ir.polynomial(z, known.erf), x)
    t = ir.div(ir.constant(1.0), ir.add(a, ir.constant(3.0)))
    tail = ir.mul(exp(ir, ir.neg(z)), ir.polynomial(t, known.erf_tail))
    far = ir.intrinsic("copysign", ir.sub(ir.constant(1.0), tail), x)
    small = ir.compare("olt", a, ir.constant(1.0))
    return ir.select(small, near, far)
