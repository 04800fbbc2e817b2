"""The statements on V(e) = e'Pe: in closed form, at a point, and for the search.

  matrices         P is symmetric and positive definite, Q_m semidefinite
  bounds           on e'Pe <= alpha the largest |K_i e| is sqrt(alpha K_i P^-1 K_i'),
                   the largest |e_j| is sqrt(alpha (P^-1)_jj). Between samples the set
                   grows by sqrt(growth) + c at most
  continuous       c(e) = 2 e'P R(e) + e'Q_m e + 2 a V(e)
  held             c(e) = V(R(e)) - V(e) + e'Q_m e + (2 c + c^2) V(e)
  between samples  c(e) = V(R_t(e)) - growth V(e), for every t in [0, dt]
The last three must be negative for every e != 0 with V(e) <= alpha. a is the drift of
the reference relative to the core (`motion.py`); c is the relative error of the
Runge-Kutta map, plus a: |motion - map|_P <= c |e|_P adds at most (2 c + c^2) V(e) if V
does not grow under the map.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence

from flint import arb, arb_mat

from swarmstart.terminal_set.checker.certificate_file import Certificate, Matrix, Vector
from swarmstart.terminal_set.checker.coordinates import (
    Floats,
    distance_from_identity,
    identity,
    is_positive_definite,
    middle,
    root_of_inverse,
    rotation,
    symmetric,
)
from swarmstart.terminal_set.checker.decrease import (
    Interval,
    Outcome,
    Search,
    Statement,
)
from swarmstart.terminal_set.checker.findings import NEVER, Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.jets import square
from swarmstart.terminal_set.checker.motion import RelativeMotion

_PIECES = 64  # of a hold; measured: half as many take twice the boxes
_NARROWEST = 2.0**-12  # of dt; a piece of time is not halved any further
_BOXES_A_PIECE = 2000

ROUNDING = 1e-9  # relative; alpha may be a bound itself, computed in floats


class PointwiseChange:
    """V and its change at single points, in balls.

    Attributes:
        certificate: The statements of the file.
        motion: The motion relative to the reference.
    """

    def __init__(self, certificate: Certificate, deadline: Deadline = NEVER) -> None:
        """Convert the matrices to balls."""
        self.certificate = certificate
        self.motion = RelativeMotion(certificate, deadline)
        self._P = symmetric(certificate.P)
        self._Q_m = symmetric(certificate.Q_m)

    def level(self, e: Sequence[arb]) -> arb:
        """V(e)."""
        return _form(self._P, e)

    def change(self, e: Vector) -> arb:
        """c(e) of the decrease, continuous or held.

        Args:
            e: State relative to the reference, shape (nx,).

        Returns:
            A ball around c(e).
        """
        point = [arb(entry) for entry in e]
        change = _form(self._Q_m, point)
        dt = self.certificate.dt
        moved = self.motion.at(point, None if dt is None else arb(dt))
        if dt is None:
            row = arb_mat([point]) * self._P
            change += 2 * (row * arb_mat([[entry] for entry in moved]))[0, 0]
            return change + 2 * arb(self.certificate.drift) * self.level(point)
        margin = margin_of_map(self.certificate)
        return self.level(moved) - (1 - margin) * self.level(point) + change

    def excess(self, e: Vector, time: float) -> arb:
        """V(R_t(e)) - growth V(e) of the statement between samples.

        Args:
            e: State relative to the reference, shape (nx,).
            time: Time since the sample [s].

        Returns:
            A ball around it.
        """
        point = [arb(entry) for entry in e]
        growth = arb(self.certificate.growth or 1.0)
        moved = self.motion.at(point, arb(time))
        return self.level(moved) - growth * self.level(point)

    def is_inside(self, e: Vector) -> bool:
        """Return whether e != 0 is certainly in the set."""
        value = self.level([arb(entry) for entry in e])
        return bool(value > 0 and value <= self.certificate.alpha)

    def violates_decrease(self, e: Vector, time: float) -> bool:
        """Return whether the decrease certainly fails at e."""
        return self.is_inside(e) and bool(self.change(e) >= 0)

    def violates_growth(self, e: Vector, time: float) -> bool:
        """Return whether the bound between samples certainly fails at e and time."""
        return self.is_inside(e) and bool(self.excess(e, time) >= 0)


def margin_of_map(certificate: Certificate) -> arb:
    """2 c + c^2 for the relative error c of the Runge-Kutta map and of the drift."""
    error = relative_error(certificate)
    return 2 * error + error * error


def decrease_statement(
    certificate: Certificate, deadline: Deadline = NEVER
) -> Statement:
    """Return the statement c(e) < 0 on the set without 0.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which every evaluation of the motion stops.

    Returns:
        The statement for the search.
    """
    points = PointwiseChange(certificate, deadline)
    dt = certificate.dt or 0.0
    kept = reserve(certificate)
    if certificate.dt is None:
        weight = None
        kept += symmetric(certificate.P) * (2 * arb(certificate.drift))
    else:
        weight = 1 - margin_of_map(certificate)
    return _statement(
        points,
        times=(dt, dt),
        weight=weight,
        kept=kept,
        between=False,
    )


def prove_decrease(certificate: Certificate, deadline: Deadline) -> Outcome:
    """Try to prove the decrease on the set.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which to stop.

    Returns:
        The outcome of the search.
    """
    return Search(decrease_statement(certificate, deadline), deadline).run()


def growth_statement(
    certificate: Certificate, times: Interval, deadline: Deadline = NEVER
) -> Statement:
    """Return the statement V(R_t(e)) < growth V(e) on the set without 0, for some t.

    Args:
        certificate: The statements of the file; P positive definite, growth given.
        times: Shortest and longest time t since the sample [s]; it holds for all t in
            between.
        deadline: Time at which every evaluation of the motion stops.

    Returns:
        The statement for the search.
    """
    return _statement(
        PointwiseChange(certificate, deadline),
        times=times,
        weight=arb(certificate.growth or 1.0),
        kept=arb_mat(certificate.nx, certificate.nx),
        between=True,
    )


def prove_growth(certificate: Certificate, deadline: Deadline) -> Outcome:
    """Try to prove the growth between samples, one piece of time after another.

    Each piece has its own rotation T, which makes its quadratic part nearly diagonal. A
    piece that takes many boxes is halved, which is faster than to continue.

    Args:
        certificate: The statements of the file; P positive definite, growth given.
        deadline: Time at which to stop.

    Returns:
        The outcome of the search; its boxes are those of all pieces.
    """
    dt = certificate.dt or 0.0
    ends = [dt * i / _PIECES for i in range(_PIECES)] + [dt]
    # The last one is taken first, so the earliest stands last.
    pieces, boxes = list(itertools.pairwise(ends))[::-1], 0
    while pieces:
        low, high = pieces.pop()
        narrow = high - low < dt * _NARROWEST
        most = math.inf if narrow else _BOXES_A_PIECE
        statement = growth_statement(certificate, (low, high), deadline)
        outcome = Search(statement, deadline, most).run()
        boxes += outcome.boxes
        if outcome.proven:
            continue
        late = deadline.has_passed
        if outcome.counterexample is not None or narrow or late:
            where = f"in t = {low:.4g} to {high:.4g} s: {outcome.remark}"
            return dataclasses.replace(outcome, boxes=boxes, remark=where)
        middle_time = 0.5 * (low + high)
        pieces += [(middle_time, high), (low, middle_time)]
    return Outcome(proven=True, counterexample=None, boxes=boxes)


def _statement(
    points: PointwiseChange,
    *,
    times: tuple[float, float],
    weight: arb | None,
    kept: arb_mat,
    between: bool,
) -> Statement:
    def in_coordinates(T: Floats) -> Statement:
        matrix = arb_mat(T)
        P = symmetric(points.certificate.P)
        delta = distance_from_identity(matrix.transpose() * P * matrix)
        held = weight is not None
        radius = (arb(points.certificate.alpha) / (1 - delta)).sqrt().upper()
        return Statement(
            motion=points.motion,
            T=T,
            image=matrix.inv() if held else matrix.transpose() * P,
            M=matrix.transpose() * kept * matrix,
            scale=1 + delta if held else None,
            constant=arb(0) if weight is None else -_least(weight, delta),
            radius=math.nextafter(float(radius), math.inf),
            times=times,
            is_counterexample=(
                points.violates_growth if between else points.violates_decrease
            ),
        )

    # The rotation is that of the quadratic form in coordinates without one.
    upright = root_of_inverse(symmetric(points.certificate.P))
    linear = Search(in_coordinates(upright), NEVER)
    middle_time = 0.5 * (times[0] + times[1])
    turned = rotation(middle(linear.quadratic_form((middle_time, middle_time))))
    return in_coordinates(middle(arb_mat(upright) * arb_mat(turned)))


def _least(weight: arb, delta: arb) -> arb:
    """The least of weight V(e)/rho^2, V(e)/rho^2 within 1 - delta and 1 + delta."""
    return (weight * (1 - delta)).min(weight * (1 + delta))


def _form(matrix: arb_mat, e: Sequence[arb]) -> arb:
    column = arb_mat([[entry] for entry in e])
    return (column.transpose() * matrix * column)[0, 0]


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
