"""Elementary functions on vectors, as polynomials with range reduction.

They are written here because not every system has a vector library. Largest error
against the exact value, in units in the last place (ulp), as tests/ocp/compiled
measures it:

                          double    single
    sin, cos                2         2
    tan                     3         4
    exp, log, log1p         1         1
    expm1                   2         2
    sinh, cosh, tanh        2         2
    asinh, atanh, erf       2         2
    acosh, asin             3         3
    acos                    2         2
    atan                    1         3
    atan2                   2         3
    pow                     2         1
    fmod                    0         0

Some arguments are out of range of these methods: angles above 2^30 (2^12 in single
precision), powers whose base is not positive and normal or whose result is out of range
(a positive power of 0 is computed here), and quotients in fmod above 2^51 (2^22). If a
block of individuals has such an argument, the C library is called for each individual
of the block. All functions that are not listed above are called in the C library.

Source: W. Cody and W. Waite, Software manual for the elementary functions (1980), range
reduction; coefficients in coefficients.py. The rest is in exponentials.py.
"""

import math
from collections.abc import Callable, Sequence

from swarmstart.ocp.compiled.vectors.coefficients import table
from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR

Served = Callable[..., tuple[str, str]]
"""(ir, arguments) -> value, and the mask of the lanes in which it is right."""


def sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return sin x and cos x; one range reduction serves both."""
    sine, cosine = _reduced_sin_and_cos(ir, x)
    limit = ir.constant(table(ir.form).huge_angle)
    right = ir.compare("ule", ir.intrinsic("fabs", x), limit)
    names, values = ("sin", "cos"), [sine, cosine]
    sine, cosine = ir.corrected(
        values, right, lambda: [ir.lane_by_lane(name, x) for name in names]
    )
    return sine, cosine


def tan(ir: VectorIR, sine: str, cosine: str) -> str:
    """Return tan x from sin x and cos x, which are right for angles of any size."""
    return ir.div(sine, cosine)


def _reduced_sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return sin x and cos x for angles that are not huge."""
    known = table(ir.form)
    rounding = ir.constant(ir.form.rounding)
    shifted = ir.fma(x, ir.constant(2.0 / math.pi), rounding)
    quarter = ir.sub(shifted, rounding)
    r = x
    # From the largest part on: what is left keeps its digits (Cody and Waite).
    for part in known.pi_2:
        r = ir.fma(quarter, ir.constant(-part), r)
    z = ir.mul(r, r)
    one = ir.constant(1.0)
    # A product, unlike a sum with r, keeps the sign of -0.
    sine = ir.mul(r, ir.fma(ir.polynomial(z, known.sin), z, one))
    cosine = ir.polynomial(z, known.cos)

    quadrant = ir.bits(shifted)
    odd = ir.integer_op("and", quadrant, ir.integer(1))
    swap = ir.compare_integers("ne", odd, ir.integer(0))
    after = ir.integer_op("add", quadrant, ir.integer(1))
    return (
        _signed(ir, ir.select(swap, cosine, sine), quadrant),
        _signed(ir, ir.select(swap, sine, cosine), after),
    )


def _signed(ir: VectorIR, value: str, quadrant: str) -> str:
    """Return a value, negated where bit 1 of the quadrant is set."""
    at_sign = ir.integer_op("shl", quadrant, ir.integer(ir.form.bits - 2))
    sign = ir.integer_op("and", at_sign, ir.integer(-(2 ** (ir.form.bits - 1))))
    return ir.from_bits(ir.integer_op("xor", ir.bits(value), sign))


def exp(ir: VectorIR, x: str) -> str:
    """Return exp x = 2^k exp r, |r| <= ln 2 / 2."""
    return exp_of_sum(ir, x, None)


def exp_of_sum(ir: VectorIR, x: str, rest: str | None) -> str:
    """Return exp(x + rest), with rest of the size of x's rounding error."""
    known = table(ir.form)
    r, k = reduced_exponent(ir, x, known.exp_range)
    if rest is not None:
        r = ir.add(r, rest)
    return scaled(ir, ir.polynomial(r, known.exp), k)


def reduced_exponent(
    ir: VectorIR, x: str, limits: tuple[float, float]
) -> tuple[str, str]:
    """Return r and the whole number k with x = k ln 2 + r and |r| <= ln 2 / 2.

    x is clipped to the limits first.
    """
    for condition, limit in zip(("olt", "ogt"), limits, strict=True):
        bound = ir.constant(limit)
        x = ir.select(ir.compare(condition, x, bound), bound, x)
    rounding = ir.constant(ir.form.rounding)
    k = ir.sub(ir.fma(x, ir.constant(1.0 / math.log(2.0)), rounding), rounding)
    r = x
    for part in table(ir.form).ln2:
        r = ir.fma(k, ir.constant(-part), r)
    return r, k


_SCALED_BITS = 512


def scaled(ir: VectorIR, value: str, k: str) -> str:
    """Return value 2^k, k a small whole number."""
    if ir.module.has_scale and ir.lanes * ir.form.bits >= _SCALED_BITS:
        return _scaled_at_once(ir, value, k)
    # In two halves, each in range, so that the product overflows or underflows last.
    rounding = ir.constant(ir.form.rounding)
    shifted = ir.bits(ir.add(k, rounding))  # Its low bits are the integer k.
    whole = ir.integer_op("sub", shifted, ir.bits(rounding))
    half = ir.integer_op("ashr", whole, ir.integer(1))
    for exponent in (half, ir.integer_op("sub", whole, half)):
        biased = ir.integer_op("add", exponent, ir.integer(ir.form.bias))
        power = ir.integer_op("shl", biased, ir.integer(ir.form.significand))
        value = ir.mul(value, ir.from_bits(power))
    return value


def _scaled_at_once(ir: VectorIR, value: str, k: str) -> str:
    """Return value 2^k by AVX-512's own instruction, 512 bits at a time."""
    lanes, kind = _SCALED_BITS // ir.form.bits, {64: "pd", 32: "ps"}[ir.form.bits]
    register = f"<{lanes} x {ir.form.name}>"
    function = f"@llvm.x86.avx512.mask.scalef.{kind}.512"
    ir.module.declarations.add(
        f"declare {register} {function}({register}, {register}, {register}, "
        f"i{lanes}, i32)"
    )
    parts = []
    for first in range(0, ir.lanes, lanes):
        a, b = (_lanes_from(ir, v, first, lanes) for v in (value, k))
        parts.append(
            ir.emit(
                f"call {register} {function}({register} {a}, {register} {b}, "
                # All lanes; 4 is the current direction of rounding.
                f"{register} zeroinitializer, i{lanes} -1, i32 4)"
            )
        )
    while len(parts) > 1:
        joined = [", ".join(f"i32 {i}" for i in range(2 * lanes))] * (len(parts) // 2)
        half = f"<{lanes} x {ir.form.name}>"
        parts = [
            ir.emit(
                f"shufflevector {half} {a}, {half} {b}, <{2 * lanes} x i32> <{order}>"
            )
            for a, b, order in zip(parts[::2], parts[1::2], joined, strict=True)
        ]
        lanes *= 2
    return parts[0]


def _lanes_from(ir: VectorIR, value: str, first: int, lanes: int) -> str:
    """Return some of a vector's lanes as a shorter vector."""
    order = ", ".join(f"i32 {i}" for i in range(first, first + lanes))
    return ir.emit(
        f"shufflevector {ir.vector} {value}, {ir.vector} poison, "
        f"<{lanes} x i32> <{order}>"
    )


def log(ir: VectorIR, x: str) -> str:
    """Return log x = k ln 2 + log m, sqrt(1/2) <= m < sqrt(2)."""
    up = ir.form.significand + 2
    # Subnormal numbers have other bits: they are scaled up first.
    tiny = ir.compare("olt", x, ir.constant(ir.form.smallest))
    normal = ir.select(tiny, ir.mul(x, ir.constant(2.0**up)), x)
    offset = ir.select(tiny, ir.constant(float(-up)), ir.constant(0.0))
    k, f = exponent_and_rest(ir, normal)
    k = ir.add(k, offset)
    value = log_of_parts(ir, k, f, ir.constant(0.0))
    return with_ends_of_log(ir, value, x, 0.0)


def log_of_parts(ir: VectorIR, k: str, f: str, rest: str) -> str:
    """Return k ln 2 + log(1 + f) + rest, with rest small compared with the sum."""
    known = table(ir.form)
    s = ir.div(f, ir.add(f, ir.constant(2.0)))
    z = ir.mul(s, s)
    half_square = ir.mul(ir.mul(f, f), ir.constant(0.5))
    tail = ir.fma(z, ir.polynomial(z, known.log), half_square)
    low = ir.fma(s, tail, ir.fma(k, ir.constant(known.ln2[1]), rest))
    inner = ir.sub(ir.sub(half_square, low), f)
    return ir.fma(k, ir.constant(known.ln2[0]), ir.neg(inner))


def with_ends_of_log(ir: VectorIR, value: str, x: str, pole: float) -> str:
    """Return a logarithm, corrected at infinity, at its pole and below, and at NaN."""
    infinite = ir.compare("oeq", x, ir.constant(math.inf))
    value = ir.select(infinite, x, value)
    at_pole = ir.compare("oeq", x, ir.constant(pole))
    value = ir.select(at_pole, ir.constant(-math.inf), value)
    undefined = ir.compare("ult", x, ir.constant(pole))  # Below or not a number.
    return ir.select(undefined, ir.constant(math.nan), value)


def exponent_and_rest(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return k and f with x = 2^k (1 + f), sqrt(1/2) <= 1 + f < sqrt(2)."""
    form, known = ir.form, table(ir.form)
    # Subtracting the bits of sqrt(1/2) gives the exponent for m in its interval.
    bits = ir.integer_op("sub", ir.bits(x), ir.integer(known.root_half))
    exponent = ir.integer_op("ashr", bits, ir.integer(form.significand))
    significand = ir.integer_op("and", bits, ir.integer(2**form.significand - 1))
    m = ir.from_bits(ir.integer_op("add", significand, ir.integer(known.root_half)))
    # A small integer as a number, without the conversion AVX2 lacks.
    rounding = ir.constant(form.rounding)
    k = ir.from_bits(ir.integer_op("add", exponent, ir.bits(rounding)))
    return ir.sub(k, rounding), ir.sub(m, ir.constant(1.0))


def rational(
    ir: VectorIR, z: str, top: Sequence[float], bottom: Sequence[float]
) -> str:
    """Return the quotient of two polynomials in z."""
    numerator = ir.polynomial(z, top)
    if len(bottom) == 1:
        return numerator
    return ir.div(numerator, ir.polynomial(z, bottom))


def served_by_library(
    ir: VectorIR, function: str, method: Served, *arguments: str
) -> str:
    """Return a function's value by `method`, in some lanes by the C library.

    Those are the lanes in which `method` is not valid.

    Args:
        ir: Writer of the function's body.
        function: Name of the function in the C library.
        method: Function (ir, arguments) -> (value, mask of the lanes in which the value
            is right).
        arguments: Arguments of the function.
    """
    value, served = method(ir, *arguments)
    (value,) = ir.corrected(
        [value], served, lambda: [ir.lane_by_lane(function, *arguments)]
    )
    return value


def fmod(ir: VectorIR, x: str, y: str) -> str:
    """Return the remainder of x / y, with the sign of x."""
    return served_by_library(ir, "fmod", _fmod, x, y)


def _fmod(ir: VectorIR, x: str, y: str) -> tuple[str, str]:
    """Return the exact remainder, and the mask of the lanes in which it is right.

    The rounded quotient may be one too large: then the remainder is below 0.
    """
    a, b = ir.intrinsic("fabs", x), ir.intrinsic("fabs", y)
    quotient = ir.intrinsic("floor", ir.div(a, b))
    left = ir.fma(ir.neg(quotient), b, a)
    left = ir.select(ir.compare("olt", left, ir.constant(0.0)), ir.add(left, b), left)
    smaller = ir.compare("olt", a, b)
    value = ir.intrinsic("copysign", ir.select(smaller, a, left), x)
    limit = ir.constant(2.0 ** (ir.form.significand - 1))
    served = ir.compare("olt", quotient, limit)
    return value, ir.mask_op("or", smaller, served)


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
    # pi / 2 - asin x, with pi / 2 in two parts.
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
    """Return atan x, an odd function; for x >= 0 it is 0, pi/4 or pi/2 plus atan t.

    t is chosen so that |t| is small.
    """
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
    # tan(3 pi / 8).
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
    left = ir.compare_integers("slt", ir.bits(x), ir.integer(0))
    base = ir.select(left, ir.sub(ir.constant(2 * high), base), base)
    low = ir.select(left, ir.sub(ir.constant(2 * rest), low), low)
    small = ir.select(left, ir.neg(small), small)
    return ir.intrinsic("copysign", ir.add(base, ir.add(small, low)), y)
