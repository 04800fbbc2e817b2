"""NLP given by the user of another tool, and the elimination of its states.

    min f(x, p)   subject to   lower <= g(x, p) <= upper,    as scalar SX expressions

Functions that SX can only contain as calls (`cvodes`, a plain `rk`, interpolants) are
refused: substituting through such a node ends the process (CasADi 3.8.2).

Peeling: a row with lower = upper that contains one unknown state c linearly, with a
factor a that does not depend on the states, defines this state:

    x_c = (bound - g_i(x with x_c = 0)) / a

Rows are used in the order in which they come to have one unknown left. A row that
contains a single state alone defines it only at the first time: a fixed state at the
end stays a constraint. Otherwise an integrator would be peeled backward from its
target, and its controls would lose their meaning. States of the first time that no row
defines are torn: they stay variables.

The definitions are substituted into f and the remaining rows once. The eliminated rows
must then be 0 for any value of the remaining variables; this is checked at a random
point.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.nlp.nlp_sources import NlpSource, OptiSource, last_line

Indices = NDArray[np.int64]
_EXACT = 1e-6
"""Largest residual of an eliminated row at a random point, relative to its terms."""
_UNSUPPORTED = (
    "states are eliminated from explicit steps x[k+1] = F(x[k], u[k]) only, not from "
    "an implicit Euler or trapezoidal step or a collocation"
)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GivenNlp:
    """Expressions of an NLP, independent of the form in which it was given.

    Attributes:
        x: Variables, SX of shape (nx, 1).
        p: Parameters, SX of shape (np, 1).
        f: Cost, a scalar SX.
        g: Rows of the constraints, SX of shape (ng, 1).
        source: The object that it was read from.
        rows: Function (x, p) -> g.
        cost: Function (x, p) -> f.
        jacobian: Function (x, p) -> Jacobian of g by x, sparse.
        slopes: Expression of this Jacobian.
    """

    x: ca.SX
    p: ca.SX
    f: ca.SX
    g: ca.SX
    source: OptiSource | NlpSource
    rows: ca.Function = field(init=False)
    cost: ca.Function = field(init=False)
    jacobian: ca.Function = field(init=False)
    slopes: ca.SX = field(init=False)

    def __post_init__(self) -> None:
        """Make the functions."""
        arguments = [self.x, self.p]
        slopes = ca.jacobian(self.g, self.x)
        object.__setattr__(self, "slopes", slopes)
        for name, value in (("rows", self.g), ("cost", self.f), ("jacobian", slopes)):
            object.__setattr__(self, name, ca.Function(name, arguments, [value]))

    def name(self, index: int) -> str:
        """Return the name of a variable for a message."""
        return self.source.name(index)

    def describe(self, row: int) -> str:
        """Return the description of a row of g for a message."""
        return f"constraint g[{row}]: {self.source.describe(row)}"


def read_nlp(source: OptiSource | NlpSource) -> GivenNlp:
    """Return an NLP as scalar SX expressions.

    Raises:
        InvalidProblemError: If it cannot be written in scalar SX.
    """
    function = source.function()
    try:
        expanded = function.expand()
    except RuntimeError as error:
        raise InvalidProblemError(
            "the NLP cannot be written in scalar SX, which the elimination of states "
            f"needs: {last_line(error)}"
        ) from error
    if expanded.find_functions():
        raise InvalidProblemError(
            "the NLP cannot be written in scalar SX, which the elimination of states "
            f"needs: it calls {_called(function)}; write the integrator's steps out "
            "(integrator('rk', ..., {'simplify': True}) does), and tables by "
            "casadi.pw_lin"
        )
    x = ca.SX.sym("x", function.numel_in(0))
    p = ca.SX.sym("p", function.numel_in(1))
    f, g = expanded(x, ca.reshape(p, function.size_in(1)))
    return GivenNlp(x=x, p=p, f=ca.densify(f), g=ca.densify(g), source=source)


def _called(function: ca.Function) -> str:
    """Return the names of called functions that are not plain expressions."""
    plain = ("MXFunction", "SXFunction", "Map", "MapSum", "MapAccum")
    inner = (f for f in function.find_functions() if f.class_name() not in plain)
    return ", ".join(sorted({f"{f.name()} ({f.class_name()})" for f in inner}))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Elimination:
    """NLP in the variables that remain after its states are eliminated.

    Attributes:
        free: Indices in x of the remaining variables, shape (nf,).
        torn: Indices in x of the states among the remaining variables.
        kept: Numbers of the remaining rows of g, shape (nk,).
        value: Function (remaining variables, p, lower bounds of g) -> (f, remaining
            rows of g).
        whole: Function (remaining variables, p, lower bounds of g) -> x.
    """

    free: Indices
    torn: Indices
    kept: Indices
    value: ca.Function
    whole: ca.Function


def eliminated(
    nlp: GivenNlp, layouts: Sequence[Indices], equalities: Indices
) -> tuple[Elimination, Indices]:
    """Eliminate the states of an NLP.

    Args:
        nlp: The NLP.
        layouts: Possible arrangements of the states in time: indices in x, shape
            (nx, times). Chosen is the one with which all states can be eliminated and
            the fewest have to stay variables.
        equalities: Numbers of the rows with equal bounds.

    Returns:
        The eliminated NLP, and the chosen layout.

    Raises:
        InvalidProblemError: If a state cannot be eliminated; the message names the
            constraint that prevents it.
    """
    states = np.sort(layouts[0].ravel())
    rows = _rows_of(nlp, states, equalities)
    places = {int(index): place for place, index in enumerate(states)}
    tried = []
    for layout in layouts:
        times = np.empty(states.size, dtype=np.int64)
        for time, column in enumerate(layout.T):
            times[[places[int(index)] for index in column]] = time
        tried.append((_peeled(rows, times), times, layout))
    # With rows and columns swapped, a state at all times may be torn to define another.
    fewest = min(layout.shape[0] for layout in layouts)
    peel, times, layout = min(
        tried,
        key=lambda t: (
            len(t[0].torn) > fewest,
            len(t[0].unknown) > 0,
            len(t[0].torn),
            t[2].shape[0],
        ),
    )
    if peel.unknown:
        raise InvalidProblemError(_refusal(nlp, rows, peel, states, times))
    found = _substituted(nlp, rows, peel, states)
    _require_exact(nlp, found, rows, peel)
    return found, layout


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Equality rows and the states in them.

    Attributes:
        numbers: Numbers of the rows in g.
        entries: For each row its states, as (state, entry of the Jacobian).
        users: For each state the rows that contain it.
        factors: Entries of the Jacobian.
        usable: Whether an entry is nonzero and independent of the states.
    """

    numbers: Indices
    entries: list[list[tuple[int, int]]]
    users: list[list[int]]
    factors: list[Any]
    usable: NDArray[np.bool_]


@dataclass(slots=True)
class _Peel:
    """Assignment of states to the rows that define them, in the order of definition.

    Attributes:
        defined: (row, state, entry of the Jacobian).
        torn: States that stay variables.
        unknown: States that are neither defined nor torn.
    """

    defined: list[tuple[int, int, int]]
    torn: list[int]
    unknown: set[int]


def _rows_of(nlp: GivenNlp, states: Indices, equalities: Indices) -> _Rows:
    """Return the equality rows with the states in them."""
    jacobian = nlp.slopes[equalities.tolist(), states.tolist()]
    rows, columns = jacobian.sparsity().get_triplet()
    entries: list[list[tuple[int, int]]] = [[] for _ in equalities]
    users: list[list[int]] = [[] for _ in states]
    for entry, (row, state) in enumerate(zip(rows, columns, strict=True)):
        entries[row].append((state, entry))
        users[state].append(row)
    function = ca.Function("factors", [nlp.x, nlp.p], [jacobian])
    rng = np.random.default_rng(0)
    point, p = (
        rng.uniform(0.5, 1.5, nlp.x.numel()),
        rng.uniform(0.5, 1.5, nlp.p.numel()),
    )
    values = []
    for size in (0.3, 1.0, 3.0):  # Only the states vary.
        point[states] = rng.normal(0.0, size, states.size)
        values.append(np.array(function(point, p).nonzeros()))
    usable = (values[0] == values[1]) & (values[1] == values[2]) & (values[0] != 0.0)
    factors = jacobian.nonzeros()
    return _Rows(equalities, entries, users, factors, usable & np.isfinite(values[0]))


def _peeled(rows: _Rows, times: Indices) -> _Peel:  # noqa: C901 - two closures
    """Return the assignment of states to rows; nothing is computed.

    Args:
        rows: The rows.
        times: Time index of each state, from 0.
    """
    left = [len(entries) for entries in rows.entries]
    ready = deque(row for row, count in enumerate(left) if count == 1)
    peel = _Peel([], [], set(range(times.size)))

    def know(state: int) -> None:
        peel.unknown.discard(state)
        for row in rows.users[state]:
            left[row] -= 1
            if left[row] == 1:
                ready.append(row)

    def go_on() -> None:
        while ready:
            row = ready.popleft()
            if left[row] == 1 and (found := _defined_by(rows, row, peel, times)):
                left[row] = 0  # Used: it must not become ready again.
                peel.defined.append((row, *found))
                know(found[0])

    go_on()
    for state in np.flatnonzero(times == 0).tolist():
        if state in peel.unknown:
            peel.torn.append(state)
            know(state)
    go_on()
    return peel


def _defined_by(
    rows: _Rows, row: int, peel: _Peel, times: Indices
) -> tuple[int, int] | None:
    """Return the state that a row with one unknown defines; None if it must not."""
    state, entry = next(e for e in rows.entries[row] if e[0] in peel.unknown)
    if not rows.usable[entry]:
        return None
    is_late_pin = len(rows.entries[row]) == 1 and times[state] > 0
    return None if is_late_pin else (state, entry)


def _substituted(
    nlp: GivenNlp, rows: _Rows, peel: _Peel, states: Indices
) -> Elimination:
    """Return the NLP with the definitions substituted."""
    lower, zero = ca.SX.sym("lower", nlp.g.numel()), ca.SX(0)
    variables, definitions, used = [], [], []
    for row, state, entry in peel.defined:
        number, x_c = int(rows.numbers[row]), nlp.x[int(states[state])]
        without = ca.substitute(nlp.g[number], x_c, zero)
        variables.append(x_c)
        definitions.append((lower[number] - without) / rows.factors[entry])
        used.append(number)
    kept = np.setdiff1d(np.arange(nlp.g.numel()), used)
    # One pass: substituting one by one takes a time that grows quadratically.
    definitions, (f, g) = ca.substitute_inplace(
        variables, definitions, [nlp.f, nlp.g[kept.tolist()]], False
    )
    defined = states[[state for _, state, _ in peel.defined]]
    free = np.setdiff1d(np.arange(nlp.x.numel()), defined)
    whole = ca.SX(nlp.x)
    for index, definition in zip(defined.tolist(), definitions, strict=True):
        whole[index] = definition
    arguments = [nlp.x[free.tolist()], nlp.p, lower]
    return Elimination(
        free=free,
        torn=states[peel.torn],
        kept=kept,
        value=ca.Function("value", arguments, [f, g]),
        whole=ca.Function("whole", arguments, [whole]),
    )


def _require_exact(nlp: GivenNlp, found: Elimination, rows: _Rows, peel: _Peel) -> None:
    """Raise if a definition does not satisfy its row; a safeguard, never needed yet."""
    rng = np.random.default_rng(1)
    free, p = (rng.uniform(0.4, 0.6, n) for n in (found.free.size, nlp.p.numel()))
    lower = rng.uniform(-1.0, 1.0, nlp.g.numel())
    x = np.array(found.whole(free, p, lower)).ravel()
    used = rows.numbers[[row for row, _, _ in peel.defined]]
    residual = np.array(nlp.rows(x, p)).ravel()[used] - lower[used]
    size = 1.0 + np.abs(x).max(initial=0.0)
    broken = np.flatnonzero(np.abs(residual) > _EXACT * size)  # NaN: outside a domain.
    if broken.size:
        raise InvalidProblemError(
            "the states cannot be eliminated: a constraint seemed linear in one "
            f"of them but is not: {nlp.describe(int(used[broken[0]]))}"
        )


def _refusal(
    nlp: GivenNlp, rows: _Rows, peel: _Peel, states: Indices, times: Indices
) -> str:
    """Return the error that names the state and the constraint in the way."""
    state = min(peel.unknown, key=lambda s: (times[s], s))
    index = int(states[state])
    if not rows.users[state]:
        return (
            f"state {nlp.name(index)} (time {times[state]}) cannot be eliminated: no "
            f"equality constraint has it; {_UNSUPPORTED}"
        )
    row = min(
        rows.users[state],
        key=lambda r: (max(times[s] for s, _ in rows.entries[r]), r),
    )
    unknown = [
        nlp.name(int(states[s])) for s, _ in rows.entries[row] if s in peel.unknown
    ]
    return (
        f"state {nlp.name(index)} (time {times[state]}) cannot be eliminated; "
        f"{_UNSUPPORTED}; still unknown here: {', '.join(unknown)}; "
        f"{nlp.describe(int(rows.numbers[row]))}"
    )
