"""Algebraic equations of a model, solved for their variables.

    x' = f(x, z, u, p),   0 = g(x, z, u, p),   dg/dz regular (index 1)

Equations that are linear in z are solved symbolically,

    z = -(dg/dz)^-1 g(x, 0, u, p),

others by a fixed number of Newton iterations from a start value,

    z_k+1 = z_k - (dg/dz)^-1 g at z_k,

written out as an expression for z, which can be differentiated and compiled like any
other. In both cases z becomes an expression in x, u and p, and the ode, costs and
constraints are written without z. There is no control at the end of the horizon, so
expressions there may contain z only if z does not depend on the controls. z is no
unknown of the NLP; the equations are solved again at each evaluation of the right-hand
side, also inside the integrator's steps.

Newton's method may fail. The scaled residual after the last iteration,

    r_i = g_i / sqrt(sum_j (dg_i/dz_j)^2 (z_j^2 + scale_j^2)),

is a number without unit and without a kink. It enters every problem with the model as a
path constraint |r_i| <= 1e-9, so that an answer with unsolved equations is not
confirmed. A singular matrix at one point gives NaN there, which counts as an infinite
violation.

Linear equations A z = b are solved in symbols, smoothly and without choice of pivots. A
is permuted to lower block triangular form by its structure. Each block is solved by
modified Gram-Schmidt without square roots, with the columns a_k of the block in order
and b as the last one:

    q_j = a_j - sum_i<j r_ij q_i,   r_jk = q_j' a_k / q_j' q_j,   R z = r_b,

where each r_jk is computed from the remainder of a_k. An expression cannot choose a
pivot by its size, and a zero pivot may occur in any order; here only a singular block
divides by zero. Treating b as a column makes the method as accurate as Householder's;
CasADi's `solve` for SX forms Q'b instead, and loses accuracy with the square of the
condition number.

Source: Bjorck (1967), Solving linear least squares problems by Gram-Schmidt
orthogonalization, BIT 7, 1-21.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import a_count, checked
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import (
    EXPRESSION,
    ROWS,
    SymbolMap,
    as_column,
    in_sx,
    require_known,
    require_symbols,
    shortened,
    symbol_names,
    symbol_of,
)
from swarmstart.ocp.common.limits import Limit, vector_of
from swarmstart.ocp.common.pickling import Expressed
from swarmstart.ocp.system.constraints import PathConstraint

_EXPRESSIONS = ("solution", "unsolved", "residual", "size", "start")
"""Attributes of an Elimination that are expressions."""
UNSOLVED = "algebraic equations"
"""Name of the path constraint that requires the equations to be solved."""
SOLVED_WITHIN = 1e-8
"""Largest r at which a plant accepts its equations as solved."""
_LARGEST_RESIDUAL = 1e-9
_RESIDUAL_SCALE = 1e-4  # with a path tolerance of 1e-4: 1e-8 more
_ROOTS = (2.0, 3.0)  # sqrt(2 + k), sqrt(3 + k): test points of dg/dz


@checked(
    refused, symbols=EXPRESSION, residual=ROWS, start=ROWS, iterations=a_count(least=1)
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AlgebraicEquations(Expressed):
    """Equations 0 = g(x, z, u, p) that determine the algebraic variables z.

    Attributes:
        symbols: Symbols of the algebraic variables z, shape (nz, 1).
        residual: g, which is 0, shape (nz, 1) or a list of its rows.
        start: Start value of Newton's method: a number, an array of shape (nz,), or an
            expression in states, controls and parameters. Not used by equations that
            are linear in z.
        scale: Typical size of each z, a number or shape (nz,), > 0. An error of z is
            measured relative to the larger of |z| and this size, approximately.
        iterations: Number of Newton iterations, each time from the start value.

    Raises:
        InvalidProblemError: If shapes do not match or a number is not positive.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, z, u = ca.SX.sym("x"), ca.SX.sym("z"), ca.SX.sym("u")
        >>> equations = ss.AlgebraicEquations(symbols=z, residual=z + ca.exp(z) - x)
        >>> model = ss.Model(states=x, controls=u, ode=u - z, algebraic=equations)
        >>> model.elimination.names
        ('z',)
    """

    symbols: ca.SX
    residual: ca.SX
    start: ca.SX | Limit = 0.0
    scale: Limit = 1.0
    iterations: int = 10

    def __post_init__(self) -> None:
        """Validate the fields that can be checked without the model."""
        scale = _numbers("scale", self.scale)
        if not (scale > 0).all():
            raise InvalidProblemError(
                f"scale of algebraic variables must be positive, got {scale}"
            )
        object.__setattr__(self, "scale", scale)


@dataclass(frozen=True, slots=True, eq=False)
class Elimination(Expressed):
    """Algebraic variables, and the expressions that replace them.

    Attributes:
        symbols: Symbols of the algebraic variables z, shape (nz, 1).
        solution: z as an expression in states, controls and parameters, shape (nz, 1).
        unsolved: Scaled residual r after the last Newton iteration, as an expression in
            states, controls and parameters, shape (nz, 1); empty if the equations are
            linear in z.
        residual: Residual g of the equations 0 = g, as an expression in z and the other
            symbols, shape (nz, 1); empty as above.
        size: Size of each equation at z, by which g is divided to get r, shape (nz, 1);
            empty as above.
        start: Start value of Newton's method, shape (nz, 1); empty as above.
        scale: Typical size of each z, shape (nz,).
    """

    symbols: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    solution: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    unsolved: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    residual: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    size: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    start: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    scale: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the algebraic variables."""
        return symbol_names(self.symbols)

    def rewritten(
        self, change: Callable[[ca.SX], ca.SX], number: int | None = None
    ) -> Elimination:
        """Return a copy with all expressions rewritten.

        Args:
            change: Function that maps an expression to its new form.
            number: Number of the ensemble member that the copy is for; the copy then
                has its own algebraic variables. None: it keeps the same variables.
        """
        own, renamed = self.symbols, number is not None and bool(self.names)
        if renamed:
            named = [symbol_of(f"{z}_{number}") for z in self.names]
            own = ca.vertcat(ca.SX(0, 1), *named)

        def changed(expression: ca.SX) -> ca.SX:
            if renamed:
                expression = ca.substitute(expression, self.symbols, own)
            return change(expression)

        columns: dict[str, Any] = {
            role: changed(getattr(self, role)) for role in _EXPRESSIONS
        }
        return replace(self, symbols=own, **columns)

    def applied(self, expression: ca.SX) -> ca.SX:
        """Return an expression with the solution substituted for z."""
        if not (self.symbols.numel() and ca.depends_on(expression, self.symbols)):
            return expression
        return ca.substitute(expression, self.symbols, self.solution)

    def constraints(self) -> tuple[PathConstraint, ...]:
        """Return the path constraint that the equations hold; () if they are linear."""
        if not self.unsolved.numel():
            return ()
        return (
            PathConstraint(
                expression=self.unsolved,
                lower=-_LARGEST_RESIDUAL,
                upper=_LARGEST_RESIDUAL,
                scale=_RESIDUAL_SCALE,
                name=UNSOLVED,
            ),
        )


def joined(several: Sequence[Elimination]) -> Elimination:
    """Return the algebraic variables of several models as those of one model."""
    columns: dict[str, ca.SX] = {
        role: ca.vertcat(ca.SX(0, 1), *[getattr(one, role) for one in several])
        for role in ("symbols", *_EXPRESSIONS)
    }
    scale = tuple(size for one in several for size in one.scale)
    return Elimination(**columns, scale=scale)


def require_algebraic(equations: object) -> None:
    """Validate the type of the algebraic equations.

    Raises:
        InvalidProblemError: If it is not AlgebraicEquations.
    """
    if not isinstance(equations, AlgebraicEquations):
        raise InvalidProblemError(
            "algebraic must be swarmstart.AlgebraicEquations(symbols=..., "
            f"residual=...), got {shortened(equations)}"
        )


def in_model(
    equations: AlgebraicEquations, symbol_map: SymbolMap
) -> AlgebraicEquations:
    """Return the equations in the SX symbols of a model.

    Raises:
        InvalidProblemError: If an expression has MX symbols that are not the model's.
    """
    return replace(
        equations,
        symbols=symbol_map.sx("algebraic symbols", equations.symbols),
        residual=in_sx("the algebraic equations", equations.residual, symbol_map.sx),
        start=in_sx("start", equations.start, symbol_map.sx),
    )


def eliminate(equations: AlgebraicEquations, known: dict[str, ca.SX]) -> Elimination:
    """Return the algebraic variables as expressions in the model's other symbols.

    Args:
        equations: The equations, in SX symbols.
        known: Columns of the model's other symbols, by their names in messages.

    Raises:
        InvalidProblemError: If the equations have foreign symbols, if there is not one
            equation for each variable, or if the equations cannot be solved for the
            variables.
    """
    z = equations.symbols
    require_symbols("algebraic symbols", z)
    g = as_column("the algebraic equations", equations.residual)
    if not z.numel() or g.numel() != z.numel():
        raise InvalidProblemError(
            "there must be an equation for each algebraic variable "
            f"({', '.join(symbol_names(z)) or 'none'}), got {g.numel()}"
        )
    every = {**known, "algebraic variables": z}
    require_known("the algebraic equations", g, every)
    jacobian = ca.jacobian(g, z)
    _require_regular(jacobian, z, ca.vertcat(*every.values()))
    # Linear equations do not use the start, but an invalid one is refused as well.
    start = _start(equations, z.numel())
    require_known("start of the algebraic variables", start, known)
    # Linear in z: one step from z = 0 is exact.
    if not ca.depends_on(jacobian, z):
        offset = ca.substitute(g, z, ca.SX.zeros(z.numel()))
        return Elimination(z, ca.cse(-solve_in_symbols(jacobian, offset)))
    sizes = _filled("scale", equations.scale, z.numel())
    scale = ca.SX(sizes)
    # The scale keeps the size above 0 at z = 0.
    size = ca.sqrt(ca.mtimes(jacobian**2, z**2 + scale**2))
    newton = ca.Function(
        "newton",
        [*every.values()],
        [z - solve_in_symbols(jacobian, g), g / size],
    )
    others = list(known.values())
    found = start
    # A fixed number: an expression cannot stop when it has converged.
    for _ in range(equations.iterations):
        found = newton.call([*others, found])[0]
    return Elimination(
        z,
        found,
        newton.call([*others, found])[1],
        residual=g,
        size=size,
        start=start,
        scale=tuple(map(float, sizes)),
    )


def _start(equations: AlgebraicEquations, size: int) -> ca.SX:
    """Return the start values as a column."""
    start = equations.start
    if not isinstance(start, ca.SX | list | tuple):
        start = ca.SX(_filled("start", start, size))
    column = as_column("start of the algebraic variables", cast(ca.SX, start))
    if column.numel() == 1:
        column = ca.repmat(column, size, 1)
    if column.numel() != size:
        raise InvalidProblemError(
            f"start must be a number or {size} of them, got {column.numel()}"
        )
    return column


def _filled(role: str, given: Limit, size: int) -> NDArray[np.float64]:
    """Return a number for each algebraic variable."""
    numbers = _numbers(role, given)
    if numbers.shape not in ((), (1,), (size,)):
        raise InvalidProblemError(
            f"{role} of algebraic variables must be a number or {size} of them, "
            f"got {shortened(given)}"
        )
    return np.broadcast_to(numbers, (size,))


def _numbers(role: str, given: Limit) -> NDArray[np.float64]:
    """Return one or several finite numbers as an array."""
    try:
        numbers = vector_of(given)
    except (TypeError, ValueError) as error:
        raise InvalidProblemError(
            f"{role} of algebraic variables must be numbers, got {shortened(given)}"
        ) from error
    if not np.isfinite(numbers).all():
        raise InvalidProblemError(
            f"{role} of algebraic variables must be finite, got {numbers}"
        )
    return numbers


def _require_regular(jacobian: ca.SX, z: ca.SX, symbols: ca.SX) -> None:
    """Raise if the equations do not determine the algebraic variables.

    Raises:
        InvalidProblemError: If dg/dz is structurally singular, or singular at every
            test point.
    """
    pattern = np.asarray(ca.DM(jacobian.sparsity(), 1).full()) != 0
    names = symbol_names(z)
    absent = [name for name, used in zip(names, pattern.sum(axis=0), strict=True)
              if not used]  # fmt: skip
    rows = [str(i) for i, used in enumerate(pattern.sum(axis=1)) if not used]
    why = ""
    # The reasons in this order: from the most telling one to a test by numbers.
    if absent:
        why = f"no equation has {', '.join(absent)}"
    elif rows:
        why = f"equation {', '.join(rows)} has none of them"
    elif ca.sprank(jacobian) < z.numel():
        why = "some of the equations contain too few of them together"
    elif _singular_everywhere(jacobian, symbols):
        why = "the equations depend on each other"
    if why:
        raise InvalidProblemError(
            "the algebraic equations must determine the algebraic variables "
            f"{', '.join(names)} (dg/dz regular, index 1): {why}; an equation without "
            "them can be differentiated with respect to time, by hand"
        )


def _singular_everywhere(jacobian: ca.SX, symbols: ca.SX) -> bool:
    """Return whether the matrix is singular at each point at which it is finite."""
    function = ca.Function("jacobian", [symbols], [jacobian])
    places: Sequence[NDArray[np.float64]] = [
        # Irrational and all different, so hardly a special point of the equations.
        np.sqrt(root + np.arange(symbols.numel()))
        for root in _ROOTS
    ]
    values = [np.array(function(place)) for place in places]
    finite = [value for value in values if np.isfinite(value).all()]
    # One regular point is enough: some models are singular at special states.
    return bool(finite) and all(
        np.linalg.matrix_rank(value) < len(value) for value in finite
    )


def solve_in_symbols(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return the solution z of the linear equations `matrix` z = `right`.

    Args:
        matrix: Shape (n, n), of full structural rank.
        right: Shape (n, 1).

    Returns:
        Shape (n, 1); NaN or infinite if the matrix is singular.
    """
    _, rows, columns, block_rows, _, _, _ = matrix.sparsity().btf()
    found: dict[int, ca.SX] = {}
    for first, end in itertools.pairwise(block_rows):
        own = columns[first:end]
        left = []
        for row in rows[first:end]:
            entries = (matrix[row, column] * z for column, z in found.items()
                       if matrix.sparsity().has_nz(row, column))  # fmt: skip
            left.append(right[row] - sum(entries, ca.SX(0)))
        block = ca.densify(matrix[rows[first:end], own])
        found.update(zip(own, _solved_block(block, left), strict=True))
    return ca.vertcat(*[found[k] for k in range(len(found))])


def _solved_block(block: ca.SX, right: list[ca.SX]) -> list[ca.SX]:
    """Return the solution of equations with a dense matrix."""
    # A division alone; Gram-Schmidt would square the number.
    if len(right) == 1:
        return [right[0] / block[0, 0]]
    left = [*ca.horzsplit(block), ca.vertcat(*right)]
    factors = []
    for j in range(len(right)):
        q = left[j]
        length = ca.sumsqr(q)
        row = {k: ca.dot(q, left[k]) / length for k in range(j + 1, len(left))}
        # Also the last column, b, which makes the method accurate (see the head).
        for k, factor in row.items():
            left[k] -= factor * q
        factors.append(row)
    solution: list[ca.SX] = []  # from the last on
    for j in reversed(range(len(right))):
        known = zip(reversed(range(j + 1, len(right))), solution, strict=True)
        solution.append(
            factors[j][len(right)]
            - sum((factors[j][k] * z for k, z in known), ca.SX(0))
        )
    return solution[::-1]
