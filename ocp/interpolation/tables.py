"""Tables of measured values as expressions: linear or cubic spline, one or two inputs.

    thrust = table(mach, newton, "bspline");   ode = thrust(v / 340) / mass - drag

A table is an expression like any other: it runs in machine code and has derivatives; a
linear one has a kink at each breakpoint. The methods are those of `casadi.interpolant`:

- "linear": straight lines between neighbours; bilinear with two inputs;
- "bspline": the cubic spline through all values, twice continuously differentiable,
  with the not-a-knot condition at the ends; its tensor product with two inputs.

Source: de Boor (2001), A Practical Guide to Splines, chapter IV, for not-a-knot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, cast, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import checked, reals, several, text
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.interpolation.splines import Spline

Method = Literal["linear", "bspline"]
Beyond = Literal["extrapolate", "hold"]
Argument: TypeAlias = Any
"""ca.SX, ca.MX, ca.DM or float: CasADi's own types omit some of these."""

FEWEST = {"linear": 2, "bspline": 4}
"""Smallest number of breakpoints of each input."""
_MOST_INPUTS = 2
_NUMBERS = reals()


@checked(
    refused,
    breakpoints=several(reals(), "a sequence of vectors"),
    method=text(),
    outside=text(),
    name=text(),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Table:
    """Table of values over one or two inputs, called with expressions; see `table`.

    Attributes:
        breakpoints: Breakpoints of each input, increasing; shape (n,).
        values: Values of the table, shape (n,), or (n, m) with two inputs, the first
            along the rows.
        method: "linear" or "bspline".
        outside: Value beyond the breakpoints: "extrapolate" or "hold".
        name: Name in messages.

    Raises:
        InvalidProblemError: If a shape does not fit, breakpoints do not increase, there
            are too few of them, a number is not finite, or a choice is unknown.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> density = ss.Table(
        ...     breakpoints=([0, 5e3, 10e3],), values=[1.225, 0.736, 0.414], name="rho"
        ... )
        >>> height = ca.SX.sym("height")
        >>> drag = 0.5 * density(height)
        >>> round(float(density.at(2500.0)), 4)
        0.9805
    """

    breakpoints: tuple[Array, ...]
    values: Array
    method: Method = "linear"
    outside: Beyond = "extrapolate"
    name: str = "table"
    _spline: Spline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Validate, copy and lock the numbers; compute the spline."""
        for role, choices in (("method", Method), ("outside", Beyond)):
            if getattr(self, role) not in (allowed := get_args(choices)):
                raise InvalidProblemError(
                    f"{self.name}: {role} must be one of {', '.join(allowed)}, "
                    f"got {getattr(self, role)!r}"
                )
        if not 1 <= len(self.breakpoints) <= _MOST_INPUTS:
            raise InvalidProblemError(
                f"{self.name}: expected breakpoints of one or two inputs, got "
                f"{len(self.breakpoints)}"
            )
        breakpoints = tuple(self._numbers("breakpoints", b) for b in self.breakpoints)
        for known in breakpoints:
            self._require_increasing(known)
        values = self._numbers("values", self.values)
        wanted = tuple(b.size for b in breakpoints)
        if values.shape != wanted:
            raise InvalidProblemError(
                f"{self.name}: values must have shape {wanted}, one for each "
                f"breakpoint, got {values.shape}"
            )
        object.__setattr__(self, "breakpoints", breakpoints)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "_spline", self._fitted())
        self._require_finite()

    def __call__(self, *arguments: Argument) -> ca.SX:
        """Return the table as an expression, entry by entry of its arguments.

        Args:
            arguments: A CasADi symbol, expression or number for each input, all of one
                shape or scalar.

        Returns:
            An SX expression; MX if an argument is one.

        Raises:
            InvalidProblemError: If the number or the type of the arguments is wrong.
        """
        self._require_inputs(len(arguments))
        if any(isinstance(a, ca.MX) for a in arguments):
            given = [ca.MX(a) for a in arguments]
            symbols = [ca.SX.sym("x", *a.shape) for a in given]
            called = ca.Function("table", symbols, [self(*symbols)])
            matrix: Any = called(*given)
            return cast("ca.SX", matrix)  # MX; see Argument.
        try:
            expressions = [ca.SX(a) for a in arguments]
        except (NotImplementedError, TypeError, RuntimeError) as error:
            found = ", ".join(shortened(a) for a in arguments)
            raise InvalidProblemError(
                f"{self.name} takes CasADi expressions or numbers, got {found}"
            ) from error
        if len({e.shape for e in expressions if not e.is_scalar()}) > 1:
            raise InvalidProblemError(
                f"{self.name} takes arguments of one shape, or scalar, got "
                f"{' and '.join(str(e.shape) for e in expressions)}"
            )
        return self._spline.expression(*expressions)

    def at(self, *arguments: ArrayLike) -> Array:
        """Return the table's values at given inputs.

        Args:
            arguments: Numbers for each input, of shapes that NumPy can broadcast.

        Returns:
            The values, in the broadcast shape.

        Raises:
            InvalidProblemError: If the number of arguments is wrong.
        """
        self._require_inputs(len(arguments))
        for argument in arguments:
            if not _NUMBERS.accepts(argument):
                raise refused("arguments", argument, _NUMBERS.allowed)
        try:
            given = np.broadcast_arrays(*[np.asarray(a, float) for a in arguments])
        except ValueError as error:
            raise InvalidProblemError(f"{self.name}: {error}") from error
        if not given[0].size:
            return np.empty(given[0].shape)
        symbols = [ca.SX.sym("x") for _ in given]
        one = ca.Function("table", symbols, [self(*symbols)])
        rows = [np.reshape(g, (1, -1)) for g in given]
        found = np.array(one.map(given[0].size)(*rows))
        return np.reshape(found, given[0].shape)

    def _require_inputs(self, given: int) -> None:
        if given != len(self.breakpoints):
            raise InvalidProblemError(
                f"{self.name} takes {len(self.breakpoints)} argument(s), got {given}"
            )

    def _numbers(self, role: str, given: ArrayLike) -> Array:
        """Return a locked copy of finite numbers."""
        if not _NUMBERS.accepts(given):
            raise InvalidProblemError(
                f"{self.name}: {role} must be numbers, got {shortened(given)}"
            )
        numbers = np.array(given, dtype=np.float64)
        if not np.isfinite(numbers).all():
            raise InvalidProblemError(
                f"{self.name}: {role} must be finite, got {shortened(given)}"
            )
        numbers.flags.writeable = False
        return numbers

    def _require_increasing(self, known: Array) -> None:
        if known.ndim != 1:
            raise InvalidProblemError(
                f"{self.name}: breakpoints must be a list of numbers, got shape "
                f"{known.shape}"
            )
        if known.size < FEWEST[self.method]:
            raise InvalidProblemError(
                f"{self.name}: {self.method} needs at least {FEWEST[self.method]} "
                f"breakpoints, got {known.size}"
            )
        later = np.flatnonzero(np.diff(known) <= 0)
        if later.size:
            at = later[0]
            raise InvalidProblemError(
                f"{self.name}: breakpoints must increase, got {known[at + 1]:g} after "
                f"{known[at]:g}"
            )

    def _fitted(self) -> Spline:
        """Return the spline through the values."""
        knots, coefficients, degree = [], self.values, 1
        for axis, known in enumerate(self.breakpoints):
            if self.method == "linear":
                knots.append(np.concatenate([known[:1], known, known[-1:]]))
                continue
            found, coefficients = _not_a_knot(known, coefficients, axis)
            knots.append(found)
            degree = 3
        return Spline(
            knots=tuple(knots),
            degrees=(degree,) * len(knots),
            coefficients=coefficients,
            outside=self.outside,
        )

    def _require_finite(self) -> None:
        """Raise if slopes overflow, for breakpoints too close or values too large."""
        with np.errstate(all="ignore"):
            middles = [np.convolve(b, [0.5, 0.5], "valid") for b in self.breakpoints]
            found = self.at(*np.meshgrid(*middles, indexing="ij"))
        if not np.isfinite(found).all():
            raise InvalidProblemError(
                f"{self.name}: the interpolation is not finite: breakpoints are too "
                "near each other, or values too large"
            )


@checked(refused, method=text(), outside=text(), name=text())
def table(
    x: ArrayLike | Sequence[ArrayLike],
    y: ArrayLike,
    method: Method = "linear",
    *,
    outside: Beyond = "extrapolate",
    name: str = "table",
) -> Table:
    """Return a table that can be used in expressions of a problem.

    With "extrapolate" the end pieces are extended beyond the breakpoints: the last
    straight line, or the last cubic, which grows fast. With "hold" the value at the end
    is held, and the end is a kink. `casadi.interpolant` extrapolates if it is linear;
    its B-spline is zero outside.

    Args:
        x: Breakpoints, increasing, shape (n,); for two inputs a pair of such arrays. At
            least 2 for "linear", 4 for "bspline".
        y: Values, shape (n,); for two inputs (n, m), the first input along the rows.
        method: "linear" (continuous) or "bspline" (cubic, not-a-knot, twice
            continuously differentiable).
        outside: "extrapolate" or "hold".
        name: Name in messages.

    Returns:
        A `Table`, to be called with expressions.

    Raises:
        InvalidProblemError: If the numbers do not form a table; see `Table`.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> thrust = ss.table([0, 1, 2], [50e3, 40e3, 60e3], name="thrust")
        >>> thrust(ca.SX(0.5))
        SX(45000)
        >>> float(thrust.at(1.5))
        50000.0
    """
    breakpoints: Any = (x,)
    if isinstance(x, list | tuple) and any(np.ndim(one) for one in x):
        breakpoints = tuple(x)
    values: Any = y  # Converted and validated there.
    return Table(
        breakpoints=breakpoints,
        values=values,
        method=method,
        outside=outside,
        name=name,
    )


def _not_a_knot(known: Array, values: Array, axis: int) -> tuple[Array, Array]:
    """Return knots and coefficients of the cubic splines along an axis."""
    from scipy.interpolate import make_interp_spline

    with np.errstate(all="ignore"):
        found = make_interp_spline(known, values, k=3, axis=axis)
    return found.t, np.moveaxis(found.c, 0, axis)
