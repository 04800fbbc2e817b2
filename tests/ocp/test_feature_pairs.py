"""Random problems with two features each, compared number by number with a peer.

Both sides are made from the same expressions: swarmstart's, and a multiple-shooting
programme in CasADi's Opti with another formulation of each feature. The longer form is
`benchmarks/feature_pairs.py`.
"""

from itertools import islice

import numpy as np
import pytest

from swarmstart.tests.ocp.feature_pairs.comparison import (
    compared,
    differing_steps,
)
from swarmstart.tests.ocp.feature_pairs.features import (
    FEATURES,
    MEETING,
    drawn,
    go_together,
    pairs,
)

SEED, COUNT = 5, 51
DRAWN = list(islice(pairs(np.random.default_rng(SEED)), COUNT))
CHOSEN = [*DRAWN, *(3 * MEETING)]  # A limit is not active in every draw.


@pytest.mark.parametrize(
    "number", range(len(CHOSEN)), ids=lambda k: " + ".join(CHOSEN[k])
)
def test_values_paths_and_optima_are_those_of_the_peer(number: int) -> None:
    rng = np.random.default_rng([SEED, number])
    found = compared(drawn(CHOSEN[number], rng), rng)
    assert not found.differences
    assert found.solved


@pytest.mark.parametrize(
    "name", [n for n in FEATURES if n != "stiff" and go_together("stiff", n)]
)
def test_steps_of_their_own_lengths_go_with_each_feature(name: str) -> None:
    rng = np.random.default_rng(SEED)
    assert not differing_steps(drawn(("stiff", name), rng), rng)


def test_drawn_pairs_have_every_feature_at_least_twice() -> None:
    told = [name for pair in DRAWN for name in pair]
    assert min(told.count(name) for name in FEATURES) >= 2
    assert len({frozenset(pair) for pair in DRAWN}) == COUNT
    assert all(go_together(*pair) for pair in CHOSEN)
