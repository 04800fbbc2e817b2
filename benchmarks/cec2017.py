"""Own searches beside those of the package minionpy on CEC 2017, at small budgets.

    python benchmarks/cec2017.py [--write docs/measured/search_2017.md] [--seeds 2]

The functions are the 29 that the competition kept (without F2), in 10 and 30 variables.
An error is the least value within the budget less the optimum's, at least 1e-8. It is
taken at the end of the search, and after a local descent from there (L-BFGS-B,
gradients by differences, not counted), which represents the polish. Ranks are among all
searches on one function with one seed; ties share a rank.

Source: Awad, Ali, Liang, Qu and Suganthan (2016), Problem definitions and evaluation
criteria for the CEC 2017 special session; minionpy is by Muzakka et al. (2025),
arXiv:2511.18429.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds
from scipy.optimize import minimize as descend
from scipy.stats import rankdata

from swarmstart.arrays import Array
from swarmstart.benchmarks.anchors import PeerMissingError, cube, peer
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.heuristics import Initial, minimize

DIMENSIONS, BUDGETS = (10, 30), (2_000, 5_000, 20_000)
FUNCTIONS = (1, *range(3, 31))
LEAST = 1e-8
OWN = ("lshade", "cma")
RIVALS = ("ARRDE", "RCMAES", "RDEX")
HALVES = "lshade, then cma"
REFERENCE = "lshade"
SAME = 1e-4
"""Relative difference of errors that counts as equal after the descent."""
DESCENT = 50
"""Iterations of the descent."""
STEP = 1e-6
"""Step of the differences, in a box of width 200."""


class Counted:
    """A function of minionpy that keeps the least value within a budget."""

    def __init__(self, number: int, dim: int, budget: int) -> None:
        """Take a function of CEC 2017; F1 has number 1."""
        self._function = peer("minionpy").CEC2017Functions(number, dim)
        self._left, self.least = budget, np.inf
        self._optimum, self._best = 100.0 * number, np.zeros(dim)

    def __call__(self, population: Array) -> Array:
        """Return the values of columns (dim, size)."""
        return np.array(self.of_rows(population.T.tolist()))

    def of_rows(self, points: Sequence[Sequence[float]]) -> list[float]:
        """Return the values of points, as minionpy asks for them."""
        values: list[float] = self._function(points)
        counted = values[: max(self._left, 0)]
        self._left -= len(counted)
        if counted and min(counted) < self.least:
            self.least = min(counted)
            self._best = np.array(points[counted.index(self.least)])
        return values

    def errors(self) -> tuple[float, float]:
        """Return the error of the least value, and the error after a descent."""
        found = descend(
            self._with_gradient, self._best, jac=True, method="L-BFGS-B",
            bounds=Bounds(-100.0, 100.0), options={"maxiter": DESCENT},
        )  # fmt: skip
        after = min(float(found.fun), self.least)
        return self._above(self.least), self._above(after)

    def _above(self, value: float) -> float:
        return max(value - self._optimum, LEAST)

    def _with_gradient(self, x: Array) -> tuple[float, Array]:
        moved = np.vstack([x, x + STEP * np.eye(x.size)])
        value, *ahead = self._function(moved.tolist())
        return value, (np.array(ahead) - value) / STEP


class Run(NamedTuple):
    """One search of one function."""

    number: int
    dim: int
    budget: int
    seed: int

    def errors(self, search: str) -> tuple[float, float]:
        """Return the errors of a search, before and after a descent."""
        objective = Counted(self.number, self.dim, self.budget)
        if search in RIVALS:
            self._rival(search, objective)
        elif search == HALVES:
            self._halves(objective)
        else:
            minimize(
                objective, cube(self.dim, 100.0), algorithm=search,
                budget=self.budget, seed=self.seed,
            )  # fmt: skip
        return objective.errors()

    def _rival(self, name: str, objective: Counted) -> None:
        """Run a search of minionpy with its own settings."""
        peer("minionpy").Minimizer(
            objective.of_rows, [(-100.0, 100.0)] * self.dim, algo=name,
            maxevals=self.budget, seed=self.seed,
        ).optimize()  # fmt: skip

    def _halves(self, objective: Counted) -> None:
        """Run L-SHADE with half of the budget, and CMA-ES from its best."""
        box, rng = cube(self.dim, 100.0), np.random.default_rng(self.seed)
        half = self.budget // 2
        first = minimize(objective, box, algorithm="lshade", budget=half, rng=rng)
        begin = Initial(points=first.x[:, None])
        minimize(
            objective, box, algorithm="cma", budget=self.budget - half, rng=rng,
            initial=begin,
        )  # fmt: skip


SEARCHES = (*OWN, HALVES, *(f"{name} (minionpy)" for name in RIVALS))


def errors(dim: int, budget: int, seeds: int) -> Array:
    """Return the errors of all searches, (2, searches, functions * seeds)."""
    found = np.empty((2, len(SEARCHES), len(FUNCTIONS) * seeds))
    runs = [Run(f, dim, budget, s) for f in FUNCTIONS for s in range(seeds)]
    for column, run in enumerate(runs):
        for line, name in enumerate(SEARCHES):
            found[:, line, column] = run.errors(name.removesuffix(" (minionpy)"))
    return found


def ratios(found: Array) -> Array:
    """Return geometric means of errors, relative to those of the reference."""
    logarithms = np.log(found)
    away = logarithms - logarithms[SEARCHES.index(REFERENCE)]
    return np.asarray(np.exp(away.mean(axis=1)))


def ranks(found: Array) -> Array:
    """Return mean ranks, 1 for the least error."""
    return np.asarray(rankdata(found, axis=0).mean(axis=1))


def best(found: Array) -> Array:
    """Return for each search the fraction of runs in which it was the best."""
    nearest = found.min(axis=0) * (1 + SAME)
    return np.asarray((found <= nearest).mean(axis=1))


def tables(measured: Mapping[tuple[int, int], Array]) -> list[str]:
    """Return a table of ranks and one of ratios for each number of variables."""
    kinds: tuple[tuple[str, int, Callable[[Array], Array]], ...] = (
        ("mean rank", 0, ranks),
        (f"error in parts of {REFERENCE}'s, geometric mean", 0, ratios),
        ("mean rank after the descent", 1, ranks),
        ("part of the runs in which none is nearer after the descent", 1, best),
    )
    lines: list[str] = []
    for dim in DIMENSIONS:
        for title, when, kind in kinds:
            columns = [kind(measured[dim, budget][when]) for budget in BUDGETS]
            lines += [f"## {dim} variables: {title}", ""]
            lines += head("search", *(f"{budget:,}" for budget in BUDGETS))
            for line, name in enumerate(SEARCHES):
                lines.append(row(name, *(f"{one[line]:.2f}" for one in columns)))
            lines.append("")
    return lines[:-1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="2 by default")
    options = parser.parse_args(arguments)
    try:
        peer("minionpy")
    except PeerMissingError:
        parser.error(
            "the functions and the rivals are those of minionpy, which is not "
            "installed: pip install minionpy"
        )
    measured = {}
    for dim in DIMENSIONS:
        for budget in BUDGETS:
            measured[dim, budget] = errors(dim, budget, options.seeds)
            for found in measured[dim, budget]:
                print(dim, budget, ranks(found).round(2), flush=True)
    publish(tables(measured), options, TEXT.format(seeds=options.seeds))
    return 0


TEXT = """# Searches on CEC 2017 at small budgets

Made by `python benchmarks/cec2017.py --write docs/measured/search_2017.md` (`pip
install minionpy`), {seeds} seeds of each of the 29 functions, every search with its
defaults. An error is the least value found within the budget minus the optimal value.
The descent starts at the best point found and is L-BFGS-B with at most 50 iterations
and gradients by differences; its evaluations are not counted. Ranks are among the
searches of a table, 1 is best; differences of mean ranks below 0.6 are ties. "None is
nearer" counts the runs in which the error of the search exceeds the smallest error of
all searches by at most 1e-4 of the latter.

"""


if __name__ == "__main__":
    raise SystemExit(main())
