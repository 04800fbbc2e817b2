"""RODAS4, a Rosenbrock method for stiff equations x' = r(t, x), and its size control.

With W = I - h g J, J = dr/dx and r_t = dr/dt at the step's beginning, g = 1/4, each of
six stages solves one linear system with the same matrix:

    W k_i = h g r(t + c_i h, x + sum_j a_ij k_j) + g sum_j C_ij k_j + h^2 g d_i r_t

The fifth stage ends at a solution of order 3, x_5 = x + sum_j a_5j k_j + k_5, the step
at one of order 4, x+ = x_5 + k_6, so k_6 estimates the error of x_5. The method is
L-stable: fast modes are damped by steps of any length, and only the slow ones limit the
step. Nothing is iterated: a step is an explicit expression (SX) with derivatives.

W is factored symbolically: an LU factorisation by the pattern of its nonzeros, with
pivots on the diagonal in the order of least fill, without exchanging rows for their
values. A pivot that vanishes, h g J_ii = 1, belongs to a mode that grows e^4-fold in a
step, so the step is too long in any case, and the result is not finite.

Between two checks, step sizes are controlled by the estimated error. A tick tries one
step of length h and estimates its error, divided by its limit:

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
machine code (compiled/emitter.py), by nested calls in CasADi, most of which are
skipped. If h becomes too small, as for a solution that explodes, left is set to -1;
this, or too many ticks, sets y to NaN.

A step much longer than the fast modes damps them without resolving them, and its error
estimate hardly shows that. The controls jump at the start of an interval, so the first
step there is a small fraction of the expected step.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.7,
with IV.10 for the method RODAS, and IV.8 for the step size control; coefficients as in
their code rodas.f, method 1.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np

GAMMA = 0.25
A = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950),
)
"""a_ij of the first five stages; the sixth starts at the end of the fifth."""
C = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
    (
        8.083246795921522,
        -7.981132988064893,
        -31.52159432874371,
        16.31930543123136,
        -6.058818238834054,
    ),
)
TIMES = (0.0, 0.386, 0.21, 0.63, 1.0, 1.0)
"""c_i."""
IN_TIME = (0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0)
"""d_i."""

Rate = Callable[[float, ca.SX], ca.SX]
"""r(t, x): rate at time t after the start of the step [s]."""

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


def rodas4(rate: Rate, x: ca.SX, t: float, h: float) -> ca.SX:
    """Return x after one step of RODAS4; arguments as in `rodas4_with_error`."""
    return rodas4_with_error(rate, x, t, h)[0]


def prepared(rate: Rate, size: int) -> Callable[[ca.SX, float, float], ca.SX]:
    """Return the function (x, t, h) -> x after a step, for many steps of one equation.

    The factorisation and the elimination of common parts are done once.

    Args:
        rate: Function r(t, x), the derivative of x.
        size: Number of states.
    """
    own = [ca.SX.sym("x", size), ca.SX.sym("t"), ca.SX.sym("h")]
    after = rodas4(rate, *own)  # type: ignore[arg-type]
    known = {s.element_hash() for one in own for s in ca.vertsplit(one)}
    # Symbols of the rate, such as controls, become arguments too.
    others = [s for s in ca.symvar(after) if s.element_hash() not in known]
    step = ca.Function("step", [*own, *others], ca.cse([after]))
    return lambda x, t, h: step(x, t, h, *others)


def rodas4_with_error(rate: Rate, x: ca.SX, t: float, h: float) -> tuple[ca.SX, ca.SX]:
    """Return x after one step of RODAS4, and the error of its solution of order 3.

    Args:
        rate: Function r(t, x), the derivative of x; expressions of t must be
            differentiable.
        x: State, shape (n, 1).
        t: Time at the start of the step [s].
        h: Length of the step [s].
    """
    J, in_time = _slopes(rate, x, t)
    W = ca.DM.eye(x.numel()) - GAMMA * h * J
    factors = factored(W)
    k: list[ca.SX] = []
    for stage, (couplings, c, d) in enumerate(zip(C, TIMES, IN_TIME, strict=True)):
        if stage < len(A):
            at = _sum(x, A[stage], k)
        else:
            at += k[-1]  # The end of the fifth stage.
        right = GAMMA * h * rate(t + c * h, at)
        right = _sum(right, [GAMMA * coupling for coupling in couplings], k)
        if d and in_time.nnz():
            right += GAMMA * d * h * h * in_time
        k.append(factors.solve(right))
    return at + k[-1], k[-1]


def _sum(x: ca.SX, weights: Sequence[float], terms: Sequence[ca.SX]) -> ca.SX:
    """Return x + sum of weights * terms."""
    for weight, term in zip(weights, terms, strict=False):
        x = x + weight * term
    return x


def _slopes(rate: Rate, x: ca.SX, t: float) -> tuple[ca.SX, ca.SX]:
    """Return dr/dx and dr/dt at (t, x)."""
    y, time = ca.SX.sym("y", x.numel()), ca.SX.sym("t")
    r = rate(time, y)  # type: ignore[arg-type]
    slopes = [ca.jacobian(r, y), ca.jacobian(r, time)]
    J, in_time = ca.substitute(slopes, [y, time], [x, ca.SX(t)])
    return J, in_time


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """LU factors of a matrix, in the order in which its rows were eliminated.

    Attributes:
        order: Rows, in the order of elimination.
        lower: For each of these rows as pivot row, the nonzeros of L in the pivot's
            column, as pairs (row, element).
        upper: For each of these rows, the nonzeros of U in it, without the pivot, as
            pairs (column, element).
        inverse: For each of these rows, 1 / pivot.
    """

    order: tuple[int, ...]
    lower: tuple[tuple[tuple[int, ca.SX], ...], ...]
    upper: tuple[tuple[tuple[int, ca.SX], ...], ...]
    inverse: tuple[ca.SX, ...]

    def solve(self, right: ca.SX) -> ca.SX:
        """Return the solution for a right-hand side, shape (n, 1)."""
        b = ca.vertsplit(ca.densify(right))
        for row, below in zip(self.order, self.lower, strict=True):
            for other, element in below:
                b[other] = b[other] - element * b[row]
        backward = zip(self.order, self.upper, self.inverse, strict=True)
        for row, right_of, inverse in reversed([*backward]):
            for other, element in right_of:
                b[row] = b[row] - element * b[other]
            b[row] = b[row] * inverse
        return ca.vertcat(ca.SX(0, 1), *b)


def factored(matrix: ca.SX) -> Factors:
    """Return the LU factors of a square matrix whose diagonal has no zero.

    Pivots are diagonal elements. The next pivot is the one with the smallest possible
    fill (Markowitz 1957), so a triangular matrix in any order needs no elimination.

    Args:
        matrix: The matrix, shape (n, n).
    """
    rows = _rows(matrix)
    order, lower, upper, inverse = [], [], [], []
    while rows:
        used = Counter(column for row in rows.values() for column in row)
        pivot = min(rows, key=lambda row: (len(rows[row]) - 1) * (used[row] - 1))
        row = rows.pop(pivot)
        order.append(pivot)
        inverse.append(1 / row.pop(pivot))
        column = []
        for number, other in rows.items():
            if pivot not in other:
                continue
            element = other.pop(pivot) * inverse[-1]
            column.append((number, element))
            for place, value in row.items():
                other[place] = other.get(place, ca.SX(0)) - element * value
        lower.append(tuple(column))
        upper.append(tuple(row.items()))
    return Factors(tuple(order), tuple(lower), tuple(upper), tuple(inverse))


Row = dict[int, ca.SX]


def _rows(matrix: ca.SX) -> dict[int, Row]:
    """Return the nonzeros of each row, by column."""
    rows: dict[int, Row] = {number: {} for number in range(matrix.shape[0])}
    places = zip(*matrix.sparsity().get_triplet(), strict=True)
    for number, (row, column) in enumerate(places):
        rows[row][column] = matrix.nz[number]
    return rows


def finer(tolerance: float) -> float:
    """Return the tolerance of the finer steps used for comparison."""
    return max(tolerance / _FINER, FINEST)


def column_at_begin(x: Symbolic, *, integrals: int, steps: int) -> Symbolic:
    """Return z at the start of an interval, for steps of adaptive length.

    z is (y, largest |y| so far, left, h), with y the states and the integrals. left and
    h are the time left and the step size, as fractions of the time between two checks.

    Args:
        x: States, shape (nx, 1).
        integrals: Number of integrals, which start at 0.
        steps: Expected number of steps between two checks.
    """
    y = ca.vertcat(x, ca.DM.zeros(integrals, 1))
    return ca.vertcat(y, ca.fabs(y), 1.0, FIRST / steps)


def column_at_check(z: Symbolic) -> Symbolic:
    """Return z at the start of the steps to the next check, from z at the last check.

    z is as in `column_at_begin`.
    """
    return ca.vertcat(z[: z.numel() - 2], 1.0, z[-1])


def values_of(z: Symbolic) -> Symbolic:
    """Return y, the states and integrals in z; see `column_at_begin`."""
    return z[: (z.numel() - 2) // 2]


def ticked(
    rate: Rate, z: ca.SX, sizes: ca.SX, *, duration: float, tolerance: float
) -> ca.SX:
    """Return z after one tick, which tries one step of adaptive length.

    Args:
        rate: Function r(t, y), the derivative of y, with t measured from the last check
            [s].
        z: Column, see `column_at_begin`, shape (2 ny + 2, 1).
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
    wanted = SAFETY / ca.sqrt(ca.sqrt(ca.sqrt(e2)))  # e^(1/4).
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
    """Return a function (z, ...) -> z at the next check, after as many ticks as needed.

    z is as in `column_at_begin`; its y is NaN if the next check is not reached.

    Args:
        tick: Function (z, ...) -> z after one tick, which tries one step.
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
    """Return the function (z, known) -> z at the end of a time span; see `followed`.

    Args:
        rate: Function r(t, y), the derivative of y.
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
    # CasADi evaluates one branch only, so that ticks after the end cost little.
    either = ca.Function.if_else("either", run, ca.Function("held", held, held[:1]))
    after = z
    for _ in range(_AT_ONCE):
        after = either(after[-2] > 0, after, *known)
    return ca.Function("repeated", [z, *known], [after])


def _symbols(function: ca.Function) -> list[ca.MX]:
    return [ca.MX.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]
