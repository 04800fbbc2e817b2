"""Coefficients and limits of the elementary functions, for each format.

Source: S. L. Moshier, Cephes mathematical library (1992), coefficients of sin, cos,
tanh, atan; FreeBSD msun e_log.c, e_logf.c (Sun Microsystems 1993), coefficients of log.
The coefficients of exp interpolate at the nodes of Chebyshev polynomials (computed with
mpmath).
"""

from dataclasses import dataclass

from swarmstart.ocp.compiled.vector_ir import DOUBLE, Format


@dataclass(frozen=True, kw_only=True, slots=True)
class Table:
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
)


def table(form: Format) -> Table:
    """Return the coefficients and limits for a format."""
    return _DOUBLE if form == DOUBLE else _SINGLE
