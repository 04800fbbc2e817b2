"""Values along rays from the origin, in a form that has no 0/0 at the origin.

At the distance rho from the origin a value is a(rho) = a(0) + rho b(rho); stored are
a(0) and b.

Both a(0) and b are Taylor models over boxes that begin at rho = 0; a(0) does not depend
on rho. Sums and products keep that form, and so does a function g. Let h = rho b, a(0)
= c + delta for a number c, and g_k = g^(k)(c) / k!; `last` is a bound of the term after
the last one of the Taylor series of g (`Series.last`). Then

    (g(a) - g(a(0))) / h = g_1 + g_2 (2 delta + h) + g_3 (3 delta^2 + 3 delta h + h^2)
                           + remainder,

|remainder| <= 4 last (|delta| + |h|)^3 by the mean-value theorem, since the remainder
of the series of g about c has a slope of at most 4 last |x - c|^3 at x. So a quadratic
form of a motion, divided by rho^2, is enclosed at the origin as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swarmstart.terminal_set.checker.models import (
    ELEMENTARY,
    ORDER,
    TINY,
    Array,
    Model,
    Series,
)


@dataclass(frozen=True, slots=True, eq=False)
class Along:
    """A batch of functions a(rho) = a(0) + rho b(rho) along rays.

    Attributes:
        at: Models of a(0).
        slope: Models of b.
        rho: The variable rho >= 0.
    """

    at: Model
    slope: Model
    rho: Model

    @property
    def middle(self) -> Array:
        """Middles of the values at rho = 0, one for each box, shape (N,)."""
        return self.at.middle

    @property
    def value(self) -> Model:
        """The values, as models."""
        return self.at + self.rho * self.slope

    def __add__(self, other: Along) -> Along:
        """Part by part."""
        return Along(self.at + other.at, self.slope + other.slope, self.rho)

    def __sub__(self, other: Along) -> Along:
        """Part by part."""
        return Along(self.at - other.at, self.slope - other.slope, self.rho)

    def __neg__(self) -> Along:
        """Part by part."""
        return Along(-self.at, -self.slope, self.rho)

    def __mul__(self, other: Along) -> Along:
        """The product."""
        slope = self.at * other.slope + self.slope * other.value
        return Along(self.at * other.at, slope, self.rho)

    def number(self, value: Array | float, error: Array | float = 0.0) -> Along:
        """A number known to within an error, over the same boxes."""
        return Along(self.at.number(value, error), self.at.number(0.0), self.rho)

    def scaled(self, factor: Array | float, off: float = 0.0) -> Along:
        """The value times a float known to within `off`; arrays hold one per box."""
        at, slope = self.at.scaled(factor, off), self.slope.scaled(factor, off)
        return Along(at, slope, self.rho)

    def shifted(self, constant: Array | float, error: Array | float = 0.0) -> Along:
        """The value plus a float known to within an error."""
        return Along(self.at.shifted(constant, error), self.slope, self.rho)

    def absolute(self) -> Along:
        """The absolute value |a|.

        If the sign of a is not known, the slope of |a| as a function of a is enclosed
        in [-1, 1].
        """
        value = self.value
        sign = np.where(value.lower > 0.0, 1.0, np.where(value.upper < 0.0, -1.0, 0.0))
        unsure = np.where(sign == 0.0, self.slope.size + self.slope.error, 0.0)
        slope = self.slope.scaled(sign).widened(unsure)
        return Along(self.at.absolute(), slope, self.rho)

    def composed(self, of: Callable[[Array, Model], Series]) -> Along:
        """The values g(a(rho)) of a function g.

        Args:
            of: Function (numbers c, model) -> Taylor series of g about c, with a bound
                of its remainder over the model's range.
        """
        c, h = self.at.middle, self.rho * self.slope
        (_, one, two, three), last, sizes = of(c, self.at + h)
        delta = self.at.shifted(-c)
        # 2 delta + h and 3 delta^2 + 3 delta h + h^2, which are exact for delta = 0.
        first = delta.scaled(2.0) + h
        second = h * h + (delta * (delta + h)).scaled(3.0)
        slope = first.scaled(two) + second.scaled(three)
        slope = slope.shifted(one)
        reach = delta.size + delta.error + h.size + h.error
        error = 4.0 * last
        for k in range(ORDER, 0, -1):
            error = error * reach + k * ELEMENTARY * sizes[k]
        slope = slope.widened(error + TINY * reach * reach) * self.slope
        return Along(self.at.composed(of), slope, self.rho)
