"""Steps of RODAS4 whose lengths follow from their errors, from one check to the next.

A tick tries one step of length h and looks at its error, that of the solution of order
3 it comes with (rosenbrock.py), in parts of what is allowed:

    e^2 = sum_i (k_6i / (tolerance s_i))^2,   s_i = max(|x_i| so far, |x+_i|, f_i)

The step is taken if e <= 1, and else tried again; in both cases the next one is

    h min(6, max(1/5, 0.9 e^(-1/4)))

as in the code RODAS, whose norm is the mean. The sum is the same for a model to which
states were added that rest. "So far" begins as the interval does; f_i keeps what should
be zero, and is only rounded, from being looked at in parts of itself: where tolerance *
f_i is 1e-15 of the state's natural size (scaling.py). So nothing here has a unit.

All numbers of a tick are in one column z = (y, |y| so far, left, h): y the states and,
if costs are integrated, their integrals; left and h in parts of the time from check to
check. It is done when left is 0. After that a tick changes nothing, so that many
individuals go side by side until the last is done: in machine code by a loop
(compiled/ticks.py), in CasADi by nested calls of which most are left out. Left is -1
when h came to nothing, as where a model explodes; that, and too many ticks, make y NaN.

A step that is much longer than the fast modes damps them without having followed them,
and with hardly an error. So the first step of an interval, at whose begin controls
jump, is a small part of the others.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.7 and
IV.8, for the control of the step size.
"""

from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.ocp.rosenbrock import Rate, rodas4_with_error

Symbolic = TypeVar("Symbolic", ca.SX, ca.MX, ca.DM)
FINEST, COARSEST = 1e-12, 0.1
"""Tolerances between which steps can be controlled."""
MOST_GROWTH, LEAST_GROWTH, SAFETY = 6.0, 0.2, 0.9
"""Of the step's length from one to the next; as in rodas.f."""
SHORTEST = 1e-15
"""A step in parts of the time from check to check, below which there is no solution."""
LAST = 1.01
"""Steps up to which the last one is stretched to the end."""
FIRST = 1 / 341
"""The first step of an interval, in parts of the expected ones."""
ROUNDED = 1e-15
"""Part of a natural size that is rounding."""
_FINER = 10.0
_AT_ONCE, _LEVELS = 8, 4
MOST_TICKS = _AT_ONCE**_LEVELS
"""Steps that are tried from check to check."""


def finer(tolerance: float) -> float:
    """Return the tolerance of steps that others are compared with."""
    return max(tolerance / _FINER, FINEST)


def column_at_begin(x: Symbolic, *, integrals: int, steps: int) -> Symbolic:
    """Return z as an interval begins.

    Args:
        x: States, shape (nx, 1).
        integrals: Number of integrals, 0 there.
        steps: Steps that are expected from check to check.
    """
    y = ca.vertcat(x, ca.DM.zeros(integrals, 1))
    return ca.vertcat(y, ca.fabs(y), 1.0, FIRST / steps)


def column_at_check(z: Symbolic) -> Symbolic:
    """Return z as the next check begins, of what it was as the last one ended."""
    return ca.vertcat(z[: z.numel() - 2], 1.0, z[-1])


def values_of(z: Symbolic) -> Symbolic:
    """Return y of z."""
    return z[: (z.numel() - 2) // 2]


def ticked(
    rate: Rate, z: ca.SX, sizes: ca.SX, *, duration: float, tolerance: float
) -> ca.SX:
    """Return z after one tick.

    Args:
        rate: r(t, y), t from the check's begin on [s].
        z: See the module's head, shape (2 ny + 2, 1).
        sizes: Natural sizes of y, shape (ny, 1).
        duration: Time from check to check [s].
        tolerance: Allowed error of a step, in parts of the values.
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
    good = e2 <= 1  # NaN is not.
    wanted = SAFETY / ca.sqrt(ca.sqrt(ca.sqrt(e2)))
    following = step * ca.fmin(MOST_GROWTH, ca.fmax(LEAST_GROWTH, wanted))
    cut = ca.logic_and(good, step < h)  # At the end: it says little of the next one.
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
    """Return (z, ...) -> z at the check's end; y is NaN if that is not reached.

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
    """Return (z, known) -> z at the end of a time; see `followed`.

    Args:
        rate: r(t, y).
        known: Symbols that the rate and the sizes depend on.
        sizes: Natural sizes of y, shape (ny, 1).
        duration: The time [s].
        tolerance: Allowed error of a step, in parts of the values.
    """
    z = ca.SX.sym("z", 2 * sizes.numel() + 2)
    after = ticked(rate, z, sizes, duration=duration, tolerance=tolerance)
    return followed(ca.Function("tick", [z, *known], [ca.cse(after)]))


def _repeated(run: ca.Function) -> ca.Function:
    """Return a function of z applied several times, as long as it is not done."""
    z, *known = _symbols(run)
    held = [ca.SX.sym(f"a{i}", *run.size_in(i)) for i in range(run.n_in())]
    either = ca.Function.if_else("either", run, ca.Function("held", held, held[:1]))
    after = z
    for _ in range(_AT_ONCE):
        after = either(after[-2] > 0, after, *known)
    return ca.Function("repeated", [z, *known], [after])


def _symbols(function: ca.Function) -> list[ca.MX]:
    return [ca.MX.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]
