"""One step of a differential equation x' = r(t, x) with a fixed step size h.

rk4    k1 = r(t, x), k2 = r(t + h/2, x + h/2 k1), k3 = r(t + h/2, x + h/2 k2),
       k4 = r(t + h, x + h k3),  x+ = x + h/6 (k1 + 2 k2 + 2 k3 + k4)
euler  x+ = x + h r(t, x)                      (eq. 5.22 of the chapter)
stiff  RODAS4, for models with modes that decay much faster than the step; rodas.py

Controls are held constant over a step. The functions take expressions as well as
arrays, depending on the return value of r.

If controls jump, the fast modes of a stiff model leave their equilibrium, and a much
longer step damps them without resolving them. A cost of 1000 x^2 of such a state would
be missed, or counted for the whole step. So the first stiff step after a jump is taken
in five parts, each four times as long as the one before. Modes with decay rates up to
some thousand times 1 / step are then resolved to 1e-4, and without the parts only to
4e-2 (measured with four steps of RODAS4 and a fast equilibrium of two states).
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import a_count, a_number, checked, of_kind, text
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.limits import require_count
from swarmstart.ocp.integration.rodas import Rate, prepared, rodas4
from swarmstart.ocp.system.model import Model, rate_of


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


@dataclass(frozen=True, kw_only=True, slots=True)
class Method:
    """An integrator and its properties.

    Attributes:
        step: Function (r, x, t, h) -> x after one step of length h of x' = r(t, x).
        order: Order of convergence.
        evaluations: Number of evaluations of r in a step.
        growth: Coefficients of R(z), from z^0 on; a step of length h multiplies a mode
            x' = lambda x by R(h lambda). Empty: a stable mode decays at any step length
            (implicit).
        stable: Recommended largest |h lambda|, inside the stable region with a margin.
    """

    step: Callable[[Rate, ca.SX, float, float], ca.SX]
    order: int
    evaluations: int
    growth: tuple[float, ...] = ()
    stable: float = np.inf


INTEGRATORS = {
    "rk4": Method(
        step=rk4,
        order=4,
        evaluations=4,
        growth=(1, 1, 1 / 2, 1 / 6, 1 / 24),
        stable=2.5,  # of 2.79 on the real axis, 2.83 on the imaginary one
    ),
    "euler": Method(step=euler, order=1, evaluations=1, growth=(1, 1), stable=1.4),
    "stiff": Method(step=rodas4, order=4, evaluations=6),
}
"""Integrators by the names that problems and scenarios use; their only registration."""
Integrator = str
"""Name of an integrator: a key of INTEGRATORS."""


def verifying_integrator(method: str) -> Integrator:
    """Return the integrator, of order 4, that verifies plans made with a method."""
    return "rk4" if INTEGRATORS[method].growth else "stiff"


PARTS = 5
"""Number of parts of the first stiff step after a jump; see the module's head."""
_MOST_PARTS = 100
"""Largest number of parts: the first of them would be 4^-99 of the step."""
MORE_PARTS = 8
"""Number of parts for a first part of 5e-5 of the step instead of 3e-3."""
INSIDE = 1e-9
"""Part of a step by which the time is read inside of its ends, so that a function of
time that jumps at an end has the value that it has within; far above rounding."""
_LONGER = 4.0
"""Ratio of the lengths of two consecutive parts."""


def stiff_lengths(h: float, steps: int, parts: int) -> list[float]:
    """Return step lengths: a first step h in parts, then whole steps h."""
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
        rate: Function r(t, x), the derivative of x.
        x: State at `start`.
        start: Start time [s].
        duration: Time span [s].
        steps: Number of equal steps.
        after_jump: Whether the rate or the state jumps at `start`. Then the first step
            is divided into parts if the method is "stiff".
        parts: Number of these parts.
    """
    h = duration / steps
    if method == "stiff":
        return _stiffly(rate, x, start, h, steps, parts if after_jump else 1)
    step = INTEGRATORS[method].step
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


@checked(
    refused,
    model=of_kind(Model, "a Model"),
    dt=a_number(above=0),
    method=text(),
    substeps=a_count(least=1),
    parts=a_count(least=1, most=_MOST_PARTS),
)
def held_step(
    model: Model,
    dt: float,
    *,
    method: str = "rk4",
    substeps: int = 1,
    parts: int = PARTS,
) -> ca.Function:
    """Return F(x, u, p) -> x after dt seconds with u held, in `substeps` steps.

    x are the states, u the controls and p the parameters. For a model with signals or a
    time the function is F(x, u, p, s), with s their values at both ends of dt, shape
    (ns, 2), linear in between. A jump of the model at the end of an interval is not
    included.

    Args:
        model: The model.
        dt: Duration of the step [s], positive.
        method: A key of INTEGRATORS.
        substeps: Number of equal steps of the integrator within dt.
        parts: Number of parts of the first step if the method is "stiff".

    Returns:
        The function F.

    Raises:
        InvalidProblemError: If dt is not positive, the method is unknown, or `substeps`
            is below 1.
    """
    u = ca.SX.sym("u", model.nu)
    return _step(
        model, dt, u, lambda part: u, method=method, substeps=substeps, parts=parts
    )


def linear_step(model: Model, dt: float, *, method: str = "rk4") -> ca.Function:
    """Return F(x, u, p) -> x after dt seconds, u the controls at both ends, (2 nu, 1).

    The controls are linear in between. Otherwise F is as in `held_step`, with one step.

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
    """Return F(x, u, p, s) of a step, with the controls evaluated within it."""
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
    """Raise if the method is unknown or the number of steps is below one.

    Raises:
        InvalidProblemError: With the value given and what is allowed.
    """
    if method not in INTEGRATORS:
        raise InvalidProblemError(
            f"integrator must be one of {', '.join(INTEGRATORS)}, got {method!r}"
        )
    require_count("substeps", substeps)
