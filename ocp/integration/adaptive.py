"""RODAS4 with step sizes controlled by the estimated error, between two checks.

A tick tries one step of length h and estimates its error. The estimate is the
difference to the embedded solution of order 3 (rosenbrock.py), divided by its limit:

    e^2 = sum_i (k_6i / (tolerance s_i))^2,   s_i = max(|x_i| so far, |x+_i|, f_i)

The step is accepted if e <= 1 and repeated otherwise. In both cases the next length is

    h min(6, max(1/5, 0.9 e^(-1/4)))

as in the code RODAS, which however uses the mean instead of the sum; with the sum,
adding states that are at rest changes nothing. The maximum of |x_i| starts anew at each
interval. The floor f_i keeps a state that is zero except for rounding from being
measured by itself: tolerance * f_i is 1e-15 of the state's natural size (scaling.py).
The criterion is therefore independent of units.

A tick works on one column z = (y, largest |y| so far, left, h): y holds the states and,
if costs are integrated, their integrals; left and h are fractions of the time between
two checks. The integration is done when left is 0; further ticks change nothing. So
many individuals can advance side by side until the last one is done: by a loop in
machine code (compiled/ticks.py), by nested calls in CasADi, most of which are skipped.
If h becomes too small, as for a solution that explodes, left is set to -1; this, or too
many ticks, sets y to NaN.

A step much longer than the fast modes damps them without resolving them, and its error
estimate hardly shows that. The controls jump at the start of an interval, so the first
step there is a small fraction of the expected step.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.7 and
IV.8, for the step size control.
"""

from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.ocp.integration.rosenbrock import Rate, rodas4_with_error

Symbolic = TypeVar("Symbolic", ca.SX, ca.MX, ca.DM)
FINEST, COARSEST = 1e-12, 0.1
"""Range of tolerances for which step size control works."""
MOST_GROWTH, LEAST_GROWTH, SAFETY = 6.0, 0.2, 0.9
"""Limits of the ratio of a step length to the one before, as in rodas.f."""
SHORTEST = 1e-15
"""Shortest step, as a fraction of the time between checks; below it, no solution."""
LAST = 1.01
"""Number of remaining steps up to which one step is stretched to the end."""
FIRST = 1 / 341
"""First step of an interval, as a fraction of the expected step."""
ROUNDED = 1e-15
"""Fraction of a natural size that counts as rounding."""
_FINER = 10.0
_AT_ONCE, _LEVELS = 8, 4
MOST_TICKS = _AT_ONCE**_LEVELS
"""Largest number of steps tried between two checks."""


def finer(tolerance: float) -> float:
    """Return the tolerance of the finer steps used for comparison."""
    return max(tolerance / _FINER, FINEST)


def column_at_begin(x: Symbolic, *, integrals: int, steps: int) -> Symbolic:
    """Return z at the start of an interval.

    Args:
        x: States, shape (nx, 1).
        integrals: Number of integrals, which start at 0.
        steps: Expected number of steps between two checks.
    """
    y = ca.vertcat(x, ca.DM.zeros(integrals, 1))
    return ca.vertcat(y, ca.fabs(y), 1.0, FIRST / steps)


def column_at_check(z: Symbolic) -> Symbolic:
    """Return z at the start of the next check, from z at the end of the last one."""
    return ca.vertcat(z[: z.numel() - 2], 1.0, z[-1])


def values_of(z: Symbolic) -> Symbolic:
    """Return y, the first part of z."""
    return z[: (z.numel() - 2) // 2]


def ticked(
    rate: Rate, z: ca.SX, sizes: ca.SX, *, duration: float, tolerance: float
) -> ca.SX:
    """Return z after one tick.

    Args:
        rate: r(t, y), with t measured from the start of the check [s].
        z: See the module's head, shape (2 ny + 2, 1).
        sizes: Natural sizes of y, shape (ny, 1).
        duration: Time between two checks [s].
        tolerance: Allowed relative error of a step.
    """
    n = (z.numel() - 2) // 2
    y, most, left, h = ca.vertsplit(z, [0, n, 2 * n, 2 * n + 1, 2 * n + 2])
    step = ca.if_else(left < LAST * h, left, h)
    after, error = rodas4_with_error(
        rate,
        y,
        (1 - left) * duration,  # type: ignore[arg-type]
        step * duration,  # type: ignore[arg-type]
    )
    least = ROUNDED / tolerance * sizes
    reached = ca.fmax(most, ca.fabs(after))
    e2 = ca.sumsqr(error / (tolerance * ca.fmax(reached, least)))
    good = e2 <= 1  # False for NaN.
    wanted = SAFETY / ca.sqrt(ca.sqrt(ca.sqrt(e2)))
    following = step * ca.fmin(MOST_GROWTH, ca.fmax(LEAST_GROWTH, wanted))
    cut = ca.logic_and(good, step < h)  # Says little of the next step.
    following = ca.if_else(cut, ca.fmax(h, following), following)
    running = left > 0
    taken = ca.logic_and(running, good)
    lost = ca.logic_and(running, following < SHORTEST)
    return ca.vertcat(
        ca.if_else(taken, after, y),
        ca.if_else(taken, reached, most),
        ca.if_else(lost, -1.0, ca.if_else(taken, left - step, left)),
        ca.if_else(running, following, h),
    )


def followed(tick: ca.Function) -> ca.Function:
    """Return (z, ...) -> z at the end of the check; y is NaN if it is not reached.

    Args:
        tick: (z, ...) -> z after one tick.
    """
    run = tick
    for _ in range(_LEVELS):
        run = _repeated(run)
    z, *known = _symbols(run)
    z_end = run(z, *known)
    values, steps = ca.vertsplit(z_end, [0, z.numel() - 2, z.numel()])
    reached = ca.if_else(steps[0] == 0, values, np.nan)
    return ca.Function("followed", [z, *known], [ca.vertcat(reached, steps)])


def follower(
    rate: Rate,
    known: list[ca.SX],
    sizes: ca.SX,
    *,
    duration: float,
    tolerance: float,
) -> ca.Function:
    """Return (z, known) -> z at the end of a time span; see `followed`.

    Args:
        rate: r(t, y).
        known: Symbols that the rate and the sizes depend on.
        sizes: Natural sizes of y, shape (ny, 1).
        duration: The time span [s].
        tolerance: Allowed relative error of a step.
    """
    z = ca.SX.sym("z", 2 * sizes.numel() + 2)
    after = ticked(rate, z, sizes, duration=duration, tolerance=tolerance)
    return followed(ca.Function("tick", [z, *known], [ca.cse(after)]))


def _repeated(run: ca.Function) -> ca.Function:
    """Return a function that applies `run` several times to z, until it is done."""
    z, *known = _symbols(run)
    held = [ca.SX.sym(f"a{i}", *run.size_in(i)) for i in range(run.n_in())]
    either = ca.Function.if_else("either", run, ca.Function("held", held, held[:1]))
    after = z
    for _ in range(_AT_ONCE):
        after = either(after[-2] > 0, after, *known)
    return ca.Function("repeated", [z, *known], [after])


def _symbols(function: ca.Function) -> list[ca.MX]:
    return [ca.MX.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]
