"""Aircraft of JSBSim follow commands, repeat their bits, and refuse what fails."""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.simulators.aircraft import STATES

pytest.importorskip("jsbsim")
START = np.array([222.0, 0.5, 4572.0, 100.0, -50.0])


def flown(plant: ss.AircraftPlant, start: Array, u: Array, seconds: int) -> Array:
    """Return the states at each second."""
    x = plant.start_at(start)
    states = [x]
    for _ in range(seconds):
        x = plant.step(x, u, 1.0)
        states.append(x)
    return np.array(states).T


@pytest.fixture(scope="module")
def level() -> Array:
    """Return a flight with the set points of its start."""
    plant = ss.AircraftPlant()
    return flown(plant, START, START[:3], 30)


def test_a_trimmed_aircraft_stays_in_straight_flight(level: Array) -> None:
    """Speed, heading and height are kept; the place moves along the heading."""
    assert np.abs(level[0] - 222).max() < 0.5
    assert np.abs(level[1] - 0.5).max() < 1e-3
    assert np.abs(level[2] - 4572).max() < 1.0
    along = level[3:, -1] - START[3:]
    assert np.allclose(
        along, 30 * 222 * np.array([np.cos(0.5), np.sin(0.5)]), rtol=5e-3
    )


def test_it_reaches_its_set_points_as_measured() -> None:
    """Time constants of speed, heading and height: 1.7, 5.5 and 4.7 s."""
    plant = ss.AircraftPlant()
    for row, by, constant in ((0, 10.0, 1.7), (1, 0.2, 5.5), (2, 20.0, 4.7)):
        u = START[:3].copy()
        u[row] += by
        share = (flown(plant, START, u, 60)[row] - START[row]) / by
        assert abs(share[-1] - 1) < 0.05
        reached = int(np.argmax(share > 1 - np.exp(-1)))
        assert abs(reached - constant) <= 1.5


def test_a_speed_beyond_the_thrust_leaves_nothing_behind() -> None:
    """The throttle's integral rests at its bounds, else the return would be late."""
    plant = ss.AircraftPlant()
    x = plant.start_at(START)
    for speed, seconds in ((600.0, 60), (222.0, 60)):
        for _ in range(seconds):
            x = plant.step(x, [speed, *START[1:3]], 1.0)
    assert abs(x[0] - 222) < 2


def test_several_fly_as_each_alone(level: Array) -> None:
    """They share nothing, and a second flight has the same bits."""
    plant = ss.AircraftPlant(count=2)
    assert plant.state_names[:5] == tuple(f"{name}_1" for name in STATES)
    other = START + np.array([10.0, 0.3, 0.0, 500.0, 0.0])
    both = np.concatenate([START, other])
    u = np.concatenate([START[:3], other[:3] + np.array([0.0, 0.4, 0.0])])
    first, again = (flown(plant, both, u, 30) for _ in range(2))
    assert np.array_equal(first[:5], level)
    assert np.array_equal(first, again)


def test_a_copy_by_pickle_flies_alike(level: Array) -> None:
    """It loads its aircraft again."""
    copy = pickle.loads(pickle.dumps(ss.AircraftPlant()))
    assert np.array_equal(flown(copy, START, START[:3], 30), level)


def test_a_heading_goes_on_beyond_a_full_turn() -> None:
    """JSBSim gives headings in [0, 2 pi); a controller needs them without a jump."""
    plant = ss.AircraftPlant()
    start = START.copy()
    start[1] = 2 * np.pi - 0.1
    u = start[:3] + np.array([0.0, 0.4, 0.0])
    states = flown(plant, start, u, 20)
    assert states[1, -1] > 2 * np.pi + 0.1
    assert np.abs(np.diff(states[1])).max() < 0.1


def test_what_cannot_be_flown_is_refused_with_what_to_try() -> None:
    """Too slow, an unknown aircraft, a step between two of JSBSim, another state."""
    plant = ss.AircraftPlant()
    with pytest.raises(ss.SimulatorError, match=r"cannot be trimmed .* at 40 m/s"):
        plant.start_at([40.0, 0.0, 12000.0, 0.0, 0.0])
    with pytest.raises(ss.SimulatorError, match="no such aircraft"):
        ss.AircraftPlant("f99")
    x = plant.start_at(START)
    with pytest.raises(ss.SimulatorError, match="whole periods"):
        plant.step(x, START[:3], 0.01)
    after = plant.step(x, START[:3], 0.1)
    with pytest.raises(ss.SimulatorError, match="returned last"):
        plant.step(x, START[:3], 0.1)
    with pytest.raises(ss.SimulatorError, match="finite numbers as the set points"):
        plant.step(after, [np.nan, 0.0, 0.0], 0.1)
    with pytest.raises(ss.SimulatorError, match="finite numbers as the state"):
        plant.start_at([np.inf, 0.0, 4572.0, 0.0, 0.0])
    with pytest.raises(ss.InvalidProblemError, match="bank_max"):
        ss.Autopilot(bank_max=float("nan"))


def test_no_file_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some aircraft name files of their own, here JSBout172B.csv."""
    monkeypatch.chdir(tmp_path)
    plant = ss.AircraftPlant("c172x")
    x = plant.start_at([60.0, 0.0, 1000.0, 0.0, 0.0])
    plant.step(x, [60.0, 0.0, 1000.0], 1.0)
    assert not list(tmp_path.iterdir())


def test_nothing_is_printed() -> None:
    """JSBSim greets on standard output, the place of a run's JSON, and trims aloud."""
    script = (
        f"import swarmstart as ss\nss.AircraftPlant().start_at({START.tolist()})\n"
        "try:\n    ss.AircraftPlant('c172x').start_at([150, 0, 3000, 0, 0])\n"
        "except ss.SimulatorError:\n    pass\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, check=True, timeout=300
    )
    assert done.stdout == b""
