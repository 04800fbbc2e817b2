"""The statements on V(e) = e'Pe.

Some are checked here by formulas; the others become tasks of a branch and bound over
boxes. R(e) is the rate of e (continuous input), or e after a hold (held input), and
R_t(e) is e after the time t of a hold, see `motion.py`; Q_m is the matrix of the margin
by which V must decrease.

  matrices         P is symmetric and positive definite, Q_m semidefinite
  bounds           on e'Pe <= alpha the largest |K_i e| is sqrt(alpha K_i P^-1 K_i'),
                   the largest |e_j| is sqrt(alpha (P^-1)_jj). Between samples V grows
                   at most by the factor growth, so |e_j| at most by sqrt(growth) + b
                   (b: see below); a held input does not change
  continuous       c(e) = 2 e'P R(e) + e'Q_m e + 2 a V(e)
  held             c(e) = V(R(e)) - V(e) + e'Q_m e + (2 b + b^2) V(e)
  between samples  c(e) = V(R_t(e)) - growth V(e), for every t in [0, dt]
The last three must be negative for every e != 0 with V(e) <= alpha. a is the drift of
the reference, relative to sqrt(core); V <= core is a small set in which the decrease is
not claimed (`motion.py`). b is the sum of a and the relative error of the Runge-Kutta
map: |motion - map|_P <= b |e|_P adds at most (2 b + b^2) V(e) if V does not grow under
the map.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat, fmpq

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.coordinates import (
    distance_from_identity,
    is_positive_definite,
    root_of_inverse,
    rotation,
    square,
    symmetric,
)
from swarmstart.terminal_set.checker.ellipsoid_search import (
    Change,
    DecreaseTask,
    Rows,
    quadratic_forms,
)
from swarmstart.terminal_set.checker.file_content import Matrix
from swarmstart.terminal_set.checker.findings import NEVER, Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.models import Array
from swarmstart.terminal_set.checker.motion import RelativeMotion
from swarmstart.terminal_set.checker.search import Outcome, prove

_PIECES = 64  # of a hold, each with coordinates of its own

ROUNDING = 1e-9  # relative; alpha may be a bound itself, computed in floats


def change_of(
    certificate: Certificate, deadline: Deadline = NEVER, *, is_raised: bool = False
) -> Change:
    """Return the change c(e) of V(e) = e'Pe, with its margins; it must be negative.

    It is the change over a hold if the file states a time for which inputs are held,
    else the change per second.

    Args:
        certificate: The statements of the file.
        deadline: Time at which every evaluation of the motion stops.
        is_raised: Whether a bound of the rounding of Q_m is added to Q_m, the matrix of
            the margin; proofs need this.
    """
    P = exact(certificate.P)
    Q_m = reserve(certificate) if is_raised else exact(certificate.Q_m)
    if certificate.dt is None:
        weight = 2 * Fraction(certificate.drift)
    else:
        weight = margin_of_map(certificate) - 1
    return Change(
        motion=RelativeMotion(certificate, deadline),
        P=P,
        M=_plus(Q_m, weight, P),
        time=None if certificate.dt is None else Fraction(certificate.dt),
    )


def margin_of_map(certificate: Certificate) -> Fraction:
    """Return 2 b + b^2, the margin for the errors of the motion over a hold.

    b is the sum of the Runge-Kutta map's relative error and the reference's drift.
    """
    error = relative_error(certificate)
    return 2 * error + error * error


def decrease_task(certificate: Certificate, deadline: Deadline = NEVER) -> DecreaseTask:
    """Return the task to prove that V(e) = e'Pe decreases on the set without e = 0.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which every evaluation of the motion stops.
    """
    raised = change_of(certificate, deadline, is_raised=True)
    return _task(certificate, raised, change_of(certificate, deadline), None)


def growth_task(certificate: Certificate, deadline: Deadline = NEVER) -> DecreaseTask:
    """Return the task to prove V(R_t(e)) < growth V(e) on the set without e = 0.

    R_t(e) is the deviation at a time t after a sample with the deviation e; the
    inequality must hold for all t up to the next sample.

    Args:
        certificate: The statements of the file; P positive definite, growth given.
        deadline: Time at which every evaluation of the motion stops.
    """
    P = exact(certificate.P)
    nothing = [[Fraction(0)] * len(P)] * len(P)
    change = Change(
        motion=RelativeMotion(certificate, deadline),
        P=P,
        M=_plus(nothing, -Fraction(certificate.growth or 1.0), P),
        time=None,
    )
    dt = certificate.dt or 0.0
    times = np.array([dt * i / _PIECES for i in range(_PIECES)] + [dt])
    return _task(certificate, change, change, times)


def prove_on_set(task: DecreaseTask, deadline: Deadline) -> Outcome:
    """Try to prove a statement on the set.

    Args:
        task: The statement.
        deadline: Time at which to stop.

    Returns:
        The outcome of the search.
    """
    with np.errstate(all="ignore"):
        # No box around the centre can be proven without a margin, so give up at once.
        if task.times is None and not task.largest < 0.0:
            return Outcome(
                False,
                0,
                remark="the linear part has no margin: the largest quotient of its "
                f"quadratic form is {task.largest:.3g}",
            )
        return prove(task, task.roots(), deadline)


def _task(
    certificate: Certificate, change: Change, stated: Change, times: Array | None
) -> DecreaseTask:
    P = symmetric(certificate.P)
    upright = np.array(root_of_inverse(P))
    pieces = 1 if times is None else len(times) - 1
    with np.errstate(all="ignore"):
        forms = quadratic_forms(change, np.array([upright] * pieces), times)
    # The rotation is that of the quadratic form in coordinates without one.
    T = np.array([upright @ np.array(rotation(form.tolist())) for form in forms])
    delta = [
        float(distance_from_identity(matrix.transpose() * P * matrix))
        for matrix in (arb_mat(one.tolist()) for one in T)
    ]
    return DecreaseTask(
        change=change,
        stated=stated,
        alpha=certificate.alpha,
        T=T,
        delta=np.nextafter(delta, np.inf),
        times=times,
    )


def _plus(a: Rows, weight: Fraction, b: Rows) -> Rows:
    return [
        [p + weight * q for p, q in zip(*rows, strict=True)]
        for rows in zip(a, b, strict=True)
    ]


def exact(rows: Matrix) -> Rows:
    """Return the symmetric part of a square matrix as fractions."""
    n = range(len(rows))
    return [[(Fraction(rows[i][j]) + Fraction(rows[j][i])) / 2 for j in n] for i in n]


def check_matrices(certificate: Certificate) -> list[Finding]:
    """Check that P is symmetric positive definite, and Q_m symmetric semidefinite.

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
                and is_positive_definite(
                    arb_mat(
                        [
                            [_ball(entry) for entry in row]
                            for row in reserve(certificate)
                        ]
                    )
                )
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


def reserve(certificate: Certificate) -> Rows:
    """Return Q_m plus a bound of its rounding on the diagonal; a zero Q_m stays zero.

    Returns:
        Matrix of the quadratic form by which V must decrease at least, shape (nx, nx).
        It must be positive semidefinite.
    """
    size = max(abs(entry) for row in certificate.Q_m for entry in row)
    raised = Fraction(ROUNDING) * Fraction(size)
    return [
        [entry + raised * (i == j) for j, entry in enumerate(row)]
        for i, row in enumerate(exact(certificate.Q_m))
    ]


def relative_error(certificate: Certificate) -> Fraction:
    """Return a bound of |motion - Runge-Kutta map|_P over a hold, relative to |e|_P.

    Args:
        certificate: The statements of the file, for an input that is held.

    Returns:
        The sum of the map's error and the reference's drift.
    """
    return Fraction(certificate.integrator or 0.0) + Fraction(certificate.drift)


def _growth(certificate: Certificate) -> arb:
    if certificate.growth is None:
        return arb(1)
    return square(arb(certificate.growth).sqrt() + _ball(relative_error(certificate)))


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


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
