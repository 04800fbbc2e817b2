"""Shapes of the controls within an interval: held, or linear between knots.

    constant    u(t) = v_k                                    from t_k to t_k+1
    linear      u(t) = q_k + (v_k - q_k) (t - t_k) / dt,   q_k+1 = v_k
    continuous  like linear, except that q_0 is given: the control before the horizon

v_k, k = 0 ... N - 1, are the controls of the core and keep their bounds. The knot q_k
at the start of an interval is a state, which the end of the interval sets to v_k. u(t)
is a state with the rate (v_k - q_k) / dt; all expressions use it in place of the
control.

Source: von Stryk and Bulirsch (1992), Direct and indirect methods for trajectory
optimization, Annals of Operations Research 37, for controls linear between nodes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import casadi as ca

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.limits import require_choice

ControlShape = Literal["constant", "linear", "continuous"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Knots:
    """States of a core that make its controls linear.

    Attributes:
        now: The control at the present time, shape (nu, 1).
        first: The knot at the start of the interval, shape (nu, 1).
    """

    now: ca.SX
    first: ca.SX

    @property
    def states(self) -> ca.SX:
        """Both states, one after the other, shape (2 nu, 1)."""
        return ca.vertcat(self.now, self.first)

    def rates(self, controls: ca.SX, dt: float) -> ca.SX:
        """Return the rates of both states.

        Args:
            controls: Controls at the end of the interval, shape (nu, 1).
            dt: Length of an interval, in units of the core's time.
        """
        return ca.vertcat((controls - self.first) / dt, ca.SX.zeros(self.first.numel()))

    def after(self, controls: ca.SX) -> ca.SX:
        """Return both states after the end of an interval; `now` is continuous."""
        return ca.vertcat(self.now, controls)


def knots_of(names: tuple[str, ...], shape: ControlShape) -> Knots:
    """Return the knot states of some controls; empty if the controls are held."""
    used = () if shape == "constant" else names
    pairs = [knot_names(name) for name in used]
    now, first = (
        ca.vertcat(ca.SX(0, 1), *[ca.SX.sym(pair[i]) for pair in pairs]) for i in (0, 1)
    )
    return Knots(now=now, first=first)


def knot_names(control: str) -> tuple[str, str]:
    """Return the names of the two states that belong to a linear control."""
    return f"control {control}", f"knot of {control}"


def control_of(knot: str, controls: Sequence[str]) -> int | None:
    """Return the number of the control whose knot a state is; None if it is no knot."""
    return next((j for j, u in enumerate(controls) if knot == knot_names(u)[1]), None)


def require_shape(shape: str, *, is_discrete: bool, integer: int) -> None:
    """Raise if the shape is unknown or the controls can only be held.

    Args:
        shape: Shape of the controls.
        is_discrete: Whether the model is in discrete time.
        integer: Number of controls that take whole numbers.

    Raises:
        InvalidProblemError: With the value given and what is allowed.
    """
    require_choice("control_shape", shape, get_args(ControlShape))
    if shape == "constant":
        return
    if is_discrete:
        raise InvalidProblemError(
            "a discrete-time model has controls of steps: its control_shape must be "
            f"constant, got {shape!r}"
        )
    if integer:
        raise InvalidProblemError(
            "controls that take whole numbers are held: control_shape must be "
            f"constant, got {shape!r}"
        )


def require_held(shapes: Iterable[str]) -> None:
    """Raise if a team or a dual mode cannot use these shapes of controls.

    Raises:
        InvalidProblemError: If a shape is not "constant".
    """
    for shape in shapes:
        if shape != "constant":
            raise InvalidProblemError(
                "a team and a dual mode use controls that are held: control_shape must "
                f"be constant, got {shape!r}"
            )


def split_knots(knots: Array, intervals: int) -> tuple[Array, Array]:
    """Return (first knot (nu,), controls (nu, N)) of knots or of held controls.

    Args:
        knots: Knots, shape (nu, N + 1); or held controls, shape (nu, N), whose first
            column is taken as the first knot.
        intervals: Number N of intervals.
    """
    if knots.shape[1] == intervals:
        return knots[:, 0], knots
    return knots[:, 0], knots[:, 1:]
