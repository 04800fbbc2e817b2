"""Finished steps are kept bit for bit, and refused when a bit has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart import ocp
from swarmstart.cases.kinds.planar import unicycle
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.partial import (
    load_partial,
    partial_key,
    remove_partial,
    save_partial,
)
from swarmstart.cases.record.trajectory_arrays import trajectory_arrays
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
STACKED = stack_models([unicycle()] * AGENTS)


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
                    search=ocp.SearchReport(
                        cost=np.nan if number else rng.normal(),
                        history=rng.random(searched := int(rng.integers(4))),
                        evaluations=np.arange(1.0, searched + 1.0),
                        violations=np.arange(0.0, searched),
                    ),
                    evaluations=int(rng.integers(100)),
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
        state_names=STACKED.state_names,
        control_names=STACKED.control_names,
    )


def collected(steps: list[Step]) -> dict[str, Any]:
    plant = Plant(STACKED, dt=1.0, substeps=SUBSTEPS)
    return trajectory_arrays(ocp.collected(plant, steps))


def test_a_partial_record_gives_back_every_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rng.random(7)
    save_partial(tmp_path, "key", flight(3), rng.bit_generator.state)
    kept = load_partial(tmp_path, "key", SUBSTEPS)
    assert kept is not None
    steps, state, multipliers = kept
    assert not multipliers
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


def test_a_folder_tells_whose_steps_it_keeps(tmp_path: Path) -> None:
    assert partial_key(tmp_path) is None
    save_partial(tmp_path, "k", flight(1), np.random.default_rng(0).bit_generator.state)
    assert partial_key(tmp_path) == "k"
    (tmp_path / "partial.json").unlink()  # As if killed before it was written.
    assert partial_key(tmp_path) == "k"
    assert load_partial(tmp_path, "k", SUBSTEPS) is None
    (tmp_path / "partial.npz").write_bytes(b"")
    with pytest.raises(RecordError, match="to start again"):
        partial_key(tmp_path)


def test_arrays_behind_the_mark_are_refused(tmp_path: Path) -> None:
    state = np.random.default_rng(0).bit_generator.state
    save_partial(tmp_path, "k", flight(2), state)
    arrays = (tmp_path / "partial.npz").read_bytes()
    save_partial(tmp_path, "k", flight(3), state)
    (tmp_path / "partial.npz").write_bytes(arrays)
    with pytest.raises(RecordError, match="2 of 3 steps"):
        load_partial(tmp_path, "k", SUBSTEPS)


def test_no_flipped_bit_of_the_mark_is_accepted(tmp_path: Path) -> None:
    save_partial(tmp_path, "k", flight(2), np.random.default_rng(0).bit_generator.state)
    mark = tmp_path / "partial.json"
    whole = mark.read_bytes()
    for place in range(len(whole)):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        mark.write_bytes(flipped)
        with pytest.raises(RecordError, match="to start again"):
            load_partial(tmp_path, "k", SUBSTEPS)


def test_no_flipped_bit_of_the_arrays_changes_what_is_loaded(tmp_path: Path) -> None:
    """Some of a zip archive's bits say nothing, such as its dates."""
    save_partial(tmp_path, "k", flight(2), np.random.default_rng(0).bit_generator.state)
    file = tmp_path / "partial.npz"
    whole, written = file.read_bytes(), trajectory_arrays(flight(2))
    chance = np.random.default_rng(1)
    refused = 0
    for place in chance.choice(len(whole), 300, replace=False):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(chance.integers(8))
        file.write_bytes(flipped)
        try:
            kept = load_partial(tmp_path, "k", SUBSTEPS)
        except RecordError:
            refused += 1
            continue
        assert kept is not None
        for name, values in written.items():
            assert collected(kept[0])[name].tobytes() == values.tobytes(), name
    assert refused > 200


def test_arrays_that_were_edited_are_refused(tmp_path: Path) -> None:
    save_partial(tmp_path, "k", flight(2), np.random.default_rng(0).bit_generator.state)
    file = tmp_path / "partial.npz"
    with np.load(file, allow_pickle=False) as opened:
        arrays: dict[str, Any] = dict(opened)
    arrays["states"] = arrays["states"] + 1e-9
    np.savez(file, **arrays)
    with pytest.raises(RecordError, match="a wrong checksum"):
        load_partial(tmp_path, "k", SUBSTEPS)


def test_steps_of_one_plan_are_of_one_plan_again(tmp_path: Path) -> None:
    whole = flight(3)
    first, second, third = whole.decisions
    flown_on = ocp.Decision(
        control=second.control, plans=(first.plans[0], second.plans[1])
    )
    decisions = (first, flown_on, third)
    steps = Trajectory(
        **{name: getattr(whole, name) for name in ARRAYS}, decisions=decisions
    )
    state = np.random.default_rng(0).bit_generator.state
    save_partial(tmp_path, "k", steps, state)
    kept = load_partial(tmp_path, "k", SUBSTEPS)
    assert kept is not None
    plans = [step.decision.plans for step in kept[0]]
    assert plans[1][0] is plans[0][0]
    assert plans[1][1] is not plans[0][1] and plans[2][0] is not plans[1][0]


ARRAYS = ("times", "states", "controls", "dense_times", "dense_states", "step_seconds")
