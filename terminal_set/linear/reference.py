"""The reference a terminal set is built around, with the bounds that limit it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.linear.arrays import bound_array, finite_array
from swarmstart.terminal_set.linear.level import smaller_side


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Reference:
    """A reference state and input inside their bounds; arrays copied and read-only.

    Attributes:
        x_ref: Reference state, shape (nx,), SI units. If the reference moves (a
            leader), the entries that the dynamics depend on must stay constant.
        u_ref: Reference input, shape (nu,).
        u_lower: Lower bounds of the input, shape (nu,); -inf if missing.
        u_upper: Upper bounds of the input, shape (nu,); inf if missing.
        x_lower: Lower bounds of the state, shape (nx,); None if unbounded.
        x_upper: Upper bounds of the state, shape (nx,); None if unbounded.

    Raises:
        SaturatedReferenceError: If x_ref or u_ref is on or outside a bound.
        NotFiniteError: If a value is NaN, or one of x_ref or u_ref infinite.
        InvalidShapeError: If an array is no vector, or sizes differ.

    Example:
        >>> import swarmstart as ss
        >>> upright = ss.Reference(
        ...     x_ref=[0, 0], u_ref=[0], u_lower=[-8], u_upper=[5]
        ... )
        >>> upright.u_max.tolist(), upright.e_max.tolist()
        ([5.0], [inf, inf])
    """

    x_ref: Array
    u_ref: Array
    u_lower: Array
    u_upper: Array
    x_lower: Array | None = None
    x_upper: Array | None = None

    def __post_init__(self) -> None:
        """Check and copy; the reference must lie strictly inside its bounds."""
        for name in ("x_ref", "u_ref"):
            checked = finite_array(name, getattr(self, name), (None,))
            object.__setattr__(self, name, checked)
        for name in ("u_lower", "u_upper", "x_lower", "x_upper"):
            bound = getattr(self, name)
            if bound is not None:
                size = self.u_ref.size if name.startswith("u") else self.x_ref.size
                object.__setattr__(self, name, bound_array(name, bound, (size,)))
        _ = self.u_max, self.e_max  # Raises if there is no room.

    @property
    def u_max(self) -> Array:
        """Room of each input around u_ref, the nearer bound, shape (nu,), > 0."""
        return smaller_side("u_ref", self.u_ref, lower=self.u_lower, upper=self.u_upper)

    @property
    def e_max(self) -> Array:
        """Room of each state around x_ref, the nearer bound, shape (nx,), > 0."""
        nowhere = np.full(self.x_ref.shape, np.inf)
        lower = -nowhere if self.x_lower is None else self.x_lower
        upper = nowhere if self.x_upper is None else self.x_upper
        return smaller_side("x_ref", self.x_ref, lower=lower, upper=upper)
