"""Pairs of features in random problems, against CasADi's Opti and SciPy.

    python benchmarks/feature_pairs.py
    python benchmarks/feature_pairs.py --pairs 400 --seeds 0 1 2

Each problem is drawn with two features and made twice: by swarmstart, and by multiple
shooting in Opti. The comparison covers cost and violation of three random points on
both backends (1e-9), the end and the cost of a finer path with DOP853, and the optimum
that IPOPT finds from one start (1e-6). The exit status is 3 if anything differs.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from itertools import islice

import numpy as np

from swarmstart.tests.ocp.feature_pairs.comparison import Compared, compared
from swarmstart.tests.ocp.feature_pairs.features import drawn, pairs


def judged(seed: int, count: int) -> list[Compared]:
    """Compare the first pairs of a seed, and print what differs.

    Args:
        seed: Seed of the order of the pairs, and of their numbers.
        count: Number of pairs.
    """
    found = []
    for number, names in enumerate(islice(pairs(np.random.default_rng(seed)), count)):
        rng = np.random.default_rng([seed, number])
        found.append(compared(drawn(names, rng), rng))
        for difference in found[-1].differences:
            print(f"seed {seed}, {number}: {' + '.join(names)}: {difference}")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare pairs; return 3 if anything differs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pairs", type=int, default=400)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    told = parser.parse_args(arguments)
    differing = 0
    for seed in told.seeds:
        begun = time.perf_counter()
        found = judged(seed, told.pairs)
        wrong = sum(bool(one.differences) for one in found)
        solved = sum(one.solved for one in found)
        differing += wrong
        print(
            f"seed {seed}: {len(found)} problems, {solved} with an optimum, {wrong} "
            f"differ, {time.perf_counter() - begun:.0f} s",
            flush=True,
        )
    return 3 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
