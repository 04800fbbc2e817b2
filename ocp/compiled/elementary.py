"""Elementary functions on vectors, as polynomials with range reduction.

No vector library of the system can be relied on. Largest error against the exact value,
in units in the last place (ulp), as tests/ocp/compiled measures it:

    sin, cos   2 ulp for every argument; above 2^30 by the C library, lane by lane
    exp, log, atan   1 ulp     tanh, atan2   2 ulp

Everything else is called in the C library, lane by lane.

Source: S. L. Moshier, Cephes mathematical library (1992), coefficients of sin, cos,
tanh, atan; FreeBSD msun e_log.c (Sun Microsystems 1993), coefficients of log; W. Cody
and W. Waite, Software manual for the elementary functions (1980), range reduction.
"""

import math
from collections.abc import Callable

from swarmstart.ocp.compiled.vector_ir import VectorIR

# pi / 2 as a sum of three doubles, each the next 53 bits, rounded down: with a negative
# one, reducing -0 would give +0.
PI_2 = (1.5707963267948966, 6.123233995736765e-17, 1.082856673921914e-32)
# Added and subtracted, it rounds to an integer; its low bits are then that integer's.
ROUNDING = 1.5 * 2.0**52
HUGE_ANGLE = 2.0**30

SIN = (
    1.58962301576546568060e-10,
    -2.50507477628578072866e-8,
    2.75573136213857245213e-6,
    -1.98412698295895385996e-4,
    8.33333333332211858878e-3,
    -1.66666666666666307295e-1,
)
COS = (
    -1.13585365213876817300e-11,
    2.08757008419747316778e-9,
    -2.75573141792967388112e-7,
    2.48015872888517045348e-5,
    -1.38888888888730564116e-3,
    4.16666666666665929218e-2,
)
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
LOG = (
    1.479819860511658591e-01,
    1.531383769920937332e-01,
    1.818357216161805012e-01,
    2.222219843214978396e-01,
    2.857142874366239149e-01,
    3.999999999940941908e-01,
    6.666666666666735130e-01,
)
EXP = tuple(1.0 / math.factorial(n) for n in range(13, -1, -1))
TANH_P = (
    -9.64399179425052238628e-1,
    -9.92877231001918586564e1,
    -1.61468768441708447952e3,
)
TANH_Q = (
    1.0,
    1.12811678491632931402e2,
    2.23548839060100448583e3,
    4.84406305325125486048e3,
)
ATAN_P = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
ATAN_Q = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)


def sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return sin x and cos x; one range reduction serves both.

    Lanes with a huge angle are done again by the C library; the others keep theirs, so
    that no individual's value depends on its neighbours.
    """
    sine, cosine = _reduced_sin_and_cos(ir, x)
    huge = ir.compare("ogt", ir.intrinsic("fabs", x), ir.constant(HUGE_ANGLE))
    before, slow, joined = ir.block, ir.name("slow"), ir.name("joined")
    ir.lines.append(f"  br i1 {ir.any(huge)}, label {slow}, label {joined}")
    ir.label(slow)
    again = [
        ir.select(huge, ir.lane_by_lane(name, x), value)
        for name, value in (("sin", sine), ("cos", cosine))
    ]
    ir.lines.append(f"  br label {joined}")
    ir.label(joined)
    sine, cosine = (
        ir.emit(f"phi {ir.vector} [ {value}, {before} ], [ {slower}, {slow} ]")
        for value, slower in zip((sine, cosine), again, strict=True)
    )
    return sine, cosine


def _reduced_sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return sin x and cos x for |x| <= HUGE_ANGLE."""
    rounding = ir.constant(ROUNDING)
    shifted = ir.fma(x, ir.constant(2.0 / math.pi), rounding)
    quarter = ir.sub(shifted, rounding)
    r = x
    for part in PI_2:
        r = ir.fma(quarter, ir.constant(-part), r)
    z = ir.mul(r, r)
    sine = ir.fma(ir.mul(ir.polynomial(z, SIN), z), r, r)
    sine = ir.intrinsic("copysign", sine, r)  # The sum loses the sign of -0.
    cosine = ir.fma(z, ir.constant(-0.5), ir.constant(1.0))
    cosine = ir.fma(ir.mul(z, z), ir.polynomial(z, COS), cosine)

    quadrant = ir.bits(shifted)
    odd = ir.integer_op("and", quadrant, ir.integer(1))
    swap = ir.emit(f"icmp ne {ir.integers} {odd}, {ir.integer(0)}")
    after = ir.integer_op("add", quadrant, ir.integer(1))
    return (
        _signed(ir, ir.select(swap, cosine, sine), quadrant),
        _signed(ir, ir.select(swap, sine, cosine), after),
    )


def _signed(ir: VectorIR, value: str, quadrant: str) -> str:
    """Return a value, negated where bit 1 of the quadrant is set."""
    second = ir.integer_op("and", quadrant, ir.integer(2))
    sign = ir.integer_op("shl", second, ir.integer(62))
    return ir.from_bits(ir.integer_op("xor", ir.bits(value), sign))


def exp(ir: VectorIR, x: str) -> str:
    """Return exp x = 2^k exp r, |r| <= ln 2 / 2."""
    for condition, limit in (("ogt", 710.0), ("olt", -746.0)):
        bound = ir.constant(limit)
        x = ir.select(ir.compare(condition, x, bound), bound, x)
    rounding = ir.constant(ROUNDING)
    shifted = ir.fma(x, ir.constant(1.0 / math.log(2.0)), rounding)
    k = ir.sub(shifted, rounding)
    r = x
    for part in LN2:
        r = ir.fma(k, ir.constant(-part), r)
    # In two halves, each in range, so that the product overflows or underflows last.
    whole = ir.integer_op("sub", ir.bits(shifted), ir.bits(rounding))
    half = ir.integer_op("ashr", whole, ir.integer(1))
    value = ir.polynomial(r, EXP)
    for exponent in (half, ir.integer_op("sub", whole, half)):
        value = ir.mul(value, _power_of_two(ir, exponent))
    return value


def _power_of_two(ir: VectorIR, exponent: str) -> str:
    biased = ir.integer_op("add", exponent, ir.integer(1023))
    return ir.from_bits(ir.integer_op("shl", biased, ir.integer(52)))


def log(ir: VectorIR, x: str) -> str:
    """Return log x = k ln 2 + log m, sqrt(1/2) <= m < sqrt(2)."""
    tiny = ir.compare("olt", x, ir.constant(2.0**-1022))
    scaled = ir.select(tiny, ir.mul(x, ir.constant(2.0**54)), x)
    offset = ir.select(tiny, ir.constant(-54.0), ir.constant(0.0))
    # Subtracting the bits of sqrt(1/2) puts the exponent where m is in its interval.
    bits = ir.integer_op("sub", ir.bits(scaled), ir.integer(0x3FE6A09E667F3BCD))
    exponent = ir.integer_op("ashr", bits, ir.integer(52))
    significand = ir.integer_op("and", bits, ir.integer(0x000FFFFFFFFFFFFF))
    m = ir.from_bits(ir.integer_op("add", significand, ir.integer(0x3FE6A09E667F3BCD)))
    # An integer below 2^51 as a double, without the conversion AVX2 lacks.
    magic = ir.bits(ir.constant(ROUNDING))
    k = ir.from_bits(ir.integer_op("add", exponent, magic))
    k = ir.add(ir.sub(k, ir.constant(ROUNDING)), offset)

    f = ir.sub(m, ir.constant(1.0))
    s = ir.div(f, ir.add(f, ir.constant(2.0)))
    z = ir.mul(s, s)
    half_square = ir.mul(ir.mul(f, f), ir.constant(0.5))
    rest = ir.fma(z, ir.polynomial(z, LOG), half_square)
    low = ir.fma(s, rest, ir.mul(k, ir.constant(LN2[1])))
    inner = ir.sub(ir.sub(half_square, low), f)
    value = ir.fma(k, ir.constant(LN2[0]), ir.neg(inner))

    infinite = ir.compare("oeq", x, ir.constant(math.inf))
    value = ir.select(infinite, x, value)
    zero = ir.compare("oeq", x, ir.constant(0.0))
    value = ir.select(zero, ir.constant(-math.inf), value)
    undefined = ir.compare("ult", x, ir.constant(0.0))  # Negative or not a number.
    return ir.select(undefined, ir.constant(math.nan), value)


def tanh(ir: VectorIR, x: str) -> str:
    """Return tanh x: a rational function near 0, 1 - 2 / (exp 2|x| + 1) elsewhere."""
    magnitude = ir.intrinsic("fabs", x)
    z = ir.mul(x, x)
    ratio = ir.div(ir.polynomial(z, TANH_P), ir.polynomial(z, TANH_Q))
    near = ir.fma(ir.mul(x, z), ratio, x)
    power = exp(ir, ir.add(magnitude, magnitude))
    decayed = ir.div(ir.constant(2.0), ir.add(power, ir.constant(1.0)))
    far = ir.sub(ir.constant(1.0), decayed)
    small = ir.compare("olt", magnitude, ir.constant(0.625))
    return ir.intrinsic("copysign", ir.select(small, near, far), x)


def atan(ir: VectorIR, x: str) -> str:
    """Return atan x; odd, reduced to |t| <= 0.66 at 0, pi/4 or pi/2."""
    base, low, small = _atan_parts(ir, ir.intrinsic("fabs", x))
    value = ir.add(base, ir.add(small, low))
    return ir.intrinsic("copysign", value, x)


def _atan_parts(ir: VectorIR, x: str) -> tuple[str, str, str]:
    """Return base, low and small, with atan x = (base + low) + small for x >= 0.

    The base is 0, pi/4 or pi/2 as a double, low what that double lacks of it.
    """
    one = ir.constant(1.0)
    large = ir.compare("ogt", x, ir.constant(2.41421356237309504880))
    middle = ir.compare("ogt", x, ir.constant(0.66))
    top = ir.select(middle, ir.sub(x, one), x)
    bottom = ir.select(middle, ir.add(x, one), one)
    t = ir.div(ir.select(large, ir.constant(-1.0), top), ir.select(large, x, bottom))
    base, low = (
        ir.select(
            large,
            ir.constant(part),
            ir.select(middle, ir.constant(part / 2), ir.constant(0.0)),
        )
        for part in PI_2[:2]
    )
    z = ir.mul(t, t)
    ratio = ir.div(ir.polynomial(z, ATAN_P), ir.polynomial(z, ATAN_Q))
    return base, low, ir.fma(ir.mul(t, z), ratio, t)


def atan2(ir: VectorIR, y: str, x: str) -> str:
    """Return the angle of (x, y), with the signs of zeros as C has them."""
    a, b = ir.intrinsic("fabs", y), ir.intrinsic("fabs", x)
    ratio = ir.select(ir.compare("oeq", a, b), ir.constant(1.0), ir.div(a, b))
    ratio = ir.select(ir.compare("oeq", a, ir.constant(0.0)), a, ratio)
    not_a_number = ir.compare("uno", x, y)
    ratio = ir.select(not_a_number, ir.constant(math.nan), ratio)
    base, low, small = _atan_parts(ir, ratio)
    # On the left pi less the angle, part by part: pi - base is exact.
    left = ir.emit(f"icmp slt {ir.integers} {ir.bits(x)}, {ir.integer(0)}")
    base = ir.select(left, ir.sub(ir.constant(math.pi), base), base)
    low = ir.select(left, ir.sub(ir.constant(2 * PI_2[1]), low), low)
    small = ir.select(left, ir.neg(small), small)
    return ir.intrinsic("copysign", ir.add(base, ir.add(small, low)), y)


UNARY: dict[str, Callable[[VectorIR, str], str]] = {
    "exp": exp,
    "log": log,
    "tanh": tanh,
    "atan": atan,
}
