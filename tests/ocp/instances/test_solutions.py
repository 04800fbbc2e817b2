"""Arrays of answers: each as a Solution, saved, read, as tables and figures."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.cases.record.files import RecordError, read_arrays, write_arrays
from swarmstart.errors import MissingPackageError
from swarmstart.ocp import (
    Free,
    InvalidProblemError,
    Known,
    OptimalControlProblem,
    Solutions,
    SolutionStatus,
    TransportDelay,
    solve,
    solve_many,
)
from swarmstart.ocp.instances import solve_many as module
from swarmstart.tests.ocp.instances.fakes import (
    FakeLanes,
    N,
    X,
    by_gains,
    double_integrator,
    parametric,
)

KNOWN = {"m": np.array([1.0, 2.0, 3.0, 4.0]), "w": np.zeros(N + 1)}


@pytest.fixture(scope="module")
def problem() -> OptimalControlProblem:
    return parametric()


@pytest.fixture(scope="module")
def found(problem: OptimalControlProblem) -> Solutions:
    """Four answers, of which the third instance is invalid."""
    x0s = np.array([[0.5, -0.5, np.nan, 1.0], [0.0, 0.0, 0.0, 1.0]])
    return solve_many(problem, x0s, known=KNOWN, seed=0, threads=1)


def test_each_is_a_solution(problem: OptimalControlProblem, found: Solutions) -> None:
    one = found[3]
    assert one.status is SolutionStatus.CONVERGED and one.problem is problem
    assert one.cost == pytest.approx(found.cost[3], rel=1e-9)
    np.testing.assert_allclose(one.controls, found.controls[:, :, 3], atol=1e-6)
    assert one.known.parameters.tolist() == [4.0]  # type: ignore[union-attr]
    assert found[-1].cost == one.cost and found[np.int64(3)].cost == one.cost
    assert one.multipliers is not None


def test_an_answer_of_lanes_is_polished_when_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fake = FakeLanes(lambda x0, guess: by_gains(x0, guess) + 0.01)
    monkeypatch.setattr(module, "lanes_of", lambda *given: fake)
    found = solve_many(double_integrator(), [[1.0, 2.0], [0.0, 0.0]], seed=0)
    assert set(found.status) == {SolutionStatus.FEASIBLE}
    polished = list(found)
    assert [one.status for one in polished] == [SolutionStatus.CONVERGED] * 2
    for number, one in enumerate(polished):
        best = solve(double_integrator(), found.data.x0[:, number], search=None, seed=0)
        assert one.cost == pytest.approx(best.cost, rel=1e-9)
        assert one.cost < found.cost[number]


@pytest.mark.parametrize("number", ["0", 1.0, True, slice(0, 2), None])
def test_only_an_integer_is_a_number(found: Solutions, number: Any) -> None:
    with pytest.raises(InvalidProblemError, match="the number of an instance"):
        found[number]


def test_numbers_beyond_the_last_end_the_loop(found: Solutions) -> None:
    with pytest.raises(IndexError, match="there are 4 instances, asked for 4"):
        found[4]
    with pytest.raises(IndexError, match="asked for -5"):
        found[-5]


def test_summary_counts_and_names(found: Solutions) -> None:
    told = repr(found)
    assert told.startswith("Solutions of 4 instances in ")
    assert "3 CONVERGED: a local optimum" in told and "1 INVALID" in told
    assert "(instance 3)" in told and "instance 2: x0 must be finite" in told


def assert_equal(one: Solutions, other: Solutions) -> None:
    for name in (
        "status",
        "cost",
        "excess",
        "controls",
        "states",
        "solver",
        "attempts",
    ):
        mine, yours = getattr(one, name), getattr(other, name)
        np.testing.assert_array_equal(mine, yours, err_msg=name)


def test_saved_answers_are_read_again(
    problem: OptimalControlProblem, found: Solutions, tmp_path: Path
) -> None:
    file = found.save(tmp_path / "folder" / "answers.npz")
    again = Solutions.load(file, problem)
    assert_equal(found, again)
    assert again.invalid == found.invalid and again.seconds == found.seconds
    assert again.how == found.how
    assert again[0].cost == found[0].cost
    with pytest.raises(RecordError, match="expected the name of a new file"):
        found.save(file)
    assert found.save(file, force=True) == file


@pytest.mark.parametrize(
    "given",
    [
        {"horizon": Free(0.5, 2)},
        {"control_shape": "linear"},
        {"features": [TransportDelay({"u": 0.2})]},
        {"start": {"place": Free(-1, 1)}},
    ],
    ids=["free end", "linear", "delay", "free start"],
)
def test_answers_with_decisions_are_read_again(
    given: dict[str, Any], tmp_path: Path
) -> None:
    problem = double_integrator(**given)
    x0s = [[np.nan if "start" in given else 0.3, 0.4], [0.0, 1.0]]
    known = Known(previous=[0.1])
    # The polish alone, whose answers are those of the polish again.
    found = solve_many(problem, x0s, known=known, lanes=False, seed=0, threads=1)
    assert found.is_confirmed.all()
    again = Solutions.load(found.save(tmp_path / "answers.npz"), problem)
    assert_equal(found, again)
    for name, row in found.decided.items():
        np.testing.assert_array_equal(again.decided[name], row)
    first = again[0]
    np.testing.assert_allclose(first.cost, found.cost[0], rtol=1e-7)
    np.testing.assert_allclose(first.controls, found.controls[..., 0], atol=1e-5)
    np.testing.assert_allclose(first.states, found.states[..., 0], atol=1e-5)


def test_answers_can_be_sent_to_another_process(found: Solutions) -> None:
    again = pickle.loads(pickle.dumps(found))
    assert_equal(found, again)
    assert again[0].cost == pytest.approx(found[0].cost, rel=1e-9)


REFUSED = r"expected answers that Solutions\.save"
Arrays = dict[str, NDArray[Any]]
FORGED: dict[str, tuple[Arrays, str]] = {
    "another format": ({"format": np.array("other")}, "expected the format"),
    "a sample of less than none": ({"sampled": np.array(-5)}, "expected a sample"),
    "other names": (
        {"state_names": np.array(["a", "b"])},
        "expected the state names x_0, x_1, found a, b",
    ),
    "other parameter": ({"parameter_names": np.array(["q"])}, "found q"),
    "short row": ({"cost": np.zeros(3)}, r"cost has shape \(3,\).*shape \(4,\)"),
    "text for numbers": ({"cost": np.array(["a"] * 4)}, "cost has .*type <U1"),
    "wrong states": ({"states": np.zeros((2, 3, 4))}, "the array states has shape"),
    "unknown status": ({"status": np.array(["DONE"] * 4)}, "DONE"),
    "data of another shape": ({"x0": np.zeros(4)}, "not enough values"),
    "three states": ({"x0": np.zeros((3, 4))}, "x0 has 3 rows for 2 states"),
    "reasons missing": (
        {"reasons": np.array([], dtype="U")},
        "array reasons has shape",
    ),
    "seed": ({"seed": np.array(["x"])}, "invalid literal"),
    "negative seed": ({"seed": np.array(["-1"])}, "non-negative"),
    "time": ({"time": np.array(np.nan)}, "time must be a finite number"),
    "no such instance": ({"invalid": np.array([7])}, "the status INVALID, found"),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_files_are_refused_with_one_message(
    name: str, problem: OptimalControlProblem, found: Solutions, tmp_path: Path
) -> None:
    changed, told = FORGED[name]
    file = found.save(tmp_path / "answers.npz")
    write_arrays(file, read_arrays(file) | changed)
    with pytest.raises(RecordError, match=told) as raised:
        Solutions.load(file, problem)
    assert str(raised.value).startswith(f"{file}: expected answers that Solutions.save")


@pytest.mark.parametrize("name", ["controls", "status", "seconds", "signals", "x0"])
def test_missing_arrays_are_named(
    name: str, problem: OptimalControlProblem, found: Solutions, tmp_path: Path
) -> None:
    file = found.save(tmp_path / "answers.npz")
    arrays = read_arrays(file)
    del arrays[name]
    write_arrays(file, arrays)
    with pytest.raises(RecordError, match=f"the array {name} is missing"):
        Solutions.load(file, problem)


def test_nothing_is_unpickled(
    problem: OptimalControlProblem, found: Solutions, tmp_path: Path
) -> None:
    file = found.save(tmp_path / "answers.npz")
    arrays = read_arrays(file) | {"status": np.array([print] * 4, dtype=object)}
    np.savez(file, allow_pickle=True, **arrays)
    with pytest.raises(RecordError, match=REFUSED):
        Solutions.load(file, problem)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04"])
def test_other_files_are_refused(
    content: bytes, problem: OptimalControlProblem, tmp_path: Path
) -> None:
    file = tmp_path / "answers.npz"
    file.write_bytes(content)
    with pytest.raises(RecordError, match=REFUSED):
        Solutions.load(file, problem)
    with pytest.raises(RecordError, match=REFUSED):
        Solutions.load(tmp_path / "none.npz", problem)


def test_table_has_a_row_for_each_instance(found: Solutions) -> None:
    pytest.importorskip("pandas")
    table = found.to_dataframe()
    assert len(table) == 4 and table.index.name == "instance"
    assert table["status"].tolist() == [
        "CONVERGED",
        "CONVERGED",
        "INVALID",
        "CONVERGED",
    ]
    assert table["known m"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert table["x0 x_0"].tolist()[3] == 1.0
    assert table["cost"].tolist()[3] == found.cost[3]


def test_dataset_has_instances_times_and_names(found: Solutions) -> None:
    pytest.importorskip("xarray")
    data = found.to_xarray()
    assert dict(data.sizes) == {
        "instance": 4, "time": N + 1, "state": 2, "interval": N, "control": 1,
    }  # fmt: skip
    states = data["states"].sel(instance=1, state="x_0")
    np.testing.assert_array_equal(states, found.states[0, :, 1])
    assert float(data["cost"][3]) == found.cost[3]


@pytest.mark.parametrize("way", ["to_dataframe", "to_xarray"])
def test_missing_packages_are_named(
    way: str, found: Solutions, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = {"to_dataframe": "pandas", "to_xarray": "xarray"}[way]
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(MissingPackageError, match=rf"swarmstart\[{package}\]"):
        getattr(found, way)()


def test_figure_shows_costs_and_failures(found: Solutions) -> None:
    figure = found.plot()
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x_0", "x_1")
    shown = axes.collections[0]
    np.testing.assert_array_equal(shown.get_offsets(), found.data.x0.T[[0, 1, 3]])
    np.testing.assert_array_equal(shown.get_array(), found.cost[[0, 1, 3]])
    assert axes.collections[1].get_label() == "not solved: 1"


def test_figure_of_one_varied_number_has_the_cost_on_its_axis() -> None:
    found = solve_many(double_integrator(), [[0.0, 1.0], [0.5, 0.5]], seed=0, threads=1)
    axes = found.plot().axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("place", "cost")
    shown = axes.collections[0].get_offsets()
    np.testing.assert_array_equal(shown, np.stack([[0.0, 1.0], found.cost], axis=1))
    same = solve_many(double_integrator(), [[1.0, 1.0], [0.5, 0.5]], seed=0, threads=1)
    assert same.plot().axes[0].get_xlabel() == "instance"


def test_states_lead_from_the_start_to_the_end(found: Solutions) -> None:
    good = found.is_confirmed
    np.testing.assert_array_equal(found.states[:, 0, good], found.data.x0[:, good])
    assert found.times.shape == (N + 1,) and X.numel() == found.states.shape[0]
