"""How far an answer is from the optimum at most: the answer beside a bound, in words.

    gap = (cost - bound) / |cost|,  of a maximised cost (bound - cost) / |cost|

so the optimum is at most `gap` below the answer, in parts of the answer's cost, or
above it where the cost is maximised. Numbers are printed rounded to the safe side: a
bound away from the answer, a gap upwards. An estimate from samples is never called a
bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

from swarmstart.ocp.lower_bound.answer import BoundKind, LowerBound

_DIGITS, _GAP_DIGITS = 6, 2
_SHORT = Decimal("1e-4"), Decimal("1e7")
"""Numbers between these are written without an exponent."""
_OF_ROUNDING = 1e-200
"""Outward rounding moves a 0 by less."""
_WHOLE = 1.0
"""Beyond this part of the cost a gap is told as a difference, not in percent."""


@dataclass(frozen=True, kw_only=True, slots=True)
class OptimalityGap:
    """A bound, or that there is none, beside an answer.

    Attributes:
        kind: What the bound is worth.
        value: The bound, as the problem states its cost; None: there is none.
        reason: How it was found, or why there is none.
        sense: 1 of a minimised cost, -1 of a maximised one.
        cost: Of the answer, accurately integrated, as the problem states it; None: no
            answer is confirmed.
        tolerance: By how much the answer's cost may be off [cost].
    """

    kind: BoundKind
    value: float | None
    reason: str
    sense: float = 1.0
    cost: float | None = None
    tolerance: float = 0.0

    @classmethod
    def of(
        cls, bound: LowerBound, cost: float | None, *, tolerance: float = 0.0
    ) -> OptimalityGap:
        """Return a bound beside an answer's cost; None: no answer is confirmed."""
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
        """How much better than the answer the optimum is at most, as a cost.

        Negative if the answer is better than the bound; None without a bound or a
        confirmed answer.
        """
        if not self.kind.is_bound or self.value is None or self.cost is None:
            return None
        return self.sense * (self.cost - self.value)

    @property
    def gap(self) -> float | None:
        """The same in parts of the answer's cost; None of a cost of 0, too."""
        apart = self.apart
        if apart is None or not (self.cost or apart == 0.0):
            return None
        return apart / abs(self.cost) if self.cost else 0.0

    @property
    def words(self) -> str:
        """Value, kind and gap in a line."""
        return self.told("the answer")

    def told(self, answer: str) -> str:
        """Return value, kind and gap in a line.

        Args:
            answer: What is compared with the bound: a noun.
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
        """Return a difference in percent of the cost; one beyond the cost as it is."""
        gap = self.gap
        if gap is None or gap > _WHOLE:
            return _rounded(apart, _GAP_DIGITS, up=True)
        return f"{_rounded(100 * gap, _GAP_DIGITS, up=True)} %"


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _rounded(value: float, digits: int, *, up: bool) -> str:
    """Return a number with few digits, never below it if `up`, else never above it.

    Example:
        >>> _rounded(2.8661287, 6, up=False), _rounded(0.0411, 2, up=True)
        ('2.86612', '0.042')
    """
    rounding = ROUND_CEILING if up else ROUND_FLOOR
    if abs(value) < _OF_ROUNDING:
        return "0"
    exact = Decimal(repr(float(value)))
    shown = exact.normalize(Context(prec=digits, rounding=rounding))
    is_short = _SHORT[0] <= abs(shown) < _SHORT[1] or not shown
    return f"{shown:f}" if is_short else f"{float(shown):.{digits}g}"
