"""The shipped stirred tank: do-mpc's cost, and the effect of a hotter plant."""

import pytest

from swarmstart.cases.campaign.studies.library import run
from swarmstart.cases.format.scenario import shipped


def test_the_shipped_tank_costs_what_it_costs_with_do_mpc() -> None:
    flown = run("stirred_tank", seed=0)
    assert flown.measures["flown_cost"] == pytest.approx(0.0143020, rel=1e-4)
    assert all(claim["holds"] for claim in flown.claims)
    assert len(shipped()["stirred_tank"].read_text().splitlines()) <= 40


def test_a_hotter_plant_breaks_the_bound_of_the_nominal_controller() -> None:
    hotter = {"plant.parameters.alpha": 0.95, "plant.parameters.beta": 0.9}
    flown = run("stirred_tank", seed=0, settings=hotter)
    # The claim on the cost is not judged: it is of the plant that is planned with.
    assert [claim["holds"] for claim in flown.claims] == [None, False]
    assert flown.measures["hottest"] == pytest.approx(141.10, abs=0.02)
