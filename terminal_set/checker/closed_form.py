"""Checks of statements in closed form: matrices and bounds.

The largest |K_i e| on e'Pe <= alpha is sqrt(alpha K_i P^-1 K_i'), the largest |e_j| is
sqrt(alpha (P^-1)_jj). Between samples the set grows by sqrt(growth) + c at most, c the
relative error of the Runge-Kutta map and the drift of the reference.
"""

from __future__ import annotations

from collections.abc import Iterator

from flint import arb, arb_mat

from swarmstart.terminal_set.checker.certificate_file import Certificate, Matrix
from swarmstart.terminal_set.checker.coordinates import (
    identity,
    is_positive_definite,
    symmetric,
)
from swarmstart.terminal_set.checker.findings import Finding, Verdict
from swarmstart.terminal_set.checker.jets import square

ROUNDING = 1e-9  # relative; alpha may be a bound itself, computed in floats


def check_matrices(certificate: Certificate) -> list[Finding]:
    """Check that P is symmetric positive definite, and Q_m symmetric semidefinite.

    Args:
        certificate: The statements of the file.

    Returns:
        A finding for each matrix.
    """
    P = symmetric(certificate.P)
    is_zero = not any(entry for row in certificate.Q_m for entry in row)
    return [
        _judged(
            _is_symmetric(certificate.P) and is_positive_definite(P),
            "P is symmetric and positive definite",
        ),
        _judged(
            is_zero
            or (
                _is_symmetric(certificate.Q_m)
                and is_positive_definite(reserve(certificate))
            ),
            "Q_m is symmetric and positive semidefinite",
        ),
    ]


def check_bounds(certificate: Certificate) -> list[Finding]:
    """Check that inputs and states stay within their bounds on the whole set.

    Args:
        certificate: The statements of the file; P positive definite.

    Returns:
        A finding for each bound that exists.
    """
    inverse = symmetric(certificate.P).inv()
    bounds = certificate.bounds
    findings: list[Finding] = []
    for i, room in _rooms(
        certificate.u_ref, bounds["u_lower"], bounds["u_upper"], findings, "u"
    ):
        row = arb_mat([list(certificate.K[i])])
        reach = (row * inverse * row.transpose())[0, 0] * certificate.alpha
        findings.append(_within(reach, room, f"u[{i}]"))
    growth = _growth(certificate)
    measured = certificate.growth is not None and not certificate.growth_proven
    condition = " (if V grows no more than was measured)" if measured else ""
    if certificate.dt is not None and certificate.growth is None:
        condition = " (at the samples)"
    for j, room in _rooms(
        certificate.x_ref, bounds["x_lower"], bounds["x_upper"], findings, "x"
    ):
        reach = inverse[j, j] * certificate.alpha * growth
        findings.append(_within(reach, room, f"x[{j}]{condition}"))
    return findings


def reserve(certificate: Certificate) -> arb_mat:
    """Return Q_m, raised by a bound of its rounding; 0 stays 0.

    Args:
        certificate: The statements of the file.

    Returns:
        The matrix that must be semidefinite and that the decrease has in reserve.
    """
    size = max(abs(entry) for row in certificate.Q_m for entry in row)
    raised = identity(certificate.nx) * (arb(ROUNDING) * arb(size))
    return symmetric(certificate.Q_m) + raised


def relative_error(certificate: Certificate) -> arb:
    """Return the distance of a hold's end from the Runge-Kutta map's, over |e|_P.

    Args:
        certificate: The statements of the file; held.

    Returns:
        The error of the map and the drift of the reference.
    """
    return arb(certificate.integrator or 0.0) + arb(certificate.drift)


def _growth(certificate: Certificate) -> arb:
    if certificate.growth is None:
        return arb(1)
    return square(arb(certificate.growth).sqrt() + relative_error(certificate))


def _is_symmetric(matrix: Matrix) -> bool:
    size = max(abs(entry) for row in matrix for entry in row)
    n = range(len(matrix))
    return all(
        abs(matrix[i][j] - matrix[j][i]) <= ROUNDING * size for i in n for j in n
    )


def _rooms(
    reference: tuple[float, ...],
    lower: tuple[float | None, ...],
    upper: tuple[float | None, ...],
    findings: list[Finding],
    name: str,
) -> Iterator[tuple[int, arb]]:
    """Return the smaller side of each bounded entry; an entry outside is a finding."""
    for i, (value, low, high) in enumerate(zip(reference, lower, upper, strict=True)):
        sides = [] if low is None else [arb(value) - arb(low)]
        sides += [] if high is None else [arb(high) - arb(value)]
        if not sides:
            continue
        room = sides[0] if len(sides) == 1 else sides[0].min(sides[1])
        if room >= 0:
            yield i, room
        else:
            text = f"the reference of {name}[{i}], {value:g}, is outside its bounds"
            findings.append(Finding(Verdict.REFUSED, text))


def _within(reach2: arb, room: arb, name: str) -> Finding:
    if reach2 <= square(room):
        return Finding(
            Verdict.PROVED,
            f"{name} stays within its bounds: it moves by {_shown(reach2.sqrt())} of "
            f"{_shown(room)}",
        )
    return Finding(
        Verdict.REFUSED,
        f"{name} leaves its bounds: it moves by {_shown(reach2.sqrt())}, with room for "
        f"{_shown(room)}",
    )


def _judged(holds: bool, text: str) -> Finding:
    if holds:
        return Finding(Verdict.PROVED, text)
    return Finding(Verdict.REFUSED, f"it does not hold that {text}")


def _shown(value: arb) -> str:
    return f"{float(value.mid()):.6g}"
