"""Sources of NLPs: a CasADi Opti, or a dictionary for `casadi.nlpsol`.

    min f(x, p)   subject to   lower_g <= g(x, p) <= upper_g

f is the cost, g are the rows, x the variables, and p the parameters. Each source gives
these functions and their numbers, states where a variable or a row was made, and runs
its own solver. Bounds of a dictionary's variables are read as further rows of g, after
the rows of the dictionary.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.heuristics.running import heeded
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened

Indices = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Numbers:
    """Numbers of an NLP, as they are set at one time.

    Attributes:
        p: Values of the parameters, shape (np,).
        lower_g: Lower bounds of the rows, shape (ng,).
        upper_g: Upper bounds of the rows, shape (ng,).
        start: The source's own start, shape (nx,).
    """

    p: Array
    lower_g: Array
    upper_g: Array
    start: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Run:
    """One run of the source's own solver.

    Attributes:
        solution: Solution in the source's own form; None if the solver raised an error.
        x: Variables at the end of the run, shape (nx,); None without a solution.
        status: Status as the solver reports it.
        iterations: Number of iterations; 0 if the solver does not report it.
        seconds: Wall time [s].
        success: Success as the solver reports it.
    """

    solution: Any
    x: Array | None
    status: str
    iterations: int
    seconds: float
    success: bool


class OptiSource:
    """A CasADi Opti; `solve` runs the user's solver with the user's options."""

    kind = "opti"

    def __init__(self, opti: ca.Opti) -> None:
        """Keep the Opti.

        Raises:
            InvalidProblemError: If it has a discrete variable.
        """
        self.opti = opti
        # Until the first solve, each access to the Opti collects all of it anew.
        baked = opti.advanced.baked_copy()
        self.symbols = baked.symvar(baked.x)
        self.x, self.p, self.f, self.g = baked.x, baked.p, baked.f, ca.vec(baked.g)
        self._bounds = ca.Function("bounds", [self.p], [baked.lbg, baked.ubg])
        whole = getattr(ca, "OPTI_DOMAIN_INTEGER", 1)
        for symbol in self.symbols:
            # CasADi before 3.7 has no domains.
            if getattr(opti.debug.get_meta(symbol), "domain", 0) == whole:
                raise InvalidProblemError(
                    "expected continuous variables, found a discrete one: "
                    f"{_one_line(opti.debug.describe(symbol))}"
                )

    def function(self) -> ca.Function:
        """Return the function (x, p) -> (f, g)."""
        return ca.Function("given", [self.x, self.p], [self.f, self.g])

    def require_unchanged(self) -> None:
        """Raise if the Opti's variables, constraints or cost have changed.

        Raises:
            InvalidProblemError: If they have changed.
        """
        opti = self.opti
        found = opti.nx, opti.np, opti.ng, opti.f.__hash__()
        known = (*(v.numel() for v in (self.x, self.p, self.g)), self.f.__hash__())
        if found != known:
            raise InvalidProblemError(
                "the Opti was changed after warm_start; expected the same cost and "
                "constraints: call warm_start again"
            )

    def numbers(self) -> Numbers:
        """Return the numbers as they are set now.

        Raises:
            InvalidProblemError: If a parameter has no value.
        """
        initial = self.opti.initial()
        try:
            p = _vector(self.opti.value(self.p, initial), self.p.numel())
        except RuntimeError as error:
            raise InvalidProblemError(
                "expected a value of every parameter (opti.set_value), found none of "
                f"{_tail(error, 'unset value:')}"
            ) from error
        lower, upper = (_vector(b, self.g.numel()) for b in self._bounds(p))
        return Numbers(
            p=p,
            lower_g=lower,
            upper_g=upper,
            start=_vector(self.opti.value(self.x, initial), self.x.numel()),
        )

    def indices(self, role: str, given: object) -> Indices:
        """Return the indices in x of an expression's entries, an array of its shape."""
        return _places(role, given, self.x, "variables of this Opti")

    def name(self, index: int) -> str:
        """Return the variable's symbol and entry, and the code line that made it."""
        first = 0
        for symbol in self.symbols:
            if index < first + symbol.numel():
                column, row = divmod(index - first, symbol.shape[0])
                where = _one_line(self.opti.debug.describe(symbol)).partition(
                    "called from "
                )[2]
                return f"{symbol.name()}[{row}, {column}] (made in {where})"
            first += symbol.numel()
        return f"x[{index}]"

    def describe(self, row: int) -> str:
        """Return CasADi's description of a row, with the line of the user's code."""
        return _one_line(self.opti.debug.g_describe(row))

    def run(self, start: Array | None) -> Run:
        """Solve from a start; None means the user's own."""
        opti = self.opti
        if start is not None:
            opti.set_initial(self.x, start)
        begin = time.perf_counter()
        try:
            with heeded():  # CasADi would discard Ctrl-C.
                solution = opti.solve()
        except RuntimeError as error:
            return _failed(_opti_status(opti, error), begin)
        stats = solution.stats()
        return Run(
            solution=solution,
            x=_vector(solution.value(self.x), self.x.numel()),
            status=str(stats.get("return_status", "")),
            iterations=int(stats.get("iter_count", 0)),
            seconds=time.perf_counter() - begin,
            success=True,
        )

    def restore(self, start: Array) -> None:
        """Solve from a start again, so that the Opti has the same solution as before.

        A solution cannot be put into an Opti: new initial values would discard it.
        """
        self.run(start)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NlpSource:
    """A dictionary for `casadi.nlpsol`, with its numbers.

    Attributes:
        nlp: Expressions "x", "f" and, if used, "g" and "p".
        solver: The solver made from the dictionary.
        arguments: Arguments of the solver: all of x0, p, lbg, ubg, lbx, ubx.
    """

    nlp: Mapping[str, Any]
    solver: ca.Function
    arguments: Mapping[str, Array]
    kind = "nlp"

    @property
    def bounded(self) -> list[int]:
        """Indices of the variables with bounds."""
        limits = (self.arguments["lbx"], self.arguments["ubx"])
        return [int(i) for i in np.flatnonzero(np.isfinite(limits).any(axis=0))]

    def function(self) -> ca.Function:
        """Return (x, p) -> (f, g), with the bounded variables after the rows of g."""
        nlp, kind = self.nlp, type(self.nlp["x"])  # SX or MX.
        x, p = ca.vec(nlp["x"]), ca.vec(nlp.get("p", kind.sym("p", 0)))
        rows = ca.vertcat(ca.vec(nlp.get("g", kind(0, 1))), x[self.bounded])
        return ca.Function("given", [x, p], [nlp["f"], rows])

    def require_unchanged(self) -> None:
        """Do nothing: a dictionary cannot change."""

    def numbers(self) -> Numbers:
        """Return the numbers of the NLP."""
        given, bounded = self.arguments, self.bounded
        lower, upper = (
            np.concatenate([given[f"{side}g"], given[f"{side}x"][bounded]])
            for side in ("lb", "ub")
        )
        return Numbers(p=given["p"], lower_g=lower, upper_g=upper, start=given["x0"])

    def indices(self, role: str, given: object) -> Indices:
        """Return indices in x: the given ones, or those of an expression's entries.

        Given indices are checked, and returned as a table (rows, times).
        """
        if not isinstance(given, ca.SX | ca.MX):
            return _indices(role, given, self.nlp["x"].numel())
        return _places(role, given, self.nlp["x"], "entries of nlp['x']")

    def name(self, index: int) -> str:
        """Return the variable's name in messages: its index in x."""
        return f"x[{index}]"

    def describe(self, row: int) -> str:
        """Return a row's expression, shortened; for a bound, its variable's name."""
        own = self.arguments["lbg"].size
        if row < own:
            return shortened(self.nlp["g"][row])
        return f"bounds of x[{self.bounded[row - own]}]"

    def run(self, start: Array | None) -> Run:
        """Solve from a start; None means the user's own."""
        given = dict(self.arguments)
        if start is not None:
            given["x0"] = start
        begin = time.perf_counter()
        try:
            with heeded():
                answer = self.solver(**given)
        except RuntimeError as error:
            return _failed(last_line(error), begin)
        stats = self.solver.stats()
        return Run(
            solution=answer,
            x=_vector(answer["x"], given["x0"].size),
            status=str(stats.get("return_status", "")),
            iterations=int(stats.get("iter_count", 0)),
            seconds=time.perf_counter() - begin,
            success=bool(stats.get("success", False)),
        )

    def restore(self, start: Array) -> None:
        """Do nothing: there is no solution to restore in the solver."""


def _places(role: str, given: Any, x: Any, whose: str) -> Indices:
    """Return the indices in x of an expression's entries, an array of its shape."""
    if not isinstance(given, ca.SX | ca.MX):
        raise InvalidProblemError(f"{role} must be {whose}, got {shortened(given)}")
    selected: Any = given
    numbers = np.arange(x.numel(), dtype=np.float64)
    # A variable shows its own index at the first point, and its own number at this one;
    # a function of variables hardly does both.
    others = np.random.default_rng(0).normal(size=x.numel())
    try:
        function = ca.Function("places", [ca.vec(x)], [selected])
        found, probe = (np.array(function(point)) for point in (numbers, others))
    except (RuntimeError, NotImplementedError):  # Other symbols; reported below.
        found, probe = np.full((1, 1), -1.0), np.zeros((1, 1))
    known = bool(np.isin(found, numbers).all())
    places = found.astype(np.int64) if known else np.zeros((1, 1), dtype=np.int64)
    known = known and np.array_equal(others[places], probe)
    if not known or np.unique(places).size != places.size:
        raise InvalidProblemError(
            f"{role} must be {whose} that its cost or constraints use, got "
            f"{shortened(given)}"
        )
    return places


def _indices(role: str, given: object, size: int) -> Indices:
    """Return a table of indices, with at most two dimensions."""
    try:
        places = np.atleast_2d(np.array(given))
    except ValueError:
        places = np.empty((0, 0), dtype=np.float64)
    ok = places.ndim == 2 and places.size and np.issubdtype(places.dtype, np.integer)  # noqa: PLR2004
    if not ok or places.min() < 0 or places.max() >= size:
        raise InvalidProblemError(
            f"{role} must be an expression of nlp['x'] or a table (rows, times) of "
            f"indices from 0 to {size - 1}, got {shortened(given)}"
        )
    return places.astype(np.int64)


def _vector(values: ArrayLike, size: int) -> Array:
    """Return numbers as a vector, column by column; a single one fills all entries."""
    flat = np.array(values, dtype=np.float64).ravel(order="F")
    return np.broadcast_to(flat, (size,)).copy() if flat.size != size else flat


def arguments_of(
    nlp: Mapping[str, Any], given: Mapping[str, ArrayLike | None]
) -> dict[str, Array]:
    """Return the arguments of a solver; None means the default of `nlpsol`.

    Args:
        nlp: The dictionary.
        given: Values of x0, p, lbg, ubg, lbx, ubx.

    Raises:
        InvalidProblemError: If a value has the wrong size.
    """
    empty = ca.SX(0, 1)
    sizes = {"x0": "x", "p": "p", "lbg": "g", "ubg": "g", "lbx": "x", "ubx": "x"}
    missing = {"lbg": -np.inf, "lbx": -np.inf, "ubg": np.inf, "ubx": np.inf}
    found = {}
    for name, key in sizes.items():
        size, value = nlp.get(key, empty).numel(), given.get(name)
        if name == "p" and size and value is None:
            raise InvalidProblemError(f"expected p=, the values of {size} parameters")
        try:
            found[name] = _vector(
                missing.get(name, 0.0) if value is None else value, size
            )
        except (ValueError, TypeError) as error:
            raise InvalidProblemError(
                f"{name} must be a number or {size} numbers, got {shortened(value)}"
            ) from error
    return found


def _failed(status: str, begin: float) -> Run:
    """Return the record of a run that raised an error."""
    return Run(
        solution=None,
        x=None,
        status=status,
        iterations=0,
        seconds=time.perf_counter() - begin,
        success=False,
    )


def _opti_status(opti: ca.Opti, error: Exception) -> str:
    """Return the solver's status of a failure, or CasADi's error if it never ran."""
    if "return_status is" in str(error):  # CasADi's words if the solver has run.
        return str(opti.return_status())
    return last_line(error)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _tail(error: Exception, mark: str) -> str:
    return _one_line(str(error).partition(mark)[2])


def last_line(error: Exception) -> str:
    """Return the last line of CasADi's message, which states the error."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1].strip() if lines else type(error).__name__
