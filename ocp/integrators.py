"""One step of a differential equation x' = r(t, x) with a fixed step size h.

rk4    k1 = r(t, x), k2 = r(t + h/2, x + h/2 k1), k3 = r(t + h/2, x + h/2 k2),
       k4 = r(t + h, x + h k3),  x+ = x + h/6 (k1 + 2 k2 + 2 k3 + k4)
euler  x+ = x + h r(t, x)                      (what eq. 5.22 of the chapter says)
stiff  RODAS4, for models with modes that decay much faster than the step; rosenbrock.py

Controls are held constant over a step. The functions take expressions as well as
arrays: whatever r returns.

Where controls jump, fast modes of a stiff model leave their equilibrium, and a step
that is much longer damps them without having followed them: a cost of 1000 x^2 of such
a state would be missed, or counted for the whole step. So the first of the stiff steps
after a jump is taken in five parts, each four times as long as the one before. Modes
that decay at up to some thousand times 1 / step are followed to 1e-4 (with four steps,
RODAS4, a fast equilibrium of two states; 4e-2 without the parts).
"""

from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.limits import require_count
from swarmstart.ocp.model import Model, rate_of
from swarmstart.ocp.rosenbrock import Rate, prepared, rodas4


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


Integrator = Literal["rk4", "euler", "stiff"]
"""A name of an integrator, for where names must be known before anything runs."""
INTEGRATORS: dict[str, Callable[[Rate, ca.SX, float, float], ca.SX]] = {
    "rk4": rk4,
    "euler": euler,
    "stiff": rodas4,
}


def verifying_integrator(method: str) -> Integrator:
    """Return the integrator that traces what was planned by a method, of order 4."""
    return "stiff" if method == "stiff" else "rk4"


PARTS = 5
"""Of the first stiff step after a jump; see the module's head."""
MORE_PARTS = 8
"""Where the first of them is to be 5e-5 of the step, not 3e-3."""
_LONGER = 4.0
"""How much longer each part is than the one before."""


def stiff_lengths(h: float, steps: int, parts: int) -> list[float]:
    """Return the lengths of steps of length h whose first one is divided into parts."""
    return [*_lengths_of_parts(h, parts).tolist(), *[h] * (steps - 1)]


def _lengths_of_parts(h: float, parts: int) -> NDArray[np.float64]:
    lengths = _LONGER ** np.arange(parts)
    return np.asarray(h * lengths / lengths.sum())


def integrate(  # noqa: PLR0913 - an equation, a span of time and how it is divided
    method: str,
    rate: Rate,
    x: ca.SX,
    *,
    start: float,
    duration: float,
    steps: int,
    after_jump: bool = True,
    parts: int = PARTS,
) -> ca.SX:
    """Return x after `steps` equal steps over `duration` seconds from `start`.

    Args:
        method: A key of INTEGRATORS.
        rate: r(t, x).
        x: State at `start`.
        start: Time at which it begins [s].
        duration: How long it takes [s].
        steps: Number of equal steps.
        after_jump: Whether the rate jumps at `start`, or x begins there: then the first
            step is divided if the method is "stiff".
        parts: Into how many.
    """
    h = duration / steps
    if method == "stiff":
        return _stiffly(rate, x, start, h, steps, parts if after_jump else 1)
    step = INTEGRATORS[method]
    for k in range(steps):
        x = step(rate, x, start + k * h, h)
    return x


def _stiffly(
    rate: Rate, x: ca.SX, start: float, h: float, steps: int, parts: int
) -> ca.SX:
    """Return x after `steps` steps of length h, the first divided into parts."""
    step = prepared(rate, x.numel())
    lengths = _lengths_of_parts(h, parts)
    for end, length in zip(np.cumsum(lengths), lengths, strict=True):
        x = step(x, start + float(end - length), float(length))
    for k in range(1, steps):
        x = step(x, start + k * h, h)
    return x


def held_step(
    model: Model,
    dt: float,
    *,
    method: str = "rk4",
    substeps: int = 1,
    parts: int = PARTS,
) -> ca.Function:
    """Return F(x, u, p) -> x after dt seconds with u held, in `substeps` steps.

    Of a model with signals or a time it is F(x, u, p, s), s these at both ends of dt,
    shape (ns, 2), linear between. A jump at the end of an interval is not made.

    Args:
        model: The model.
        dt: Duration of the step [s], positive.
        method: A key of INTEGRATORS.
        substeps: Number of equal steps of the integrator within dt.
        parts: Of the first of them if the method is "stiff".

    Raises:
        InvalidProblemError: If dt, the method or the number of steps is invalid.
    """
    u = ca.SX.sym("u", model.nu)
    return _step(
        model, dt, u, lambda part: u, method=method, substeps=substeps, parts=parts
    )


def linear_step(model: Model, dt: float, *, method: str = "rk4") -> ca.Function:
    """Return F(x, u, p) -> x after dt seconds, u the controls at both ends, (2 nu, 1).

    They are linear between; else it is as `held_step`, in one step.

    Args:
        model: The model.
        dt: Duration of the step [s], positive.
        method: A key of INTEGRATORS.
    """
    u = ca.SX.sym("u", 2 * model.nu)
    first, last = ca.vertsplit(u, [0, model.nu, 2 * model.nu])
    return _step(
        model, dt, u, lambda part: first + part * (last - first), method=method
    )


def _step(  # noqa: PLR0913 - a step and what is held in it
    model: Model,
    dt: float,
    u: ca.SX,
    controls: Callable[[float], ca.SX],
    *,
    method: str,
    substeps: int = 1,
    parts: int = PARTS,
) -> ca.Function:
    """Return F(x, u, p, s) of a step, with controls at parts of it as told."""
    if not dt > 0:
        raise InvalidProblemError(f"dt must be positive, got {dt}")
    require_integrator(method, substeps)
    f = rate_of(model)
    x = ca.SX.sym("x", model.nx)
    p, ends = ca.SX.sym("p", model.np), ca.SX.sym("s", model.varying.numel(), 2)

    def rate(t: float, y: ca.SX) -> ca.SX:
        part = t / dt
        return f(y, controls(part), p, ends[:, 0] + part * (ends[:, 1] - ends[:, 0]))

    after = integrate(
        method, rate, x, start=0.0, duration=dt, steps=substeps, parts=parts
    )
    arguments = [x, u, p, ends] if ends.numel() else [x, u, p]
    names = ["x", "u", "p", "s"][: len(arguments)]
    return ca.Function("held_step", arguments, ca.cse([after]), names, ["x_next"])


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
