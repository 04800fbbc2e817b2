"""States with a number near them subtracted: z = x - c for a state x far from zero.

    z' = f(z + c, u, p),   z+ = g(z + c, u, p) - c,   z(0) = x(0) - c

A double has sixteen digits. A state of 1e9 times its natural size is rounded to 2e-7 of
that size, so IPOPT's tolerance of 1e-8 is never reached; z keeps all of its digits. So
c must cancel where the problem subtracts a number r near it. Every value is kept in
parts

    a + (b + k),   a with states and controls, b of parameters, signals and time only,
                   k a number

until an operation needs its sum: sums and constant factors act on the parts, and (z +
c) - r becomes z + (c - r), where c - r is exact. A constant term of a row with limits
is moved into the limits.

Source: Higham (2002), Accuracy and Stability of Numerical Algorithms, theorem 2.5
(Sterbenz), for the exact difference of numbers near each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import rows_that_depend, shortened, symbol_of
from swarmstart.ocp.common.limits import require_number
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    changed_fields,
    changed_model,
    with_equations,
)
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite
from swarmstart.ocp.system.constraints import PathConstraint, TerminalConstraint
from swarmstart.ocp.system.separation import label

FAR = 1e7
"""Distance from zero, in sizes, from which rounding nears the tolerance of IPOPT.

2e-9 of the size at 1e7, 1e-8 at 4e7. No scenario that is shipped comes near it."""
_STEP = 64
"""Sizes in a step of c, at least; starts near each other share one compiled problem."""


@dataclass(frozen=True, slots=True)
class CountedFrom(Rewrite):
    """Numbers that the solvers subtract from states that are far from zero.

    `solve` subtracts such numbers by itself if a start is more than 1e7 natural sizes
    away from zero. A `Planner` is made before it has a start, so state the numbers for
    a closed loop. The states that you give and get are those of the problem, with
    nothing subtracted.

    Attributes:
        numbers: A number near the values of each state, by its name.

    Raises:
        InvalidProblemError: If a number is not finite. A problem that is stated with
            this feature also raises the errors of `require`.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> far = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, terminal=[(x, 1e9 + 1)],
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ...     features=[ss.CountedFrom({"x": 1e9})],
        ... )
        >>> found = ss.solve(far, [1e9], search=None, lanes=0, seed=0)
        >>> found.status.name, (found.states - 1e9).round(3).tolist()
        ('CONVERGED', [[0.0, 0.25, 0.5, 0.75, 1.0]])
    """

    role = "counted from"

    numbers: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not isinstance(self.numbers, Mapping):
            raise InvalidProblemError(
                "numbers of a CountedFrom must be a mapping of states to numbers, such "
                f"as {{'x': 1e9}}, got {shortened(self.numbers)}"
            )
        for name, number in self.numbers.items():
            if not np.isfinite(require_number(f"number of {name!r}", number)):
                raise InvalidProblemError(
                    f"number of {name!r} must be finite, got {number}"
                )

    def require(self, problem: OptimalControlProblem) -> None:
        """Raise if a name does not go with a problem.

        Raises:
            InvalidProblemError: If a name is unknown, the problem joins phases, or
                states share a decided start and have different numbers.
        """
        names = problem.model.state_names
        if wrong := [name for name in self.numbers if name not in names]:
            raise InvalidProblemError(
                f"CountedFrom must name states, some of {', '.join(names)}, got "
                f"{', '.join(map(str, wrong))}"
            )
        if problem.clock:
            raise InvalidProblemError(
                "CountedFrom does not go with joined phases, whose states their own "
                "clock counts"
            )
        origin = self.origin(problem)
        for one in problem.free_starts:
            if np.ptp(origin[list(one.states)]):
                together = [names[i] for i in one.states]
                raise InvalidProblemError(
                    "states that share a decided start must be counted from one "
                    f"number: {', '.join(together)}"
                )

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether a number other than zero is subtracted from a state."""
        return bool(self.origin(problem).any())

    def origin(self, problem: OptimalControlProblem) -> Array:
        """Return the number that is subtracted from each state, shape (nx,)."""
        names = problem.model.state_names
        return np.array([float(self.numbers.get(name, 0.0)) for name in names])

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with the differences z in place of the states x."""
        shift = _Shift(problem, self.origin(problem))
        lower, upper = problem.state_limits
        model = problem.model
        equations = changed_model(model, shift)
        if model.jumps:
            equations["next_state"] = shift(model.next_state, -shift.origin)
        fields = changed_fields(problem, shift, shift)
        fields["constraints"] = [
            _moved(given, changed, shift)
            for given, changed in zip(
                (*problem.stated, *problem.soft), fields["constraints"], strict=True
            )
        ]
        fields["terminal"] = [
            _moved(given, changed, shift)
            for given, changed in zip(
                problem.terminal_constraints, fields["terminal"], strict=True
            )
        ]
        return replace(
            problem,
            model=with_equations(model, states=shift.states, **equations),
            bounds=replace(
                problem.bounds, states=(lower - shift.origin, upper - shift.origin)
            ),
            start=_starts(problem, shift.origin),
            **fields,
        )


def from_near(
    problem: OptimalControlProblem, x0: Array, sizes: Array
) -> OptimalControlProblem:
    """Return a problem in which numbers near x0 are subtracted from large states.

    A problem without such states is returned unchanged, and so is one that has a
    `CountedFrom`.

    Args:
        problem: The problem.
        x0: Its initial state, shape (nx,).
        sizes: Natural sizes of its states, shape (nx,).
    """
    far = np.isfinite(x0) & (np.abs(x0) > FAR * sizes)
    is_stated = any(isinstance(one, CountedFrom) for one in problem.features)
    if is_stated or problem.clock or not far.any():
        return problem
    # Powers of two, so that the multiples and their differences are exact.
    step = 2.0 ** np.ceil(np.log2(_STEP * sizes))
    numbers = np.where(far, np.rint(x0 / step) * step, 0.0)
    for one in problem.free_starts:
        numbers[list(one.states)] = numbers[one.states[0]]  # They share one start.
    found = zip(problem.model.state_names, numbers.tolist(), strict=True)
    feature = CountedFrom({name: number for name, number in found if number})
    # Later calls find what was made for the same numbers.
    kept = problem.kept.get("near")
    if kept is None or kept.features[-1] != feature:
        kept = replace(problem, features=(*problem.features, feature))
        problem.kept["near"] = kept
    near: OptimalControlProblem = kept
    return near


def from_zero(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem without its CountedFrom; a problem without one, unchanged."""
    left = [one for one in problem.features if not isinstance(one, CountedFrom)]
    if len(left) == len(problem.features):
        return problem
    return replace(problem, features=left)


class _Parts(NamedTuple):
    """A value a + (b + k); see the module's docstring."""

    a: ca.SX
    b: ca.SX
    k: float

    @property
    def whole(self) -> ca.SX:
        """The sum a + (b + k)."""
        known = self.b + self.k if self.k else self.b
        return known if self.a.is_zero() else self.a + known

    @property
    def is_factor(self) -> bool:
        """True if it is a number alone, finite and not 0."""
        is_number = self.a.is_zero() and self.b.is_zero()
        return bool(is_number and self.k and np.isfinite(self.k))

    def times(self, factor: float) -> _Parts:
        """Return the value times a number."""
        return _Parts(factor * self.a, factor * self.b, factor * self.k)

    def plus(self, other: _Parts, sign: float = 1.0) -> _Parts:
        """Return the sum with another value, or the difference."""
        if sign < 0:
            return _Parts(self.a - other.a, self.b - other.b, self.k - other.k)
        return _Parts(self.a + other.a, self.b + other.b, self.k + other.k)


class _Shift:
    """Replacement of the states x by z + c.

    Attributes:
        origin: The numbers c, shape (nx,).
        states: Symbols of the states, with those of z in the places of x, (nx, 1).
    """

    def __init__(self, problem: OptimalControlProblem, origin: Array) -> None:
        """Keep the symbols of a problem."""
        model, self.origin = problem.model, origin
        far = np.flatnonzero(origin).tolist()
        self._given, self._far = model.states, model.states[far]
        self.states = ca.SX(model.states)
        for i in far:
            # A message that shows an expression shows what is counted.
            self.states[i] = symbol_of(f"{model.state_names[i]} - {origin[i]!r}")
        self._replaced = {
            model.states[i].element_hash(): _Parts(
                self.states[i], ca.SX(0), float(origin[i])
            )
            for i in far
        }
        known = ca.vertcat(model.parameters, problem.signals, model.time)
        self._known = {known[i].element_hash() for i in range(known.numel())}

    def __call__(self, column: ca.SX, more: Array | None = None) -> ca.SX:
        """Return a column with z + c in place of x, and numbers added to its rows.

        Args:
            column: Column in the states x, shape (m, 1).
            more: Numbers to add, shape (m,); None: nothing is added.
        """
        added = np.zeros(column.numel()) if more is None else more
        rows = self.rows_of(column)
        if not (rows or added.any()):
            return column
        parts = self.parts(column)
        return ca.vertcat(*[
            part._replace(k=part.k + extra).whole if row in rows or extra else own
            for row, (part, extra, own) in enumerate(
                zip(parts, added, ca.vertsplit(column), strict=True)
            )
        ])  # fmt: skip

    def rows_of(self, column: ca.SX) -> list[int]:
        """Return the rows of a column that depend on states x with a number c not 0."""
        return rows_that_depend(column, self._far)

    def parts(self, column: ca.SX) -> list[_Parts]:
        """Return each row of a column in x as `_Parts`, with z + c in place of x."""
        symbols = ca.vertcat(ca.SX(0, 1), *ca.symvar(ca.vertcat(column, self._far)))
        tape = ca.Function("tape", [symbols], [ca.densify(column)])
        work: dict[int, _Parts] = {}
        found = [_number(0.0)] * column.numel()
        for line in range(tape.n_instructions()):
            operation = tape.instruction_id(line)
            given, made = tape.instruction_input(line), tape.instruction_output(line)
            if operation == ca.OP_CALL:
                # A table: its arguments are no scalars, so nothing is collected.
                whole = ca.substitute(
                    column, self._given, self.states + ca.DM(self.origin)
                )
                return [_Parts(row, ca.SX(0), 0.0) for row in ca.vertsplit(whole)]
            if operation == ca.OP_INPUT:
                work[made[0]] = self._symbol(symbols[given[1]])
            elif operation == ca.OP_CONST:
                work[made[0]] = _number(tape.instruction_constant(line))
            elif operation == ca.OP_OUTPUT:
                found[made[1]] = work[given[0]]
            else:
                work[made[0]] = _result(operation, [work[place] for place in given])
        return found

    def _symbol(self, symbol: ca.SX) -> _Parts:
        key = symbol.element_hash()
        if key in self._known:
            return _Parts(ca.SX(0), symbol, 0.0)
        return self._replaced.get(key, _Parts(symbol, ca.SX(0), 0.0))


def _number(value: float) -> _Parts:
    return _Parts(ca.SX(0), ca.SX(0), value)


def _result(operation: int, given: Sequence[_Parts]) -> _Parts:
    """Return an operation's result in parts, if it acts on them, else as a whole."""
    first, last = given[0], given[-1]
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return first.plus(last, -1.0 if operation == ca.OP_SUB else 1.0)
    if operation in (ca.OP_NEG, ca.OP_TWICE):
        return first.times(-1.0 if operation == ca.OP_NEG else 2.0)
    if operation == ca.OP_MUL and (first.is_factor or last.is_factor):
        return last.times(first.k) if first.is_factor else first.times(last.k)
    if operation == ca.OP_DIV and last.is_factor:
        return _Parts(first.a / last.k, first.b / last.k, first.k / last.k)
    of = ca.SX.unary if len(given) == 1 else ca.SX.binary
    result, zero = of(operation, *[one.whole for one in given]), ca.SX(0)
    is_known = all(one.a.is_zero() for one in given)
    return _Parts(zero, result, 0.0) if is_known else _Parts(result, zero, 0.0)


def _moved(given: Any, changed: Any, shift: _Shift) -> Any:
    """Return a constraint in z, with numbers moved into its limits.

    Args:
        given: The constraint in x.
        changed: The same in z, with its limits as they are.
        shift: The replacement.
    """
    if not isinstance(given, PathConstraint | TerminalConstraint):
        return replace(changed, name=label(given))
    rows, parts = shift.rows_of(given.expression), shift.parts(given.expression)
    # A moving limit stays with its number, which cancels most of it.
    number = np.array([
        part.k if row in rows and part.b.is_zero() else 0.0
        for row, part in enumerate(parts)
    ])  # fmt: skip
    values = [
        parts[row].a if moves else own
        for row, (moves, own) in enumerate(
            zip(number, ca.vertsplit(changed.expression), strict=True)
        )
    ]
    return replace(
        changed,
        name=label(given),
        expression=ca.vertcat(ca.SX(0, 1), *values),
        lower=np.asarray(given.lower) - number,
        upper=np.asarray(given.upper) - number,
    )


def _starts(
    problem: OptimalControlProblem, origin: Array
) -> dict[str | tuple[str, ...], Free]:
    """Return the free starts, counted from the origin."""
    found: dict[str | tuple[str, ...], Free] = {}
    names = problem.model.state_names
    for key, value in problem.start.items():
        c = origin[names.index(key if isinstance(key, str) else key[0])]
        guess = None if value.guess is None else value.guess - c
        found[key] = Free(value.lower - c, value.upper - c, guess)
    return found
