"""What a certificate states in closed form: matrices, bounds, equilibrium, margin.

The largest |K_i e| on e'Pe <= alpha is sqrt(alpha K_i P^-1 K_i'), the largest |e_j| is
sqrt(alpha (P^-1)_jj). Between samples the set grows by sqrt(growth) + c at most, c the
relative error of the Runge-Kutta map.
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
from swarmstart.terminal_set.checker.deadline import Deadline
from swarmstart.terminal_set.checker.findings import Finding, Verdict
from swarmstart.terminal_set.checker.jets import VALUES, square
from swarmstart.terminal_set.checker.motion import (
    Program,
    live_instructions,
    rate,
)

NEARBY = 1e-12  # of an entry of the reference; it is computed in floats
ROUNDING = 1e-9  # relative; alpha may be a bound itself, computed in floats


def check_matrices(certificate: Certificate) -> list[Finding]:
    """P is symmetric positive definite, Q_m symmetric and takes nothing away.

    Args:
        certificate: What the file states.

    Returns:
        One finding a matrix.
    """
    P, Q_m = symmetric(certificate.P), symmetric(certificate.Q_m)
    size = max(abs(entry) for row in certificate.Q_m for entry in row)
    # A reserve may be singular, even 0, and is rounded.
    raised = Q_m + identity(certificate.nx) * arb(ROUNDING * size or 1.0)
    return [
        _judged(
            _is_symmetric(certificate.P) and is_positive_definite(P),
            "P is symmetric and positive definite",
        ),
        _judged(
            _is_symmetric(certificate.Q_m) and is_positive_definite(raised),
            "Q_m is symmetric and positive semidefinite",
        ),
    ]


def check_bounds(certificate: Certificate) -> list[Finding]:
    """Inputs and states stay within their bounds on the whole set.

    Args:
        certificate: What the file states; P positive definite.

    Returns:
        One finding a bound that exists.
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


def check_equilibrium(certificate: Certificate, deadline: Deadline) -> Finding:
    """At the reference only states may move on which the dynamics do not depend.

    Args:
        certificate: What the file states.
        deadline: When to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: When the deadline has passed.
    """
    x = [VALUES.constant(_around(value)) for value in certificate.x_ref]
    u = [VALUES.constant(_around(value)) for value in certificate.u_ref]
    rates = [jet.value for jet in rate(Program.of(certificate, deadline), x, u)]
    felt = {
        certificate.tape[index][1][0]
        for index in live_instructions(certificate)
        if certificate.tape[index][0] == "x"
    }
    for j, slope in enumerate(rates):
        if j in felt and not slope.contains(0):
            return Finding(
                Verdict.REFUSED,
                f"the reference is no equilibrium: x[{j}] moves at {_shown(slope)} and "
                "the dynamics depend on it",
            )
    return Finding(
        Verdict.PROVED,
        "the reference is an equilibrium, but for states on which nothing depends",
    )


def _around(value: float) -> arb:
    """The points within rounding of a number: one of them is to be the equilibrium."""
    return arb(value, abs(value) * NEARBY)


def _growth(certificate: Certificate) -> arb:
    if certificate.growth is None:
        return arb(1)
    error = arb(certificate.integrator or 0.0)
    return square(arb(certificate.growth).sqrt() + error)


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
    """The smaller side of each bounded entry; an entry outside is a finding."""
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
    if reach2 <= square(room) * (1 + arb(ROUNDING)):
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
