"""Linear controls with every other feature, against states written by hand."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from swarmstart.ocp.rollout.fitness import Arguments, core_known, replay
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.tests.ocp.feature_pairs.comparison import SAME, drawn_point
from swarmstart.tests.ocp.feature_pairs.features import FEATURES, drawn, go_together
from swarmstart.tests.ocp.feature_pairs.lines import with_lines
from swarmstart.tests.ocp.feature_pairs.peer import Peer

NAMES = [n for n in FEATURES if n not in ("free end time", "discrete time", "delay")]
"""A free end time is in test_control_shape.py; discrete time has no linear controls."""
PAIRS = [pair for pair in combinations(NAMES, 2) if go_together(*pair)]
SOME = np.random.default_rng(7).permutation(len(PAIRS))[:20]


@pytest.mark.parametrize(
    "names", [*[(name,) for name in NAMES], *[PAIRS[i] for i in SOME]], ids="+".join
)
def test_value_is_that_of_states_written_by_hand(names: tuple[str, ...]) -> None:
    stated = drawn(names, np.random.default_rng([len(names), *map(len, names)]))
    rng = np.random.default_rng(0)
    point, limits = drawn_point(stated, rng), np.clip(stated.limits, -2, 2)
    knot = rng.uniform(*limits)
    shooting = Shooting(replace(stated.problem(), control_shape="linear"))
    lowered = shooting.lowered
    start, places = lowered.start(point.x0), lowered.places
    start[places["decided"]] = point.decided
    start[places["knots"]] = np.tile(knot, 2)
    known = core_known(lowered, stated.known)
    weights = Arguments(shooting)(start, known)[1][lowered.core.model.np :]
    both = (float(weights[0]), float(weights[-1])) if weights.size else (0.0, 0.0)
    _, cost, violation = replay(shooting, point.controls, start, known)
    by_hand = point._replace(x0=np.concatenate([point.x0, knot, knot]))
    expected = Peer(with_lines(stated)).value(by_hand, both)[:2]
    np.testing.assert_allclose((cost, violation), expected, rtol=SAME, atol=SAME)
