"""The statements on V(e) = e'Pe in the coordinates of the search, and at a point.

  continuous       c(e) = 2 e'P R(e) + e'Q_m e + 2 a V(e)
  held             c(e) = V(R(e)) - V(e) + e'Q_m e + (2 c + c^2) V(e)
  between samples  c(e) = V(R_t(e)) - growth V(e), for every t in [0, dt]
Each must be negative for every e != 0 with V(e) <= alpha. a is the drift of the
reference relative to the core (`drift.py`); c is the relative error of the Runge-Kutta
map, plus a: |motion - map|_P <= c |e|_P adds at most (2 c + c^2) V(e) if V does not
grow under the map.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

from flint import arb, arb_mat

from swarmstart.terminal_set.checker.certificate_file import Certificate, Vector
from swarmstart.terminal_set.checker.closed_form import relative_error, reserve
from swarmstart.terminal_set.checker.coordinates import (
    Floats,
    distance_from_identity,
    middle,
    root_of_inverse,
    rotation,
    symmetric,
)
from swarmstart.terminal_set.checker.deadline import NEVER, Deadline
from swarmstart.terminal_set.checker.decrease import (
    Interval,
    Outcome,
    Search,
    Statement,
)
from swarmstart.terminal_set.checker.motion import RelativeMotion

_PIECES = 64  # of a hold; measured: half as many take twice the boxes
_NARROWEST = 2.0**-12  # of dt; a piece of time is not halved any further
_BOXES_A_PIECE = 2000


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
