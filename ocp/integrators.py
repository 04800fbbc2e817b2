"""One step of a differential equation x' = r(t, x) with a fixed step size h.

rk4    k1 = r(t, x), k2 = r(t + h/2, x + h/2 k1), k3 = r(t + h/2, x + h/2 k2),
       k4 = r(t + h, x + h k3),  x+ = x + h/6 (k1 + 2 k2 + 2 k3 + k4)
euler  x+ = x + h r(t, x)                      (what eq. 5.22 of the chapter says)

Controls are held constant over a step. The functions take expressions as well as
arrays: whatever r returns.
"""

from collections.abc import Callable
from typing import Literal

import casadi as ca

from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.limits import require_count
from swarmstart.ocp.model import Model, rate_of

Rate = Callable[[float, ca.SX], ca.SX]
"""r(t, x): the rate at time t after the step's beginning [s]."""


def rk4(rate: Rate, x: ca.SX, t: float, h: float) -> ca.SX:
    """Return x after one step of the classical Runge-Kutta method of order 4."""
    k1 = rate(t, x)
    k2 = rate(t + h / 2, x + h / 2 * k1)
    k3 = rate(t + h / 2, x + h / 2 * k2)
    k4 = rate(t + h, x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def euler(rate: Rate, x: ca.SX, t: float, h: float) -> ca.SX:
    """Return x after one step of the forward Euler method."""
    return x + h * rate(t, x)


Integrator = Literal["rk4", "euler"]
"""A name of an integrator, for where names must be known before anything runs."""
INTEGRATORS: dict[str, Callable[[Rate, ca.SX, float, float], ca.SX]] = {
    "rk4": rk4,
    "euler": euler,
}


def integrate(
    method: str, rate: Rate, x: ca.SX, *, start: float, duration: float, steps: int
) -> ca.SX:
    """Return x after `steps` equal steps over `duration` seconds from `start`."""
    step = INTEGRATORS[method]
    h = duration / steps
    for k in range(steps):
        x = step(rate, x, start + k * h, h)
    return x


def held_step(
    model: Model, dt: float, *, method: str = "rk4", substeps: int = 1
) -> ca.Function:
    """Return F(x, u, p) -> x after dt seconds with u held, in `substeps` steps.

    Of a model with signals or a time it is F(x, u, p, s), s these at both ends of dt,
    shape (ns, 2), linear between. A jump at the end of an interval is not made.

    Args:
        model: The model.
        dt: Duration of the step [s], positive.
        method: A key of INTEGRATORS.
        substeps: Number of equal steps of the integrator within dt.

    Raises:
        InvalidProblemError: If dt, the method or the number of steps is invalid.
    """
    if not dt > 0:
        raise InvalidProblemError(f"dt must be positive, got {dt}")
    require_integrator(method, substeps)
    f = rate_of(model)
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p, ends = ca.SX.sym("p", model.np), ca.SX.sym("s", model.varying.numel(), 2)

    def rate(t: float, y: ca.SX) -> ca.SX:
        return f(y, u, p, ends[:, 0] + t / dt * (ends[:, 1] - ends[:, 0]))

    after = integrate(method, rate, x, start=0.0, duration=dt, steps=substeps)
    arguments = [x, u, p, ends] if ends.numel() else [x, u, p]
    names = ["x", "u", "p", "s"][: len(arguments)]
    return ca.Function("held_step", arguments, [after], names, ["x_next"])


def require_integrator(method: str, substeps: int) -> None:
    """Refuse an unknown method or a number of steps below one.

    Raises:
        InvalidProblemError: Naming what is allowed.
    """
    if method not in INTEGRATORS:
        raise InvalidProblemError(
            f"integrator must be one of {', '.join(INTEGRATORS)}, got {method!r}"
        )
    require_count("substeps", substeps)
