"""Coverage of the account's interval of the share of unseen optima.

    python benchmarks/unseen_share.py [--write docs/measured/unseen_share.md]
        [--only NAME]
        [--lanes 2000] [--draws 400] [--keep FOLDER]

Each problem is solved once from 2,000 random starts. 400 times, some of these are drawn
without replacement. The account of a draw is made as if there were no others, and its
interval is compared with the share of the other starts that ended elsewhere. Times are
not measured.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.benchmarks.lanes import of_instance, shipped
from swarmstart.benchmarks.problems import passing
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.benchmarks.unseen_ways import WAYS, laws, least_held
from swarmstart.ocp import IpoptOptions, Planner
from swarmstart.ocp.lanes.answers import (
    APART,
    LaneAnswers,
    distinct_optima,
    optimum_of,
    paths,
    some_of,
    unseen_share,
)
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts

ASKED = ("four_discs", "pendulum_on_cart", "lynx_and_hares")
CONTROLS = ("goddard_rocket", "two_stage_launch", "passing")
SIZES = (16, 40, 64, 256)
HELD = 0.9
"""Least fraction of the draws whose interval must contain the share."""
TEXT = """# The share of optima not seen

Made by `python benchmarks/unseen_share.py --write docs/measured/unseen_share.md`.

Of many random starts, the summary of [many starts](../answers.md#many-starts) states an
upper limit: of further random starts, at most this share would end in an optimum that
no start so far has found. Here each problem is solved from {lanes:,} starts. {draws}
times some of these starts, a *draw*, are taken at random. The limit is computed from
the draw alone: its answers are grouped into optima by comparing only the answers of the
draw. The limit is compared with three shares:

1. of all {lanes:,} starts, those whose optimum no start of the draw found, if answers
   are grouped by comparing all {lanes:,};
2. the same share of the starts that are not in the draw;
3. of the starts that are not in the draw, those whose path differs from each optimum of
   the draw by more than {apart} (root mean square of the states, relative to how far
   the best answer moves them). This is the share that the limit is about.

Starts that ended without an optimum are left out everywhere. In the table, "share not
drawn" (the second share) and "at most" (the limit) are means over the draws. The limit
is the upper end of a one-sided 95 % interval that begins at 0. "More alone" is the
share of a draw's starts that are the only ones in their optimum if grouped within the
draw, minus the same share if grouped within all {lanes:,}. The two can differ, since
answers about {apart} apart may be grouped differently. The last three columns are the
fractions of draws in which a share is below the limit.

Made on another machine, the rows of a problem may differ: every number by 0 % or 0.05,
whichever is more.

"""
WAYS_TEXT = """
## Ways to state it

With n1 optima found once and n2 found twice among n starts, each way states an upper
limit.

- Columns "problems, n": the fraction of draws of n starts in which the third share is
  below the limit, on the problem on which this fraction is smallest.
- Columns "laws, n": the same smallest fraction for multinomial distributions with known
  shares, 1,000 samples of each. There are up to {laws} of them: 2 to 1,000 equally
  likely optima; Zipf's; geometric; one frequent optimum with 1, 3 or 10 rare ones, each
  expected half a time to four times in a sample. The bootstrap is too slow for these.
- Columns "end, n": the mean limit on {asked}. Of two ways whose limits hold equally
  often, the one with the smaller limit is better.

The ways:

- *score*, which `solve` uses: the largest U with (n U - n1)^2 <= 1.645^2
  (n U (1 - U) + 2 n2), at least 3 / n: Wilson's (1927) way with the variance of Esty
  (1983).
- *n1 + 1.96 sd*: n1 / n + 1.96 sqrt(n1 + 2 n2) / n: used by earlier versions of
  `solve`.
- *Esty* (1983): n1 / n + 1.645 sqrt(n1 + 2 n2 - n1^2 / n) / n.
- *Wilson* (1927), *Clopper-Pearson* (1934): a binomial n1, without n2.
- *Chao and Jost* (2012): Esty's, with n1 / n replaced by (n1 / n) (n - 1) n1 / ((n - 1)
  n1 + 2 n2).
- *bootstrap*: 100 draws from the optima found and from Chao's number of others.

All limits but Wilson's and Clopper-Pearson's are set to at least 3 / n.

"""


class Held(NamedTuple):
    """Accounts of draws of one size, and the true shares.

    Attributes:
        problem: Its name.
        size: Starts in a draw.
        shares: Of each draw: of all, of those not drawn, and of these by the draw's own
            optima; shape (draws, 3).
        most: Way -> what it stated, shape (draws,).
        more: For each draw, the further starts that were alone, as a fraction of all.
    """

    problem: str
    size: int
    shares: Array
    most: Mapping[str, Array]
    more: Array

    def holds(self, way: str = "score") -> Array:
        """Return the fraction of draws whose interval contains each share, (3,)."""
        within = self.shares <= self.most[way][:, None] + 1e-12
        return np.asarray(within.mean(axis=0))


def solved(name: str, lanes: int) -> LaneAnswers:
    """Return the answers of lanes from random starts of a problem."""
    posed = of_instance(passing()) if name == "passing" else shipped(name)
    planner = Planner(posed.problem, search=None, polish=IpoptOptions())
    solver = LaneSolver(planner.fitness.shooting)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    starts = random_starts(solver.problem, lanes, np.random.default_rng(0))
    return solver(x0, *starts, known=known)


def kept(name: str, lanes: int, folder: Path | None) -> LaneAnswers:
    """Return the same; read from a folder if they are there, and written to it."""
    if folder is None:
        return solved(name, lanes)
    file = folder / f"{name}_{lanes}.npz"
    if not file.exists():
        found = solved(name, lanes)
        folder.mkdir(parents=True, exist_ok=True)
        parts = {one.name: getattr(found, one.name) for one in fields(found)}
        np.savez(file, **parts)
    with np.load(file) as read:
        return LaneAnswers(**read)


def held(name: str, answers: LaneAnswers, size: int, draws: int) -> Held:
    """Return the accounts of draws, and the true shares.

    Args:
        name: Name of the problem.
        answers: All answers.
        size: Starts in a draw.
        draws: Their number.
    """
    rng, number = np.random.default_rng(size), optimum_of(answers)
    shares, more = np.empty((draws, 3)), np.empty(draws)
    most = {way: np.empty(draws) for way in WAYS}
    for draw in range(draws):
        lanes = rng.choice(number.size, size, replace=False)
        optima = distinct_optima(some_of(answers, lanes))
        counts = [one.count for one in optima]
        found = number[lanes][number[lanes] >= 0]
        _, by_all = np.unique(found, return_counts=True)
        alone = counts.count(1) - int((by_all == 1).sum())
        more[draw] = alone / max(found.size, 1)
        others = np.setdiff1d(np.flatnonzero(number >= 0), lanes)
        new = ~np.isin(number[others], found)
        firsts = lanes[[one.lane for one in optima]]
        apart = _apart(answers, firsts, others)
        shares[draw] = new.sum() / (number >= 0).sum(), new.mean(), apart.mean()
        for way, state in WAYS.items():
            most[way][draw] = state(counts) if counts else unseen_share(counts).most
    return Held(name, size, shares, most, more)


def _apart(
    answers: LaneAnswers, firsts: NDArray[np.int64], others: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return which of the others are apart from each of the first, cheapest first."""
    if not firsts.size:
        return np.ones(others.size, dtype=bool)
    points = paths(answers, int(firsts[0]))
    near, far = points[firsts], points[others]
    squares = (far**2).sum(axis=1)[:, None] + (near**2).sum(axis=1)
    away = (squares - 2 * far @ near.T).min(axis=1) / points.shape[1]
    return np.asarray(away > APART**2)


def table(found: Iterable[Held]) -> list[str]:
    """Return a row for each size of draws of each problem."""
    lines = head(
        "problem", "starts", "share not drawn", "at most", "more alone",
        "first share below", "second share below", "third share below",
    )  # fmt: skip
    for one in found:
        lines.append(
            row(
                one.problem, str(one.size), f"{one.shares[:, 1].mean():.3f}",
                f"{one.most['score'].mean():.3f}", f"{one.more.mean():+.3f}",
                *(f"{part:.3f}" for part in one.holds()),
            )
        )  # fmt: skip
    return lines


def ways_table(found: Sequence[Held], draws: int) -> list[str]:
    """Return a row for each way to state the share.

    Args:
        found: Of all problems.
        draws: From each known law.
    """
    sizes = sorted({one.size for one in found})
    lines = head(
        "way",
        *(f"problems, {n}" for n in sizes),
        *(f"laws, {n}" for n in sizes),
        *(f"end, {n}" for n in sizes),
    )
    for name, way in WAYS.items():
        least, known, ends = [], [], []
        for n in sizes:
            of_size = [one for one in found if one.size == n]
            least.append(f"{min(one.holds(name)[2] for one in of_size):.3f}")
            is_slow = name == "bootstrap"
            known.append("-" if is_slow else f"{least_held(way, n, draws):.3f}")
            means = [one.most[name].mean() for one in of_size if one.problem in ASKED]
            ends.append(f"{np.mean(means):.3f}" if means else "-")
        lines.append(row(name, *least, *known, *ends))
    return lines


def bars(found: Iterable[Held]) -> list[Bar]:
    """Return what is asked for, and what was measured."""
    made = [
        Bar(
            f"{one.problem}, {one.size} starts: draws with the first share below",
            ">=",
            HELD,
            one.holds()[0],
        )
        for one in found
        if one.problem in ASKED and one.size == SIZES[-1]
    ]
    least = min(one.holds()[2] for one in found)
    text = "every problem and size: draws with the third share below"
    return [*made, Bar(text, ">=", HELD, least)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, compare, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--only", action="append", help="one problem")
    parser.add_argument("--lanes", type=int, default=2000)
    parser.add_argument("--draws", type=int, default=400)
    parser.add_argument("--keep", type=Path, help="a folder to keep answers in")
    options = parser.parse_args(arguments)
    found = list[Held]()
    for name in options.only or (*ASKED, *CONTROLS):
        answers = kept(name, options.lanes, options.keep)
        for size in SIZES:
            found.append(held(name, answers, size, options.draws))
            print(table(found)[-1], flush=True)
    said = WAYS_TEXT.format(laws=len(laws(SIZES[-1])), asked=", ".join(ASKED))
    lines = [
        *table(found),
        *said.splitlines(),
        *ways_table(found, 1000),
        "",
        *bar_table(bars(found)),
    ]
    above = TEXT.format(lanes=options.lanes, draws=options.draws, apart=APART)
    publish(lines[:-1], options, above)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
