"""A part of a simulator is that simulator: the rest is held, and names are checked."""

import pickle

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array


class Tank:
    """A simulator that keeps three states, and adds what it is given."""

    state_names = ("level", "heat", "salt")
    control_names = ("inflow", "power")

    def __init__(self) -> None:
        self.x = np.zeros(3)
        self.u = np.zeros(2)

    def start_at(self, x: Array) -> Array:
        self.x = x.copy()
        return x

    def step(self, x: Array, u: Array, dt: float) -> Array:
        assert np.array_equal(x, self.x)
        self.u = u.copy()
        self.x = x + dt * np.array([u[0], u[1], 1.0])
        return self.x


def test_chosen_rows_have_their_own_order_and_others_are_held() -> None:
    tank = Tank()
    part = ss.SelectedPlant(
        tank, states=["salt", "level"], controls=["inflow"],
        start={"heat": 7.0}, held={"power": 3.0},
    )  # fmt: skip
    x = part.start_at([5.0, 1.0])
    assert x.tolist() == [5.0, 1.0] and tank.x.tolist() == [1.0, 7.0, 5.0]
    x = part.step(x, [2.0], 0.5)
    assert x.tolist() == [5.5, 2.0] and tank.u.tolist() == [2.0, 3.0]
    assert tank.x.tolist() == [2.0, 8.5, 5.5]
    x = part.step(x, [0.0], 0.5)  # The state that was not chosen goes on.
    assert tank.x.tolist() == [2.0, 10.0, 6.0]
    assert (part.state_names, part.control_names) == (("salt", "level"), ("inflow",))


def test_a_step_goes_on_from_the_last_state_only() -> None:
    part = ss.SelectedPlant(Tank(), states=["level"], controls=["inflow"])
    with pytest.raises(ss.SimulatorError, match=r"expected start_at\(\) before a step"):
        part.step([0.0], [1.0], 0.1)
    part.start_at([0.0])
    with pytest.raises(ss.SimulatorError, match="the state that was returned last"):
        part.step([1.0], [1.0], 0.1)
    with pytest.raises(ss.SimulatorError, match="expected 1 finite numbers"):
        part.step([0.0], [np.nan], 0.1)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (
            {"states": ["levels"]},
            "states of the simulator, found 'levels'; did you mean",
        ),
        ({"controls": ["x"]}, "controls of the simulator, found 'x'; it has inflow"),
        ({"start": {"heet": 1.0}}, "did you mean 'heat'"),
        ({"held": {"pwer": 1.0}}, "did you mean 'power'"),
    ],
)
def test_unknown_names_are_said(changed: dict[str, object], expected: str) -> None:
    given: dict[str, object] = {"states": ["level"], "controls": ["inflow"]}
    with pytest.raises(ss.SimulatorError, match=expected):
        ss.SelectedPlant(Tank(), **given | changed)  # type: ignore[arg-type]


def test_a_pickle_is_made_again() -> None:
    part = ss.SelectedPlant(Tank(), states=["salt"], controls=["power"])
    again = pickle.loads(pickle.dumps(part))
    assert again.state_names == ("salt",)
    assert again.start_at([2.0]).tolist() == [2.0]
