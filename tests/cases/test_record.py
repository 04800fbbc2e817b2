from __future__ import annotations

import json
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest

from swarmstart import ocp
from swarmstart.cases.models.unicycle import unicycle
from swarmstart.cases.record import (
    RecordError,
    load_partial,
    prepare_folder,
    remove_partial,
    save_partial,
    to_json,
    trajectory_arrays,
    write_atomically,
    write_json,
)
from swarmstart.cases.run import key_of
from swarmstart.cases.scenario import read_document, resolve
from swarmstart.ocp import (
    Decision,
    Mode,
    Plan,
    Plant,
    Source,
    Step,
    Trajectory,
    stack_models,
)

AGENTS, SUBSTEPS = 2, 3


def key(*assignments: str, seed: int = 0, name: str = "formation_v") -> str:
    return key_of(resolve(read_document(name), assignments=assignments), seed)


def test_the_key_depends_on_what_determines_the_result() -> None:
    keys = [
        key(),
        key(seed=1),
        key("steps=59"),
        key("search.size=21"),
        key("leader.x_m=31"),
        key("polish=ipopt"),
        key(name="formation_obstacle"),
    ]
    assert len(set(keys)) == len(keys)
    assert all(len(k) == 16 and set(k) <= set("0123456789abcdef") for k in keys)


def test_the_key_does_not_depend_on_what_is_only_told() -> None:
    assert key("claims=[]", "title=Mine", "source=here") == key()
    assert key("leader.x_m=60/2", "steps=60") == key()


def test_what_is_not_finite_becomes_null() -> None:
    content = {"a": float("nan"), "b": [float("inf"), 1.5, (float("-inf"),)], "c": "x"}
    assert json.loads(to_json(content)) == {
        "a": None,
        "b": [None, 1.5, [None]],
        "c": "x",
    }


def test_a_file_appears_whole_and_alone(tmp_path: Path) -> None:
    file = tmp_path / "deep" / "file.json"
    write_json(file, {"a": 1})
    assert json.loads(file.read_text()) == {"a": 1}
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failure_keeps_the_old_file_and_leaves_no_other(
    error: BaseException, tmp_path: Path
) -> None:
    file = tmp_path / "file"
    file.write_text("old")

    def fail(opened: BinaryIO) -> None:
        opened.write(b"new, but hal")
        raise error

    expected = RecordError if isinstance(error, OSError) else KeyboardInterrupt
    with pytest.raises(expected):
        write_atomically(file, fail)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_folder_is_made_and_tried_and_left_as_it_was(tmp_path: Path) -> None:
    prepare_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []
    (tmp_path / "file").touch()
    with pytest.raises(RecordError, match="expected a file to write to"):
        prepare_folder(tmp_path / "file")


def flight(count: int) -> Trajectory:
    """Return a flight of numbers without meaning."""
    rng = np.random.default_rng(0)
    decisions = tuple(
        Decision(
            control=rng.normal(size=4),
            plans=tuple(
                Plan(
                    controls=rng.normal(size=(2, 8)),
                    states=np.empty((0, 0)),
                    cost=rng.normal(),
                    violation=rng.normal(),
                    feasible=bool(rng.integers(2)),
                    source=list(Source)[rng.integers(len(Source))],
                    search_cost=np.nan if number else rng.normal(),
                    evaluations=int(rng.integers(100)),
                    search_history=rng.random(int(rng.integers(4))),
                )
                for number in range(AGENTS)
            ),
            mode=list(Mode)[step % 2],
        )
        for step in range(count)
    )
    dense = rng.normal(size=(8, count * SUBSTEPS + 1))
    return Trajectory(
        times=np.arange(count + 1.0),
        states=dense[:, ::SUBSTEPS],
        controls=np.stack([d.control for d in decisions], axis=1),
        dense_times=np.linspace(0.0, count, count * SUBSTEPS + 1),
        dense_states=dense,
        decisions=decisions,
        step_seconds=rng.random(count),
    )


def collected(steps: list[Step]) -> dict[str, Any]:
    model = stack_models([unicycle()] * AGENTS)
    plant = Plant(model, dt=1.0, substeps=SUBSTEPS)
    return trajectory_arrays(ocp.collected(plant, steps))


def test_a_partial_record_gives_back_every_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rng.random(7)
    save_partial(tmp_path, "key", flight(3), rng.bit_generator.state)
    kept = load_partial(tmp_path, "key", SUBSTEPS)
    assert kept is not None
    steps, state = kept
    again = np.random.default_rng()
    again.bit_generator.state = state
    assert again.random() == rng.random()
    found, written = collected(steps), trajectory_arrays(flight(3))
    for name, values in written.items():
        assert found[name].tobytes() == values.tobytes(), name


def test_the_mark_says_how_many_steps_count(tmp_path: Path) -> None:
    state = np.random.default_rng(0).bit_generator.state
    save_partial(tmp_path, "key", flight(2), state)
    mark = (tmp_path / "partial.json").read_bytes()
    save_partial(tmp_path, "key", flight(3), state)
    (tmp_path / "partial.json").write_bytes(mark)
    kept = load_partial(tmp_path, "key", SUBSTEPS)
    assert kept is not None and len(kept[0]) == 2


def test_a_partial_record_of_another_run_is_none(tmp_path: Path) -> None:
    state = np.random.default_rng(0).bit_generator.state
    assert load_partial(tmp_path, "key", SUBSTEPS) is None
    save_partial(tmp_path, "other", flight(2), state)
    assert load_partial(tmp_path, "key", SUBSTEPS) is None
    other_arrays = (tmp_path / "partial.npz").read_bytes()
    save_partial(tmp_path, "key", flight(2), state)
    (tmp_path / "partial.npz").write_bytes(other_arrays)
    assert load_partial(tmp_path, "key", SUBSTEPS) is None


def test_removing_a_partial_record_leaves_the_rest(tmp_path: Path) -> None:
    (tmp_path / "mine").touch()
    save_partial(tmp_path, "k", flight(1), np.random.default_rng(0).bit_generator.state)
    remove_partial(tmp_path)
    remove_partial(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize("broken", ["mark", "arrays", "no arrays", "no key"])
def test_a_broken_partial_record_is_an_error_that_says_what_to_do(
    broken: str, tmp_path: Path
) -> None:
    save_partial(tmp_path, "k", flight(2), np.random.default_rng(0).bit_generator.state)
    mark, arrays = tmp_path / "partial.json", tmp_path / "partial.npz"
    if broken == "mark":
        mark.write_text("{")
    elif broken == "arrays":
        arrays.write_bytes(arrays.read_bytes()[:-200])
    elif broken == "no arrays":
        arrays.unlink()
    else:
        mark.write_text("[]")
    with pytest.raises(RecordError, match="to start again"):
        load_partial(tmp_path, "k", SUBSTEPS)
