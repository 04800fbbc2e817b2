"""An NLP solved from the user's start and a searched one; the better answer is kept.

The states are eliminated (elimination.py), a population searches the controls by
roll-outs (warm_search.py), IPOPT polishes the best distinct points on the expanded NLP,
and the best of those is the second start of the user's own solver. The solver runs from
the second start only if that start promises a better answer than the user's own.

Answers are compared by the NLP's own f and g, not by the solver's report: feasible
before infeasible, with a row's excess relative to the size of its terms

    max(1, |bound|, max_j |J_ij x_j|),

then by the cost; ties go to the user's own start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NoReturn, cast

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import Stopwatch, stopwatch
from swarmstart.ocp.common.errors import InvalidProblemError, SolveError
from swarmstart.ocp.foreign_nlp.elimination import GivenNlp, eliminated
from swarmstart.ocp.foreign_nlp.warm_search import (
    Ranges,
    ranges_of,
    roll_out_of,
    starts,
)
from swarmstart.ocp.nlp.nlp_sources import Indices, Numbers, Run
from swarmstart.ocp.search.settings import SearchSettings

Winner = Literal["own start", "searched start"]

FEASIBLE = 1e-6
"""Largest excess of a row, relative to its terms, that counts as feasible."""
SAME_COST = 1e-6
"""Relative difference of costs (relative to 1 for small ones) that counts as a tie."""
_QUIET: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
    "error_on_fail": False,
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 60,  # More: up to 30 s of restorations.
}


@dataclass(frozen=True, kw_only=True, slots=True)
class StartOutcome:
    """Outcome of one of the two starts.

    Attributes:
        cost: Value of f; infinity if there is no answer.
        violation: Largest excess of a row of g or x over its bounds, relative to the
            size of its terms; infinity if there is no answer.
        status: The solver's own status, or the reason why it did not run.
        iterations: Iterations of the user's solver.
        seconds: Wall time [s]; for the searched start including the search.
    """

    cost: float
    violation: float
    status: str
    iterations: int
    seconds: float

    @property
    def feasible(self) -> bool:
        """True if every row is within its bounds, up to `FEASIBLE`."""
        return self.violation <= FEASIBLE and math.isfinite(self.cost)

    def __str__(self) -> str:
        """Return the outcome in one line."""
        if not math.isfinite(self.cost):
            return f"{self.status}, {self.seconds:.2f} s"
        return (
            f"cost {self.cost:.9g}, violation {self.violation:.1e}, {self.status}, "
            f"{self.iterations} iterations, {self.seconds:.2f} s"
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class WarmStartReport:
    """Report of a warm start: the winning start, and both outcomes.

    Attributes:
        winner: "own start" or "searched start".
        own: Outcome of the user's own start.
        searched: Outcome of the searched start.
        compile_seconds: Wall time for loading and compiling the search, which is not
            included in the other times [s].
    """

    winner: Winner
    own: StartOutcome
    searched: StartOutcome
    compile_seconds: float

    def __repr__(self) -> str:
        """Return both outcomes in three lines."""
        lines = [f"warm start: the {self.winner} won"]
        lines += [f"  own start: {self.own}", f"  searched start: {self.searched}"]
        return "\n".join(lines)


class WarmStartedSolver:
    """Solver of an Opti or a CasADi NLP, made by `warm_start`.

    It tries the user's own start and a searched one, and keeps the better answer.

    Attributes:
        report: Report of the last `solve`; None before the first.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> opti = ca.Opti()
        >>> x, u = opti.variable(1, 4), opti.variable(1, 3)
        >>> opti.subject_to(x[1:].T == x[:3].T + u.T)
        >>> opti.subject_to(x[0] == 0)
        >>> opti.subject_to(opti.bounded(-1, u, 1))
        >>> opti.minimize((x[3] ** 2 - 1) ** 2 + 0.1 * x[3])
        >>> opti.solver("ipopt", {"ipopt.print_level": 0, "print_time": False})
        >>> warm = ss.warm_start(opti, controls=[u], states=[x], budget=500)
        >>> warm
        WarmStartedSolver: 3 of 7 variables left, 0 of them states, 3 rows left
    """

    def __init__(
        self,
        nlp: GivenNlp,
        layouts: tuple[list[Indices], list[Indices]],
        asked: Sequence[tuple[Indices, float, float]],
        search: SearchSettings,
        seed: int | Sequence[int],
    ) -> None:
        """Eliminate the states.

        Args:
            nlp: The NLP.
            layouts: Possible arrangements in time of the states and of the controls.
            asked: Bounds for the search: (indices in x, lower, upper).
            search: Settings of the search.
            seed: Seed of each `solve`.
        """
        self.report: WarmStartReport | None = None
        self._nlp, self._layouts, self._asked = nlp, layouts, asked
        self._search, self._seed = search, seed
        self._polish: ca.Function | None = None
        numbers = nlp.source.numbers()
        self._equalities = _equalities(numbers)
        self._found, layout = eliminated(nlp, layouts[0], self._equalities)
        controls = _sequences(layouts[1], layout.shape[1])
        self._roll_out = roll_out_of(self._found, controls)
        self._ranges(numbers)

    def __reduce__(self) -> NoReturn:
        """Raise: the caller's Opti, or solver, cannot be sent to another process.

        Raises:
            InvalidProblemError: Always.
        """
        raise InvalidProblemError(
            "a WarmStartedSolver cannot be pickled: call warm_start in the process "
            "that solves"
        )

    def __repr__(self) -> str:
        """Return the sizes of the search, and the report if there is one."""
        found = self._found
        what = (
            f"WarmStartedSolver: {found.free.size} of {self._nlp.x.numel()} variables "
            f"left, {found.torn.size} of them states, {found.kept.size} rows left"
        )
        return what if self.report is None else f"{what}\n{self.report!r}"

    def solve(self) -> Any:
        """Solve from the own start and from a searched one.

        Returns:
            The better solution, in the form that `opti.solve()` or the dictionary's
            solver returns. The Opti then holds the winner's solution and initial
            values; if neither start leads to a solution, it holds the last values of
            the searched one, for `opti.debug`.

        Raises:
            SolveError: If neither start leads to a solution, with both reasons.
            InvalidProblemError: If the Opti's variables, cost or constraints have
                changed, or a parameter has no value.
        """
        source = self._nlp.source
        numbers = source.numbers()
        own = source.run(None)
        source.require_unchanged()
        first = self._judged(own, numbers)
        with stopwatch() as watch:
            x, run = self._best_candidate(numbers), None
            if x is not None and self._may_win(x, first, numbers):
                run = source.run(x)
            second = self._searched(run, x, numbers, watch)
        winner = _winner(first, second, own, run)
        if winner is None:
            raise SolveError(
                "neither start led to a solution: "
                f"own start: {first.status}; searched start: {second.status}"
            )
        if winner == "own start" and run is not None:
            source.restore(numbers.start)  # The Opti holds the searched solution.
        self.report = WarmStartReport(
            winner=winner,
            own=first,
            searched=second,
            compile_seconds=watch.compile_seconds,
        )
        return own.solution if winner == "own start" else cast(Run, run).solution

    def _ranges(self, numbers: Numbers) -> Ranges:
        return ranges_of(self._nlp, self._roll_out, numbers, self._asked)

    def _best_candidate(self, numbers: Numbers) -> Array | None:
        """Return the best polished candidate; None if none is finite."""
        equalities = _equalities(numbers)
        if not np.array_equal(equalities, self._equalities):
            raise InvalidProblemError(
                "the parameters have made equalities of inequalities, or the other way "
                "round: call warm_start again"
            )
        candidates = self._candidates(numbers)
        polished = [self._polished(x, numbers) for x in candidates]
        outcomes = [(*self._value(x, numbers), k) for k, x in enumerate(polished)]
        finite = [o for o in outcomes if np.isfinite(o[:2]).all()]
        if not finite:
            return None
        # Among feasible ones the cost decides.
        return polished[min(finite, key=lambda o: (max(o[1], FEASIBLE), o[0]))[2]]

    def _candidates(self, numbers: Numbers) -> list[Array]:
        return starts(
            self._roll_out,
            self._ranges(numbers),
            numbers,
            search=self._search,
            rng=np.random.default_rng(self._seed),  # Anew for each `solve`.
        )

    def _may_win(self, x: Array, own: StartOutcome, numbers: Numbers) -> bool:
        """Return whether a polished candidate is better than the own start's answer."""
        value = self._value(x, numbers)
        return not own.feasible or _is_better(value, (own.cost, own.violation))

    def _polished(self, x: Array, numbers: Numbers) -> Array:
        """Return IPOPT's answer from a candidate, on the expanded NLP."""
        nlp = self._nlp
        if self._polish is None:
            expressions = {"x": nlp.x, "p": nlp.p, "f": nlp.f, "g": nlp.g}
            self._polish = ca.nlpsol("warm_start", "ipopt", expressions, _QUIET)
        answer = self._polish(
            x0=x, p=numbers.p, lbg=numbers.lower_g, ubg=numbers.upper_g
        )
        return np.array(answer["x"]).ravel()

    def _value(self, x: Array, numbers: Numbers) -> tuple[float, float]:
        """Return the NLP's own cost and relative violation."""
        nlp = self._nlp
        rows = np.array(nlp.rows(x, numbers.p)).ravel()
        slopes = nlp.jacobian(x, numbers.p)
        entries, columns = slopes.sparsity().get_triplet()
        terms = np.abs(np.array(slopes.nonzeros()) * x[columns])
        size = np.ones(rows.size)
        np.maximum.at(size, entries, terms)  # A row has several entries.
        for bound in (numbers.lower_g, numbers.upper_g):
            size = np.maximum(size, np.where(np.isfinite(bound), np.abs(bound), 0.0))
        excess = np.maximum(numbers.lower_g - rows, rows - numbers.upper_g) / size
        if not np.isfinite(rows).all():
            return math.inf, math.inf
        return float(nlp.cost(x, numbers.p)), float(max(excess.max(initial=0.0), 0.0))

    def _judged(self, run: Run, numbers: Numbers) -> StartOutcome:
        """Return the outcome of a run, by the NLP's own functions."""
        cost, violation = (
            (math.inf, math.inf) if run.x is None else self._value(run.x, numbers)
        )
        return StartOutcome(
            cost=cost,
            violation=violation,
            status=run.status,
            iterations=run.iterations,
            seconds=run.seconds,
        )

    def _searched(
        self, run: Run | None, x: Array | None, numbers: Numbers, watch: Stopwatch
    ) -> StartOutcome:
        """Return the outcome of the searched start."""
        cost, violation, status, iterations = math.inf, math.inf, "", 0
        if run is not None:
            outcome = self._judged(run, numbers)
            cost, violation = outcome.cost, outcome.violation
            status, iterations = outcome.status, outcome.iterations
        elif x is not None:
            cost, violation = self._value(x, numbers)
            status = (
                "not better, so not solved"
                if violation <= FEASIBLE
                else "infeasible after its polish, so not solved"
            )
        else:
            status = "no roll-out of the search was finite"
        return StartOutcome(
            cost=cost,
            violation=violation,
            status=status,
            iterations=iterations,
            seconds=watch.seconds,
        )


def _sequences(layouts: Sequence[Indices], nodes: int) -> list[Indices]:
    """Return each control over time, by the layout whose times fit the nodes best."""
    apart = [abs(table.shape[1] - nodes) for table in layouts]
    return list(layouts[apart.index(min(apart))])


def _equalities(numbers: Numbers) -> Indices:
    return np.flatnonzero(numbers.lower_g == numbers.upper_g)


def _is_better(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Return whether (cost, violation) `one` wins; ties go to `other`."""
    if not np.isfinite(one).all():
        return False
    broken, broken_other = (max(v - FEASIBLE, 0.0) for _, v in (one, other))
    if broken or broken_other:
        return broken < broken_other
    margin = SAME_COST * max(1.0, abs(other[0]))
    return not math.isfinite(other[0]) or one[0] < other[0] - margin


def _winner(
    first: StartOutcome, second: StartOutcome, own: Run, run: Run | None
) -> Winner | None:
    """Return the winning start; None if neither has a solution."""
    if run is None or run.solution is None:
        return None if own.solution is None else "own start"
    if own.solution is None:
        return "searched start"
    values = [(outcome.cost, outcome.violation) for outcome in (second, first)]
    return "searched start" if _is_better(*values) else "own start"
