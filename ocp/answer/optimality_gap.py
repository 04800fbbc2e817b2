"""Optimality gap: the distance of an answer from a bound of the optimum, in words.

    gap = (cost - bound) / |cost|,  for a maximised cost (bound - cost) / |cost|

The optimum is at most `gap` below the answer's cost (above it for a maximised cost),
relative to that cost. Numbers are rounded to the safe side: a bound away from the
answer, a gap upwards. An estimate from samples is never called a bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

from swarmstart.arguments import (
    a_number,
    checked,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.lower_bound.stated.answer import SENSE, BoundKind, LowerBound

_DIGITS, _GAP_DIGITS = 6, 2
_SHORT = Decimal("1e-4"), Decimal("1e7")
"""Numbers between these are written without an exponent."""
_OF_ROUNDING = 1e-200
"""Outward rounding moves a 0 by less than this."""
_WHOLE = 1.0
"""Gap above which the difference is written instead of a percentage."""


@checked(
    refused,
    kind=of_kind(BoundKind, "a BoundKind"),
    value=optional(a_number()),
    reason=text(longest=10_000),
    sense=SENSE,
    cost=optional(a_number()),
    tolerance=a_number(least=0),
)
@dataclass(frozen=True, kw_only=True, slots=True)
class OptimalityGap:
    """Bound of the optimum, or why there is none, compared with the cost of an answer.

    Attributes:
        kind: Kind of the bound, which says whether it is proven.
        value: The bound, as the problem states its cost; None without a bound.
        reason: How the bound was found, or why there is none.
        sense: 1 for a minimised cost, -1 for a maximised one.
        cost: Cost of the answer, accurately integrated, as the problem states it; None
            if no answer is confirmed.
        tolerance: Largest error of the answer's cost [cost].
    """

    kind: BoundKind
    value: float | None
    reason: str
    sense: float = 1.0
    cost: float | None = None
    tolerance: float = 0.0

    @classmethod
    @checked(
        refused,
        bound=of_kind(LowerBound, "a LowerBound"),
        cost=optional(reals(axes=0)),
        tolerance=a_number(least=0),
    )
    def of(
        cls, bound: LowerBound, cost: float | None, *, tolerance: float = 0.0
    ) -> OptimalityGap:
        """Return the gap between a bound and an answer's cost.

        Args:
            bound: Bound of the optimal cost, as of `lower_bound`.
            cost: The answer's cost; None if no answer is confirmed.
            tolerance: Largest error of the answer's cost [cost].
        """
        return cls(
            kind=bound.kind,
            value=_finite(bound.value),
            reason=bound.reason,
            sense=bound.sense,
            cost=_finite(cost),
            tolerance=tolerance,
        )

    @property
    def apart(self) -> float | None:
        """Largest possible improvement of the answer, as a difference of costs.

        It is negative if the answer's cost is better than the bound: by the error of
        this cost (`tolerance`), or because one of the two is wrong. It is None without
        a bound or a confirmed answer.
        """
        if not self.kind.is_bound or self.value is None or self.cost is None:
            return None
        return self.sense * (self.cost - self.value)

    @property
    def gap(self) -> float | None:
        """`apart` divided by |cost|; None if this is not defined."""
        apart = self.apart
        if apart is None or not (self.cost or apart == 0.0):
            return None
        return apart / abs(self.cost) if self.cost else 0.0

    @property
    def words(self) -> str:
        """Value, kind and gap in one line."""
        return self.told("the answer")

    @checked(refused, answer=text())
    def told(self, answer: str) -> str:
        """Return value, kind and gap in one line.

        Args:
            answer: Noun for the quantity compared with the bound.
        """
        if self.value is None or self.kind is BoundKind.NONE:
            return f"{BoundKind.NONE.value}: {self.reason}"
        if self.kind is BoundKind.SAMPLED:
            return f"sampled estimate {self.value:.{_DIGITS}g} (no bound)"
        shown = f"{_rounded(self.value, _DIGITS, up=self.sense < 0)} {self.kind.value}"
        if self.kind is BoundKind.TRIVIAL:
            shown += " (the least stage cost)"
        return f"{shown}; {self._compared(answer)}"

    def _compared(self, answer: str) -> str:
        apart, side = self.apart, "below" if self.sense > 0 else "above"
        if apart is None:
            return "there is no confirmed answer to compare with it"
        if apart == 0.0:
            return f"{answer} is at the bound"
        if apart > 0.0:
            return f"the optimum is at most {self._far(apart)} {side} {answer}"
        said = f"{answer} is {side} the bound by {_rounded(-apart, 2, up=True)}"
        if -apart <= self.tolerance:
            return f"{said}: within its tolerance"
        return f"{said}, more than its tolerance: one of the two is wrong"

    def _far(self, apart: float) -> str:
        """Return a difference in percent of the cost, as it is if beyond the cost."""
        gap = self.gap
        if gap is None or gap > _WHOLE:
            return _rounded(apart, _GAP_DIGITS, up=True)
        return f"{_rounded(100 * gap, _GAP_DIGITS, up=True)} %"


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _rounded(value: float, digits: int, *, up: bool) -> str:
    """Return a number with few digits: never below it if `up`, else never above it.

    Example:
        >>> _rounded(2.8661287, 6, up=False), _rounded(0.0411, 2, up=True)
        ('2.86612', '0.042')
    """
    rounding = ROUND_CEILING if up else ROUND_FLOOR
    if abs(value) < _OF_ROUNDING:
        return "0"
    # By its shortest digits: the binary value of 0.1 is above it and would round to
    # 0.11.
    exact = Decimal(repr(float(value)))
    shown = exact.normalize(Context(prec=digits, rounding=rounding))
    is_short = _SHORT[0] <= abs(shown) < _SHORT[1] or not shown
    return f"{shown:f}" if is_short else f"{float(shown):.{digits}g}"
