"""Cases whose cost is an energy and any function of the final output."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case, Formulas, known
from swarmstart.tests.adversary.drawing import symmetric_limits
from swarmstart.tests.adversary.exact.held_linear import Linear
from swarmstart.tests.adversary.exact.reach import Reach
from swarmstart.tests.adversary.judge import nothing
from swarmstart.tests.adversary.linear_case import formulas_of, substeps_of, truth_of

WIDER = 3.0
"""Ratio of the bounds and the range that the optimum uses."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EndCost:
    """A cost of the final output y, in CasADi and in NumPy.

    Attributes:
        symbolic: y, shape (m, 1) -> scalar.
        numeric: y, shape (m, k) -> shape (k,).
        breaks: If it has kinks or jumps; one output only.
        kinks: y, shape (m,) -> zero on them.
    """

    symbolic: Callable[[ca.SX], ca.SX]
    numeric: Callable[[Array], Array]
    breaks: tuple[float, ...] = ()
    kinks: Callable[[Array], Array] = field(default=lambda y: nothing(y, y))


def reach_case(  # noqa: PLR0913 - a system, a cost, and how it counts
    kind: str,
    name: str,
    linear: Linear,
    end: EndCost,
    *,
    C: Array,
    weight: float,
    relative: float = 2e-3,
) -> Case:
    """Return the case of a cost weight * integral of u'u + end(C x(T)).

    Args:
        kind: The class it counts in.
        name: Its name in this class.
        linear: The system; its bounds are replaced by inactive ones.
        end: The cost of the output.
        C: Of the output, shape (m, nx).
        weight: Of the energy.
        relative: How far above the optimum an answer is right.
    """
    reach = Reach(
        linear=linear, C=C, weight=weight, end_cost=end.numeric, breaks=end.breaks
    )
    best = reach.best()
    limit = np.maximum(WIDER * np.abs(best.controls).max(axis=1), 0.5)
    nu = limit.size
    posed = replace(
        linear, R=weight * np.eye(nu), controls=symmetric_limits(limit), p=np.empty(0)
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        flat = formulas_of(posed, x, u)
        return flat._replace(terminal_cost=end.symbolic(ca.DM(C) @ x))

    def kinks(x: Array, u: Array) -> Array:
        del u
        return end.kinks(C @ x)

    truth = replace(
        truth_of(posed),
        terminal_cost=lambda x: float(end.numeric((C @ x)[:, None])[0]),
        end_kinks=kinks,
    )
    case = Case(
        name=f"{kind}/{name}",
        kind=kind,
        formulas=formulas,
        truth=truth,
        substeps=substeps_of(posed, 1),
        best=best.controls,
    )
    return known(case, best.cost, relative=relative)
