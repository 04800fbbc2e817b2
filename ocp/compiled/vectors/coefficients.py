"""Coefficients and limits of the elementary functions, for each format.

Source: S. L. Moshier, Cephes mathematical library (1992), coefficients of sin, cos,
tanh, atan; FreeBSD msun e_log.c, e_logf.c (Sun Microsystems 1993), coefficients of log.
The coefficients of exp, asin, sinh and erf interpolate at the nodes of Chebyshev
polynomials (computed with mpmath).
"""

from dataclasses import dataclass, replace

from swarmstart.ocp.compiled.vectors.vector_ir import DOUBLE, Format


@dataclass(frozen=True, kw_only=True, slots=True)
class Table:
    """Coefficients, highest power first, and limits for one format.

    "g in z" stands for the coefficients of a polynomial in z that approximates g. r is
    the argument of a function after its range was reduced.

    Attributes:
        pi_2: pi / 2 as a sum of parts, each of which has the next bits. They are
            rounded down, so that none is negative: else reducing -0 would give +0.
        huge_angle: Above it the reduction of an angle loses bits.
        sin: (sin r / r - 1) / r^2 in r^2.
        cos: cos r in r^2.
        ln2: ln 2 in two parts; a multiple of the first is exact.
        exp: exp r in r.
        exp_range: Two limits of x: below the first exp x is 0, above the second
            infinite.
        log: The series of log(1 + f) after its first terms, in z = (f / (2 + f))^2.
        root_half: The bits of sqrt(1/2).
        tanh: Numerator and denominator of (tanh x / x - 1) / x^2 in x^2.
        atan: Numerator and denominator of (atan x / x - 1) / x^2 in x^2, and the
            largest x for which they are valid.
        asin: (asin x / x - 1) / x^2 in x^2, up to x = 1/2.
        sinh: (sinh x / x - 1) / x^2 in x^2, up to x = 1.
        erf: erf x / x - 1 in x^2, up to x = 1.
        erf_tail: (1 - erf x) exp x^2 in 1 / (x + 3), from x = 1 until erf x is 1.
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
    asin: tuple[float, ...]
    sinh: tuple[float, ...]
    erf: tuple[float, ...]
    erf_tail: tuple[float, ...]


_DOUBLE = Table(
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
    asin=(
        0.028757851367421566,
        -0.014851887071247204,
        0.01740087944269402,
        0.005457506718640358,
        0.01032281435018578,
        0.011479177415184906,
        0.013971212973552933,
        0.017352392720869973,
        0.02237217294214989,
        0.030381944138531247,
        0.04464285714635543,
        0.07499999999998433,
        0.16666666666666669,
    ),
    sinh=(
        7.746178593018827e-13,
        1.6057679623801638e-10,
        2.5052117695907823e-08,
        2.7557319191381816e-06,
        0.00019841269841324198,
        0.008333333333333299,
        0.16666666666666666,
    ),
    erf=(
        -7.795898827002142e-10,
        1.3720064546777686e-08,
        -1.6208483801871705e-07,
        1.6447424703317362e-06,
        -1.492473690741966e-05,
        0.00012055294904839707,
        -0.0008548325975389692,
        0.0052239776071164225,
        -0.02686617064323777,
        0.11283791670945006,
        -0.37612638903183543,
        0.12837916709551256,
    ),
    erf_tail=(
        100321.025996593,
        -260512.055931156,
        293421.80833837454,
        -186798.79449594932,
        75849.69992134398,
        -22445.40603284159,
        5135.8661343263075,
        -708.6478016226661,
        174.55446138650822,
        20.342385791905986,
        13.473819204688667,
        4.753619387949182,
        1.6941264743931759,
        0.5641539803242877,
        3.7809408605387703e-07,
    ),
)

_SINGLE = Table(
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
    asin=(
        0.03369084720283012,
        0.017149238357677253,
        0.03110066273549457,
        0.04459940152851218,
        0.07500094543497424,
        0.16666666337430908,
    ),
    sinh=(
        2.8062802582276946e-06,
        0.00019838101968683888,
        0.00833333967591706,
        0.16666666646842135,
    ),
    erf=(
        7.875875062685488e-05,
        -0.000801686428716587,
        0.005189087423433974,
        -0.026854212010626412,
        0.11283594715160218,
        -0.37612626666720334,
        0.12837916584835093,
    ),
    erf_tail=(
        127.96570064999617,
        67.0535627342397,
        -16.398869818272235,
        12.879156326200926,
        0.5499664210299232,
        0.6470663850600857,
        -0.002458265257931566,
    ),
)


_UNFUSED_DOUBLE = replace(
    _DOUBLE,
    pi_2=(1.5707963267341256, 6.077100506303966e-11, 2.0222662487111665e-21),
    huge_angle=2.0**20,
)
"""Products with the parts of pi / 2, of 33 bits each, are exact by themselves."""
_UNFUSED_SINGLE = replace(
    _SINGLE,
    pi_2=(1.5706787109375, 0.00011761486530303955, 9.920935739593517e-10),
    huge_angle=2.0**10,
)
"""The same with parts of 14 bits."""


def table(form: Format) -> Table:
    """Return the coefficients and limits for a format."""
    if form.is_fused:
        return _DOUBLE if form == DOUBLE else _SINGLE
    return _UNFUSED_DOUBLE if form.bits == DOUBLE.bits else _UNFUSED_SINGLE
