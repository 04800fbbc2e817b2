"""An FMU is a plant like ours: the same bits, one state, and clear refusals."""

import gc
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.tests.simulators import pendulum
from swarmstart.tests.simulators.conftest import Built


class Torques:
    """A controller with given torques, and a start that it may decide."""

    dt = 0.1

    def __init__(self, torques: list[float], start: Array | None = None) -> None:
        self._torques, self._start = torques, start

    def decide(
        self, time: float, state: object, previous: object, *, rng: object
    ) -> ss.Decision:
        del state, previous, rng
        torque = self._torques[round(time / self.dt)]
        return ss.Decision(control=np.array([torque]), plans=(), start=self._start)


def opened(file: Path, **more: Any) -> ss.FmuPlant:
    """Return the pendulum's plant."""
    names = {"states": ["angle", "speed"], "controls": ["torque"]}
    return ss.FmuPlant(file, **{**names, **more})


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_readmes_loop_has_the_bits_of_our_own_plant(
    fmu: Built, version: str
) -> None:
    """Both integrate by the same steps; a second run on the same FMU, too."""
    plant = opened(fmu(version))
    ours = ss.Plant(pendulum.model(), dt=0.1, substeps=pendulum.SUBSTEPS)
    loop = pendulum.loop()
    first, theirs, again = (
        ss.simulate(one, loop, [0.0, 0.0], steps=12, seed=0)
        for one in (ours, plant, plant)
    )
    assert np.array_equal(theirs.states, first.states)
    assert np.array_equal(theirs.controls, first.controls)
    assert np.array_equal(again.states, first.states)
    assert theirs.state_names == ("angle", "speed")
    assert theirs.control_names == ("torque",)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_it_says_where_it_begins_its_units_and_bounds(fmu: Built, version: str) -> None:
    """They are those of its modelDescription.xml."""
    plant = opened(fmu(version))
    assert plant.start.tolist() == [0.25, 0.0]
    assert plant.units == {"angle": "rad", "speed": "rad/s", "torque": "N.m"}
    assert [bound.tolist() for bound in plant.bounds] == [[-5.0], [5.0]]
    assert plant.can_restore


def test_a_parameter_is_set_before_each_run(fmu: Built) -> None:
    """Without friction the energy at the same angle is the same."""
    free = opened(fmu(), parameters={"friction": 0.0})
    for _ in range(2):
        x = free.start_at([1.0, 0.0])
        energies = [-9.81 * np.cos(x[0])]
        for _ in range(50):
            x = free.step(x, [0.0], 0.1)
            energies.append(0.5 * x[1] ** 2 - 9.81 * np.cos(x[0]))
        assert np.ptp(energies) < 1e-5
    braked = opened(fmu())
    x = braked.start_at([1.0, 0.0])
    for _ in range(50):
        x = braked.step(x, [0.0], 0.1)
    assert 0.5 * x[1] ** 2 - 9.81 * np.cos(x[0]) < energies[0] - 1


def test_an_fmu_whose_states_cannot_be_set_begins_at_its_own_start(fmu: Built) -> None:
    """Another start is refused with what it has."""
    plant = opened(fmu(settable=False))
    assert plant.start_at(plant.start).tolist() == [0.25, 0.0]
    with pytest.raises(ss.SimulatorError, match=r"found angle = 0\.25 for 1$"):
        plant.start_at([1.0, 0.0])


def test_a_step_accepts_only_the_state_that_was_returned_last(fmu: Built) -> None:
    """The FMU keeps its own, and would go on from there."""
    plant = opened(fmu())
    with pytest.raises(ss.SimulatorError, match="start_at"):
        plant.step([0.25, 0.0], [0.0], 0.1)
    x = plant.start_at([0.25, 0.0])
    after = plant.step(x, [1.0], 0.1)
    with pytest.raises(ss.SimulatorError, match="expected the state that was returned"):
        plant.step(x, [1.0], 0.1)
    plant.step(after, [1.0], 0.1)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_failed_step_ends_a_run_and_the_next_one_is_whole(
    fmu: Built, version: str
) -> None:
    """The instance is replaced, since its memory may be damaged."""
    plant = opened(fmu(version))
    x = plant.start_at([0.5, 0.0])
    good = plant.step(x, [1.0], 0.1)
    with pytest.raises(ss.SimulatorError, match=r"failed to step at 0\.1 s"):
        plant.step(good, [pendulum.FAILS], 0.1)
    with pytest.raises(ss.SimulatorError, match="a failed step ends a run"):
        plant.step(good, [1.0], 0.1)
    again = plant.step(plant.start_at([0.5, 0.0]), [1.0], 0.1)
    assert np.array_equal(again, good)


def test_a_state_that_is_no_number_ends_a_flight_with_its_time(fmu: Built) -> None:
    """Our own plant does the same."""

    wild = Torques([1.0, 1.0, pendulum.NAN, 1.0])
    with pytest.raises(ss.DivergedError, match=r"step 2, at 0\.2 s"):
        ss.simulate(opened(fmu()), wild, [0.5, 0.0], steps=4, seed=0)


def test_a_start_that_a_controller_decides_is_that_of_the_fmu(fmu: Built) -> None:
    """A first plan may decide initial states; the FMU is put there."""
    torques = Torques([1.0, 1.0], start=np.array([0.75, 0.0]))
    run, same = (
        ss.simulate(opened(fmu()), one, x0, steps=2, seed=0)
        for one, x0 in ((torques, [0.5, 0.0]), (Torques([1.0, 1.0]), [0.75, 0.0]))
    )
    assert np.array_equal(run.states, same.states)


def test_a_step_that_the_fmu_ends_early_is_none(fmu: Built) -> None:
    """FMI 3.0 can return early, or end the simulation."""
    for flags, words in (((0, 1, 0), "ended the"), ((0, 0, 1), "returned early")):
        plant = opened(fmu("3.0"))
        x = plant.start_at([0.5, 0.0])
        plant._library._slave.doStep = lambda *_, found=flags: (*found, 0.05)
        with pytest.raises(ss.SimulatorError, match=f"{words}.* at 0.05 s"):
            plant.step(x, [1.0], 0.1)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            {"states": ["angel", "speed"]},
            r"states.*found 'angel'; did you mean 'angle'",
        ),
        ({"controls": ["angle"]}, r"controls .*among the inputs.*it has torque"),
        ({"parameters": {"mass": 1.0}}, r"parameters.*found 'mass'; it has friction"),
        ({"states": ["angle", "angle"]}, "each of the states once"),
    ],
)
def test_names_that_it_lacks_are_named_with_the_nearest(
    fmu: Built, more: dict[str, object], message: str
) -> None:
    """One sentence each."""
    with pytest.raises(ss.SimulatorError, match=message):
        opened(fmu(), **more)


@pytest.mark.parametrize("value", ["0.2", np.nan, None])
def test_a_parameter_is_a_number(fmu: Built, value: object) -> None:
    """Text is not converted."""
    with pytest.raises(ss.InvalidProblemError, match="parameters must be a mapping"):
        opened(fmu(), parameters={"friction": value})


@pytest.mark.parametrize(
    "u", [[np.nan], [np.inf], [1.0, 2.0]], ids=["nan", "inf", "two"]
)
def test_controls_that_are_no_numbers_never_reach_it(
    fmu: Built, u: list[float]
) -> None:
    """They are refused before the library is called, and the run goes on."""
    plant = opened(fmu())
    x = plant.start_at([0.5, 0.0])
    with pytest.raises(ss.SimulatorError, match="finite numbers as the controls"):
        plant.step(x, u, 0.1)
    plant.step(x, [1.0], 0.1)


def test_it_is_loaded_again_in_another_process(fmu: Built) -> None:
    """A copy by pickle has a library of its own, and the same bits."""
    plant = opened(fmu(), parameters={"friction": 0.1})
    copy = pickle.loads(pickle.dumps(plant))
    one, other = (p.step(p.start_at([0.5, 0.0]), [1.0], 0.1) for p in (plant, copy))
    assert np.array_equal(one, other)


def test_its_folder_goes_with_it(
    fmu: Built, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unpacked files are removed when the plant is closed, or no longer used."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    plant = opened(fmu())
    assert len(os.listdir(tmp_path)) == 1
    plant.close()
    assert not os.listdir(tmp_path)
    with pytest.raises(ss.SimulatorError, match="start_at"):
        plant.step(plant.start, [0.0], 0.1)
    plant = opened(fmu())
    del plant
    gc.collect()
    assert not os.listdir(tmp_path)


def test_a_closed_one_refuses_a_new_run(fmu: Built) -> None:
    """It does not call a library that is unloaded."""
    plant = opened(fmu())
    plant.close()
    with pytest.raises(ss.SimulatorError, match="closed"):
        plant.start_at([0.0, 0.0])
