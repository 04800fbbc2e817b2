"""Nothing false is certified: samples of the sets, and levels that are refuted.

It is the short form of `benchmarks/terminal_sets.py`, which simulates a million states
of each system.
"""

from __future__ import annotations

import numpy as np
import pytest

from swarmstart.benchmarks.terminal_set_systems import SYSTEMS
from swarmstart.benchmarks.terminal_sets import certified, violations_of
from swarmstart.terminal_set import TerminalSet, continuous_change, prove_level

TOO_SLOW = {"close formation, 6 states", "cart and pole"}
NAMES = [name for name in SYSTEMS if name not in TOO_SLOW]
SAMPLES = 10_000
UNREFUTED = {"tank"}
"""Beyond the set it is the model that ends: no state refutes the next level."""


@pytest.fixture(scope="module", params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def terminal_set(name: str) -> TerminalSet:
    return certified(SYSTEMS[name](), 60.0)


def test_states_of_a_certified_set_do_what_it_promises(
    name: str, terminal_set: TerminalSet
) -> None:
    rng = np.random.default_rng(3)
    assert violations_of(SYSTEMS[name](), terminal_set, SAMPLES, rng) == 0


def test_proven_and_refuted_levels_meet_within_two_percent(
    terminal_set: TerminalSet,
) -> None:
    """The level is that of the bounds if nothing is refuted within them."""
    certificate = terminal_set.certificate
    assert certificate is not None and certificate.proof.proven
    assert certificate.gap is None or certificate.gap <= 0.02


@pytest.mark.parametrize(
    "name",
    [name for name in NAMES if SYSTEMS[name]().dt is None and name not in UNREFUTED],
)
def test_from_the_refuted_level_on_nothing_is_proven(name: str) -> None:
    """Of inputs that move all the time; for the others the margin is measured."""
    system = SYSTEMS[name]()
    terminal_set = certified(system, 60.0)
    certificate = terminal_set.certificate
    assert certificate is not None and certificate.refutation is not None
    change = continuous_change(system.dynamics, terminal_set, Q_m=certificate.Q_m)
    for share in (1.000001, 1.02, 1.2):
        above = prove_level(
            change,
            share * certificate.refutation.alpha,
            max_boxes=20_000,
        )
        assert not above.proven
