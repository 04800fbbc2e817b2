"""The answer of `lower_bound`: a number, its kind and its evidence.

The evidence consists of the facts that a proven bound rests on: polynomials, sets,
slacks of the proofs. All coordinates are those of a `Statement`: y = (t, x), each state
divided by its size. f, L and phi are the right-hand side, stage cost and terminal cost
of this statement, x0 its initial state, u the controls, and T the time of the end.

A step is a polynomial V(t, x) for which it was proven, on the set S that the steps
before it leave, that

    V_t + L + V_x f >= -slack        for all (t, x) in S and all admissible u
    V(T, x) <= phi(T, x) + end_slack for all admissible ends (T, x) in S

the second only if end_slack is not None. Then no admissible trajectory within S costs
less than V(0, x0) - slack T - end_slack, and to reach (t, x) costs at least
V(0, x0) - V(t, x) - slack t.

At first S has the points of the tube that keep the bounds of the states and the path
constraints. A pruning shrinks S. It consists of a step C without end_slack and a step G
with one. By these, a trajectory through (t, x) costs at least

    C(0, x0) - C(t, x) + G(t, x) - (slack of C) t - (slack of G)(T - t) - end_slack of G

If this number exceeds a number `known`, usually the cost of an answer, no trajectory
through (t, x) costs less than `known`. So with V and the slacks of the last step the
bound is min(known, V(0, x0) - slack T - end_slack). It is valid for any `known`, even
if no answer has this cost.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import (
    MOST_WORK,
    Check,
    a_count,
    a_number,
    checked,
    having,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import refused

if TYPE_CHECKING:
    from swarmstart.ocp.lower_bound.stated.statement import Statement


class BoundKind(Enum):
    """Kind of a lower bound.

    PROVEN: no admissible answer is better, rounding included.
    TRIVIAL: proven too, but from the least stage cost alone.
    SAMPLED: an estimate from samples; not a bound.
    NONE: there is no bound; the reason is given.
    """

    PROVEN = "proven"
    TRIVIAL = "trivial"
    SAMPLED = "sampled"
    NONE = "none"

    @property
    def is_bound(self) -> bool:
        """True if the value is a bound: PROVEN or TRIVIAL."""
        return self in (BoundKind.PROVEN, BoundKind.TRIVIAL)


SENSE = Check(
    lambda value: (
        value is not True and isinstance(value, float | int) and abs(value) == 1
    ),
    "1 or -1",
)


@checked(
    refused,
    kind=of_kind(BoundKind, "a BoundKind"),
    value=reals(axes=0),
    reason=text(longest=10_000),
    degree=a_count(),
    slack=a_number(finite=False),
    boxes=a_count(most=MOST_WORK),
    cpu_seconds=a_number(least=0),
    set_name=text(),
    evidence=optional(having("statement", "tube", words="an Evidence")),
    sense=SENSE,
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LowerBound:
    """A limit that no answer's cost can pass, or the reason why none was found.

    Attributes:
        kind: Kind of the bound.
        value: The bound, as the problem states its cost: no answer costs less; if the
            cost is maximised, no answer reaches more. NaN if there is no bound.
        reason: How the bound was found, or why there is none: sentences.
        degree: Degree of the polynomial; 0 if none was used.
        slack: Gap that the proofs left, already subtracted from the bound [cost].
        boxes: Number of boxes of all proofs.
        cpu_seconds: CPU time of the process [s].
        set_name: Name of the set that holds the trajectories.
        evidence: Facts that the proof rests on; None if nothing is proven by
            polynomials.
        sense: 1 if the cost is minimised, -1 if it is maximised.
    """

    kind: BoundKind
    value: float
    reason: str
    degree: int = 0
    slack: float = 0.0
    boxes: int = 0
    cpu_seconds: float = 0.0
    set_name: str = ""
    evidence: Evidence | None = field(default=None, repr=False)  # Hundreds of lines.
    sense: float = 1.0

    @checked(refused, cost=a_number(finite=False))
    def gap(self, cost: float) -> float:
        """Return the largest possible relative distance of an answer from the optimum.

        Args:
            cost: Cost of the answer, as the problem states it.

        Returns:
            (cost - bound) / |cost|, or (bound - cost) / |cost| if the cost is
            maximised; NaN if there is no bound; 0 if cost and bound are the same.
        """
        if not self.kind.is_bound:
            return float("nan")
        # A gap is relative to the cost, so there is no finite one if that is 0.
        apart = self.sense * (cost - self.value)
        return (
            apart / abs(cost)
            if apart and cost
            else (0.0 if not apart else float("inf"))
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Polynomial:
    """A polynomial of (t, x) as products of Chebyshev polynomials.

        V(y) = sum of coefficients[j] * product over a of T_exponents[j, a](z_a),
        z_a = (y_a - middle_a) / half_a

    with y = (t, x), and T_e the Chebyshev polynomial of degree e.

    Attributes:
        middle: Middle of the box that V is scaled to, shape (1 + n,).
        half: Half the widths of that box, shape (1 + n,), > 0.
        exponents: Degrees of the factors of each product, shape (number, 1 + n), whole
            numbers >= 0.
        coefficients: Coefficient of each product, shape (number,).
    """

    middle: Array
    half: Array
    exponents: NDArray[np.int64]
    coefficients: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Step:
    """A polynomial V(t, x) with the slacks of its proven inequalities.

    These are V_t + L + V_x f >= -slack over the set, for all controls, and
    V(T, x) <= phi(T, x) + end_slack at admissible ends, with the stage cost L, the
    right-hand side f and the terminal cost phi.

    Attributes:
        polynomial: The polynomial V.
        slack: Slack of the first inequality [cost / s], >= 0.
        end_slack: Slack of the second inequality [cost], >= 0; None if it is not
            stated.
        boxes: Number of boxes of the proofs.
    """

    polynomial: Polynomial
    slack: float
    end_slack: float | None
    boxes: int = 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pruning:
    """Two steps that exclude points from the set.

    A point is excluded if, by both steps together, every trajectory through it costs
    more than a known cost.

    Attributes:
        come: Step, without end_slack, that bounds the cost from the start to a point.
        go: Step, with end_slack, that bounds the cost from a point to the end.
    """

    come: Step
    go: Step


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Tube:
    """A moving polytope that holds every admissible trajectory.

        { x : directions x <= levels(t) },  levels linear between the times

    The proof: x0 is in the polytope at time 0, and at each time the level of each face
    rises at least as fast as any admissible trajectory on it can move outwards. The
    levels of faces outside the bounds of the states need not rise, since admissible
    trajectories keep these bounds.

    Attributes:
        directions: Outward directions of the faces, shape (K, n); the first 2n are the
            axes, e_1, -e_1, e_2, ...
        times: Times of the levels, shape (M + 1,) [s], from 0 to the latest end.
        levels: Level of each face at each time, shape (M + 1, K).
    """

    directions: Array
    times: Array
    levels: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Evidence:
    """A proven bound with its evidence.

    Attributes:
        statement: The problem.
        tube: The set that holds the trajectories.
        prunings: Prunings in order; each is proven on the set that earlier ones leave.
        final: The step that gives the bound.
        known: The cost that the prunings compare with; infinite without prunings.
        bound: Proven lower bound of the statement's cost, its offset included.
    """

    statement: Statement
    tube: Tube
    prunings: tuple[Pruning, ...]
    final: Step
    known: float
    bound: float
