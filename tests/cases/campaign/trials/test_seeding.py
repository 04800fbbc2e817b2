"""Seeds of a scenario's disturbances, raised by the number of the run."""

from typing import Any

from swarmstart.cases.campaign.trials.flight_trial import seed_keys, seeded
from swarmstart.cases.format.scenario import read_document, resolve

GUSTY = "plant={gusts: {sigma_ft_s: 3, length_ft: 600, seed: 7}}"


def test_run_0_is_the_scenario_and_run_3_has_other_gusts_and_nothing_else() -> None:
    settings = resolve(read_document("close_formation"), assignments=[GUSTY]).settings
    assert seed_keys(settings) == ["plant.gusts.seed"]
    assert seeded(settings, 0) == settings
    changed: Any = seeded(settings, 3)
    assert changed["plant"]["gusts"]["seed"] == 10
    changed["plant"]["gusts"]["seed"] = 7
    assert changed == settings
    assert settings["plant"]["gusts"]["seed"] == 7


def test_what_is_called_seed_and_is_no_whole_number_stays() -> None:
    settings: dict[str, Any] = {
        "plant": [{"seed": "x"}, {"seed": True}, {"seed": 1}],
        "claims": [{"when": {"seed": 4}}],
    }
    assert seed_keys(settings) == ["plant.2.seed"]
    assert seeded(settings, 1) == {
        **settings,
        "plant": [*settings["plant"][:2], {"seed": 2}],
    }


def test_a_scenario_without_randomness_has_no_seeds() -> None:
    assert not seed_keys(resolve(read_document("formation_v")).settings)
