"""The stirred tank against do-mpc's cost, and its bound on other plants; short."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.benchmarks import stirred_tank
from swarmstart.benchmarks.stirred_tank import (
    BRANCHED,
    MANY,
    OURS,
    PEER_COST,
    THEIRS,
    TREE,
    Flight,
    Measured,
    bars,
    flights,
    main,
    nominal,
    report,
    robust,
    text,
)
from swarmstart.benchmarks.tank import HOTTEST, NOMINAL, PLANTS, rates, tank
from swarmstart.benchmarks.tank_tree import branching
from swarmstart.ocp import Controller, Model, RecedingHorizon

WORST = (0.95, 0.9)


@pytest.fixture(scope="module")
def model() -> Model:
    return tank()


@pytest.fixture(scope="module")
def one_sequence(model: Model) -> RecedingHorizon:
    return robust(model)


def test_the_nominal_cost_is_that_of_do_mpc(model: Model) -> None:
    flown = flights(model, {OURS: nominal(model)}, NOMINAL, 50)[OURS]
    assert flown.cost == pytest.approx(PEER_COST, rel=1e-4)
    assert flown.hottest < HOTTEST
    assert flown.feasible == 50


def test_only_the_ensemble_keeps_the_bound_of_a_hotter_plant(
    model: Model, one_sequence: RecedingHorizon
) -> None:
    controllers = {OURS: nominal(model), MANY: one_sequence}
    flown = flights(model, controllers, WORST, 16)
    assert flown[OURS].hottest > HOTTEST + 0.1
    assert flown[MANY].hottest < HOTTEST
    assert flown[MANY].feasible == 16


def test_a_tree_costs_less_than_one_sequence_for_all(
    model: Model, one_sequence: RecedingHorizon
) -> None:
    controllers: dict[str, Controller] = {MANY: one_sequence, BRANCHED: branching()}
    flown = flights(model, controllers, WORST, 3)
    assert flown[BRANCHED].feasible == 3
    assert flown[BRANCHED].cost < 0.9 * flown[MANY].cost
    # As do-mpc's tree, measured here.
    assert flown[BRANCHED].cost == pytest.approx(0.019686, rel=1e-2)
    assert flown[MANY].hottest < flown[BRANCHED].hottest < HOTTEST


def test_rates_are_those_of_the_wall_and_of_the_reactions() -> None:
    def still(states: list[float]) -> list[float]:
        """Return the rates without feed and heat."""
        x, u = ([ca.SX(v) for v in values] for values in (states, [0.0, 0.0]))
        return [float(rate) for rate in rates(x, u, (1.05, 1.1))]

    capacity = 0.9342 * 3.01
    # Without concentrations heat goes through the wall only.
    empty = still([0.0, 0.0, 134.14, 130.0])
    assert empty[:2] == [0, 0]
    assert empty[2] * capacity * 10.01 == pytest.approx(-empty[3] * 5.0 * 2.0)
    assert empty[3] > 0
    # B becomes C, which heats by 11 kJ/mol; A becomes B, which cools by 4.2 kJ/mol.
    both = still([0.8, 0.5, 134.14, 134.14])
    of_a, of_b = still([0.8, 0.0, 134.14, 134.14]), still([0.0, 0.5, 134.14, 134.14])
    assert of_b[2] == pytest.approx(-11 * of_b[1] / capacity)
    to_d = -of_a[0] - of_a[1]
    assert of_a[2] == pytest.approx((-4.2 * of_a[1] + 41.85 * to_d) / capacity)
    np.testing.assert_allclose(both, np.add(of_a, of_b))


def flown(cost: float, hottest: float, milliseconds: float) -> Flight:
    return Flight(cost, hottest, np.full(4, milliseconds / 1e3), 4)


def test_the_page_has_ratios_where_do_mpc_flew_and_none_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    alone = {OURS: flown(1.02, 139, 10), MANY: flown(2, 135, 60)}
    peers = {THEIRS: flown(1, 139, 20), TREE: flown(1.5, 140.03, 120)}
    both = alone | peers | {BRANCHED: flown(1.4, 139.99, 110)}
    search = flown(1.02, 139, 30)
    found = Measured(dict.fromkeys(PLANTS, both), [both, both], search)
    lines = "\n".join(report(found))
    assert "0.50 of do-mpc (flights: 0.50, 0.50)" in lines
    assert [bar.is_missed for bar in bars(found)] == [True, False, False]
    without = Measured(dict.fromkeys(PLANTS, alone), [alone], search)
    assert [bar.measured for bar in bars(without)] == [None, None, 135]
    assert "do-mpc" not in text(without).split("\n\n")[1]
    monkeypatch.setattr(stirred_tank, "version", lambda name: f"of {name}")
    finding = " ".join(text(found).split("\n\n")[1].split())
    assert "to 2e-02, and a step takes 0.50 of do-mpc's time" in finding
    assert "below 135.00 deg C" in finding
    assert "reaches 139.99 here and 140.03 in do-mpc." in finding


def test_without_do_mpc_it_says_so_and_flies_ours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stirred_tank, "has_peer", lambda: False)
    monkeypatch.setattr(stirred_tank, "PLANTS", (NOMINAL,))
    monkeypatch.setattr(stirred_tank, "robust", nominal)
    monkeypatch.setattr(stirred_tank, "branching", lambda: nominal(tank()))
    assert main(["--steps", "1", "--repeats", "1"]) == 0
    said = capsys.readouterr().out
    assert "do-mpc is not installed (pip install do-mpc)" in said
    assert "skipped" in said
