"""Elementary functions on vectors, as polynomials with range reduction.

No vector library of the system can be relied on. Largest error against the exact value,
in units in the last place (ulp), as tests/ocp/compiled measures it:

                          double    single
    sin, cos, tanh          2         2
    exp, log                1         1
    atan                    1         3
    atan2                   2         3
    pow                     2         1

Angles above 2^30 (2^12 in single precision), and what pow cannot take (no positive
normal base, a result out of range), are served by the C library, lane by lane: where
the body is careful. A fast body only marks them, and the individuals concerned are
evaluated once more by a careful one. Everything else is called in the C library.

Source: S. L. Moshier, Cephes mathematical library (1992), coefficients of sin, cos,
tanh, atan; FreeBSD msun e_log.c, e_logf.c (Sun Microsystems 1993), coefficients of log;
W. Cody and W. Waite, Software manual for the elementary functions (1980), range
reduction. The coefficients of exp and of pow's logarithm interpolate at the nodes of
Chebyshev polynomials (computed with mpmath).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from swarmstart.ocp.compiled.formats import DOUBLE, Format
from swarmstart.ocp.compiled.vector_ir import VectorIR, converted


@dataclass(frozen=True, kw_only=True, slots=True)
class _Table:
    """Coefficients, highest power first, and limits for one format.

    Attributes:
        pi_2: pi / 2 as a sum of parts, each the next bits, rounded down: with a
            negative one, reducing -0 would give +0.
        huge_angle: Above it the reduction of an angle loses bits.
        sin: (sin r / r - 1) / r^2 in r^2.
        cos: cos r in r^2.
        ln2: ln 2 in two parts; a multiple of the first is exact.
        exp: exp r in r.
        exp_range: Below the first exp is 0, above the second infinite.
        log: What log adds to its first terms, in z = (f / (2 + f))^2.
        root_half: The bits of sqrt(1/2).
        tanh: Numerator and denominator of (tanh x / x - 1) / x^2 in x^2.
        atan: The same of atan, and the argument up to which it serves.
    """

    pi_2: tuple[float, float, float]
    huge_angle: float
    sin: tuple[float, ...]
    cos: tuple[float, ...]
    ln2: tuple[float, float]
    exp: tuple[float, ...]
    exp_range: tuple[float, float]
    log: tuple[float, ...]
    root_half: int
    tanh: tuple[tuple[float, ...], tuple[float, ...]]
    atan: tuple[tuple[float, ...], tuple[float, ...], float]


_DOUBLE = _Table(
    pi_2=(1.5707963267948966, 6.123233995736765e-17, 1.082856673921914e-32),
    huge_angle=2.0**30,
    sin=(
        1.58962301576546568060e-10,
        -2.50507477628578072866e-8,
        2.75573136213857245213e-6,
        -1.98412698295895385996e-4,
        8.33333333332211858878e-3,
        -1.66666666666666307295e-1,
    ),
    cos=(
        -1.13585365213876817300e-11,
        2.08757008419747316778e-9,
        -2.75573141792967388112e-7,
        2.48015872888517045348e-5,
        -1.38888888888730564116e-3,
        4.16666666666665929218e-2,
        -0.5,
        1.0,
    ),
    ln2=(6.93147180369123816490e-01, 1.90821492927058770002e-10),
    exp=(
        2.5100375832561234e-08,
        2.7620075879983367e-07,
        2.7557268480310024e-06,
        2.4801521322368692e-05,
        1.9841269863040545e-04,
        1.3888888917196719e-03,
        8.3333333333300650e-03,
        4.1666666666624164e-02,
        1.6666666666666669e-01,
        5.0000000000000010e-01,
        1.0,
        1.0,
    ),
    exp_range=(-746.0, 710.0),
    log=(
        1.479819860511658591e-01,
        1.531383769920937332e-01,
        1.818357216161805012e-01,
        2.222219843214978396e-01,
        2.857142874366239149e-01,
        3.999999999940941908e-01,
        6.666666666666735130e-01,
    ),
    root_half=0x3FE6A09E667F3BCD,
    tanh=(
        (
            -9.64399179425052238628e-1,
            -9.92877231001918586564e1,
            -1.61468768441708447952e3,
        ),
        (
            1.0,
            1.12811678491632931402e2,
            2.23548839060100448583e3,
            4.84406305325125486048e3,
        ),
    ),
    atan=(
        (
            -8.750608600031904122785e-1,
            -1.615753718733365076637e1,
            -7.500855792314704667340e1,
            -1.228866684490136173410e2,
            -6.485021904942025371773e1,
        ),
        (
            1.0,
            2.485846490142306297962e1,
            1.650270098316988542046e2,
            4.328810604912902668951e2,
            4.853903996359136964868e2,
            1.945506571482613964425e2,
        ),
        0.66,
    ),
)

_SINGLE = _Table(
    pi_2=(1.570796251296997, 7.549789415861596e-08, 5.390302529957765e-15),
    huge_angle=2.0**12,
    sin=(-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1),
    cos=(
        2.443315711809948e-5,
        -1.388731625493765e-3,
        4.166664568298827e-2,
        -0.5,
        1.0,
    ),
    ln2=(0.693145751953125, 1.428606765330187e-06),
    exp=(
        1.3926175888627768e-03,
        8.3631733432412150e-03,
        4.1666556149721146e-02,
        1.6666577756404877e-01,
        0.5,
        1.0,
        1.0,
    ),
    exp_range=(-105.0, 89.0),
    log=(0.24279078841, 0.28498786688, 0.40000972152, 0.66666662693),
    root_half=0x3F3504F3,
    tanh=(
        (
            -5.70498872745e-3,
            2.06390887954e-2,
            -5.37397155531e-2,
            1.33314422036e-1,
            -3.33332819422e-1,
        ),
        (1.0,),
    ),
    atan=(
        (
            8.05374449538e-2,
            -1.38776856032e-1,
            1.99777106478e-1,
            -3.33329491539e-1,
        ),
        (1.0,),
        0.41421356237309503,
    ),
)


def _table(form: Format) -> _Table:
    return _DOUBLE if form == DOUBLE else _SINGLE


def sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return sin x and cos x; one range reduction serves both."""
    if ir.careful:
        sine, cosine = (
            ir.beside(f"careful_{name}", make, x)
            for name, make in (("sin", _careful_sin), ("cos", _careful_cos))
        )
        return sine, cosine
    sine, cosine, quarter = _reduced_sin_and_cos(ir, x)
    # Huge or not a number where any angle was; one instruction an angle.
    ir.mark(ir.fma(quarter, quarter, ir.unserved))
    return sine, cosine


def is_unserved(ir: VectorIR) -> str:
    """Return the mask of the lanes whose arguments a fast body could not serve."""
    limit = (_table(ir.form).huge_angle * (2.0 / math.pi)) ** 2
    return ir.compare("ugt", ir.unserved, ir.constant(limit))


def _careful_sin(ir: VectorIR, x: str) -> str:
    sine, _, _ = _reduced_sin_and_cos(ir, x)
    return ir.select(_huge(ir, x), ir.lane_by_lane("sin", x), sine)


def _careful_cos(ir: VectorIR, x: str) -> str:
    _, cosine, _ = _reduced_sin_and_cos(ir, x)
    return ir.select(_huge(ir, x), ir.lane_by_lane("cos", x), cosine)


def _huge(ir: VectorIR, x: str) -> str:
    limit = ir.constant(_table(ir.form).huge_angle)
    return ir.compare("ogt", ir.intrinsic("fabs", x), limit)


def _reduced_sin_and_cos(ir: VectorIR, x: str) -> tuple[str, str, str]:
    """Return sin x, cos x, and x in quarter turns, for angles that are not huge."""
    table = _table(ir.form)
    rounding = ir.constant(ir.form.rounding)
    shifted = ir.fma(x, ir.constant(2.0 / math.pi), rounding)
    quarter = ir.sub(shifted, rounding)
    r = x
    for part in table.pi_2:
        r = ir.fma(quarter, ir.constant(-part), r)
    z = ir.mul(r, r)
    one = ir.constant(1.0)
    # A product, unlike a sum with r, keeps the sign of -0.
    sine = ir.mul(r, ir.fma(ir.polynomial(z, table.sin), z, one))
    cosine = ir.polynomial(z, table.cos)

    quadrant = ir.bits(shifted)
    odd = ir.integer_op("and", quadrant, ir.integer(1))
    swap = ir.emit(f"icmp ne {ir.integers} {odd}, {ir.integer(0)}")
    after = ir.integer_op("add", quadrant, ir.integer(1))
    return (
        _signed(ir, ir.select(swap, cosine, sine), quadrant),
        _signed(ir, ir.select(swap, sine, cosine), after),
        quarter,
    )


def _signed(ir: VectorIR, value: str, quadrant: str) -> str:
    """Return a value, negated where bit 1 of the quadrant is set."""
    at_sign = ir.integer_op("shl", quadrant, ir.integer(ir.form.bits - 2))
    sign = ir.integer_op("and", at_sign, ir.integer(-(2 ** (ir.form.bits - 1))))
    return ir.from_bits(ir.integer_op("xor", ir.bits(value), sign))


def exp(ir: VectorIR, x: str) -> str:
    """Return exp x = 2^k exp r, |r| <= ln 2 / 2."""
    return _exp_of_sum(ir, x, None)


def _exp_of_sum(ir: VectorIR, x: str, rest: str | None) -> str:
    """Return exp(x + rest), where rest is of the size of x's rounding error."""
    table = _table(ir.form)
    for condition, limit in zip(("olt", "ogt"), table.exp_range, strict=True):
        bound = ir.constant(limit)
        x = ir.select(ir.compare(condition, x, bound), bound, x)
    rounding = ir.constant(ir.form.rounding)
    shifted = ir.fma(x, ir.constant(1.0 / math.log(2.0)), rounding)
    k = ir.sub(shifted, rounding)
    r = x
    for part in table.ln2:
        r = ir.fma(k, ir.constant(-part), r)
    if rest is not None:
        r = ir.add(r, rest)
    return _scaled(ir, ir.polynomial(r, table.exp), k, shifted)


_SCALED_BITS = 512


def _scaled(ir: VectorIR, value: str, k: str, shifted: str) -> str:
    """Return value 2^k, where the low bits of shifted are the integer k."""
    if ir.module.has_scale and ir.lanes * ir.form.bits >= _SCALED_BITS:
        return _scaled_at_once(ir, value, k)
    # In two halves, each in range, so that the product overflows or underflows last.
    rounding = ir.bits(ir.constant(ir.form.rounding))
    whole = ir.integer_op("sub", ir.bits(shifted), rounding)
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
    table = _table(ir.form)
    up = ir.form.significand + 2
    tiny = ir.compare("olt", x, ir.constant(ir.form.smallest))
    scaled = ir.select(tiny, ir.mul(x, ir.constant(2.0**up)), x)
    offset = ir.select(tiny, ir.constant(float(-up)), ir.constant(0.0))
    k, f = _exponent_and_rest(ir, scaled)
    k = ir.add(k, offset)

    s = ir.div(f, ir.add(f, ir.constant(2.0)))
    z = ir.mul(s, s)
    half_square = ir.mul(ir.mul(f, f), ir.constant(0.5))
    rest = ir.fma(z, ir.polynomial(z, table.log), half_square)
    low = ir.fma(s, rest, ir.mul(k, ir.constant(table.ln2[1])))
    inner = ir.sub(ir.sub(half_square, low), f)
    value = ir.fma(k, ir.constant(table.ln2[0]), ir.neg(inner))

    infinite = ir.compare("oeq", x, ir.constant(math.inf))
    value = ir.select(infinite, x, value)
    zero = ir.compare("oeq", x, ir.constant(0.0))
    value = ir.select(zero, ir.constant(-math.inf), value)
    undefined = ir.compare("ult", x, ir.constant(0.0))  # Negative or not a number.
    return ir.select(undefined, ir.constant(math.nan), value)


def _exponent_and_rest(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return k and f with x = 2^k (1 + f), sqrt(1/2) <= 1 + f < sqrt(2)."""
    form, table = ir.form, _table(ir.form)
    # Subtracting the bits of sqrt(1/2) puts the exponent where m is in its interval.
    bits = ir.integer_op("sub", ir.bits(x), ir.integer(table.root_half))
    exponent = ir.integer_op("ashr", bits, ir.integer(form.significand))
    significand = ir.integer_op("and", bits, ir.integer(2**form.significand - 1))
    m = ir.from_bits(ir.integer_op("add", significand, ir.integer(table.root_half)))
    # A small integer as a number, without the conversion AVX2 lacks.
    rounding = ir.constant(form.rounding)
    k = ir.from_bits(ir.integer_op("add", exponent, ir.bits(rounding)))
    return ir.sub(k, rounding), ir.sub(m, ir.constant(1.0))


def tanh(ir: VectorIR, x: str) -> str:
    """Return tanh x: a rational function near 0, 1 - 2 / (exp 2|x| + 1) elsewhere."""
    magnitude = ir.intrinsic("fabs", x)
    z = ir.mul(x, x)
    ratio = _ratio(ir, z, *_table(ir.form).tanh)
    near = ir.fma(ir.mul(x, z), ratio, x)
    power = exp(ir, ir.add(magnitude, magnitude))
    decayed = ir.div(ir.constant(2.0), ir.add(power, ir.constant(1.0)))
    far = ir.sub(ir.constant(1.0), decayed)
    small = ir.compare("olt", magnitude, ir.constant(0.625))
    return ir.intrinsic("copysign", ir.select(small, near, far), x)


def _ratio(ir: VectorIR, z: str, top: Sequence[float], bottom: Sequence[float]) -> str:
    numerator = ir.polynomial(z, top)
    if len(bottom) == 1:
        return numerator
    return ir.div(numerator, ir.polynomial(z, bottom))


def atan(ir: VectorIR, x: str) -> str:
    """Return atan x; odd, reduced to a small |t| at 0, pi/4 or pi/2."""
    base, low, small = _atan_parts(ir, ir.intrinsic("fabs", x))
    value = ir.add(base, ir.add(small, low))
    return ir.intrinsic("copysign", value, x)


def _atan_parts(ir: VectorIR, x: str) -> tuple[str, str, str]:
    """Return base, low and small, with atan x = (base + low) + small for x >= 0.

    The base is 0, pi/4 or pi/2 rounded, low what that lacks of it.
    """
    table = _table(ir.form)
    top_coefficients, bottom_coefficients, limit = table.atan
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
        for part in table.pi_2[:2]
    )
    z = ir.mul(t, t)
    ratio = _ratio(ir, z, top_coefficients, bottom_coefficients)
    return base, low, ir.fma(ir.mul(t, z), ratio, t)


def atan2(ir: VectorIR, y: str, x: str) -> str:
    """Return the angle of (x, y), with the signs of zeros as C has them."""
    high, rest, _ = _table(ir.form).pi_2
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
    if ir.careful:
        return ir.beside("careful_pow", _careful_power, base, exponent)
    value, served = _power(ir, base, exponent)
    ir.mark(ir.select(served, ir.unserved, ir.constant(math.inf)))
    return value


def _careful_power(ir: VectorIR, base: str, exponent: str) -> str:
    value, served = _power(ir, base, exponent)
    return ir.select(served, value, ir.lane_by_lane("pow", base, exponent))


def _power(ir: VectorIR, base: str, exponent: str) -> tuple[str, str]:
    """Return base^exponent, and the mask of where it is right."""
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
    return _exp_of_sum(ir, product, rest), served


def _long_log(ir: VectorIR, x: str) -> tuple[str, str]:
    """Return log x, positive and normal, as a sum of two doubles.

    With s = f / (2 + f): log x = k ln 2 + 2 s + s^3 (2/3 + s^2 (2/5 + ...)).
    """
    k, f = _exponent_and_rest(ir, x)
    below = ir.add(f, ir.constant(2.0))
    s = ir.div(f, below)
    # f - s (2 + f), and what rounding took from 2 + f.
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
