"""Formations have the counts, distances and shapes that their words say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from swarmstart.arrays import Array
from swarmstart.cases.kinds.swarm.formations import (
    Cube,
    Formation,
    Goals,
    Opposite,
    random_places,
)

FORMATION, GOALS = TypeAdapter[Any](Formation), TypeAdapter[Any](Goals)


def places(given: dict[str, Any], folder: Path = Path()) -> Array:
    part = FORMATION.validate_python(given, context={"folder": folder})
    return np.asarray(part.places())


def gaps(found: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(found, axis=0), axis=1))


def test_a_line_is_across_its_heading_from_the_left_to_the_right() -> None:
    found = places({"formation": "line", "count": 4, "spacing_m": 2.0,
                    "centre_m": [1.0, 2.0, 3.0], "heading_rad": "pi/2"})  # fmt: skip
    np.testing.assert_allclose(found[:, 0], [-2, 0, 2, 4], atol=1e-12)
    np.testing.assert_allclose(found[:, 1:], [[2, 3]] * 4, atol=1e-12)


def test_a_v_has_two_legs_behind_its_leader_with_the_angle_between_them() -> None:
    found = places({"formation": "v", "count": 5, "spacing_m": 3.0,
                    "opening_rad": "pi/3", "heading_rad": 0.7})  # fmt: skip
    np.testing.assert_allclose(found[0], 0, atol=1e-12)
    left, right = found[[0, 1, 3]], found[[0, 2, 4]]
    np.testing.assert_allclose(gaps(left), 3.0)
    np.testing.assert_allclose(gaps(right), 3.0)
    angle = np.arccos((found[3] @ found[4]) / 36.0)
    assert angle == pytest.approx(np.pi / 3)
    ahead = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    assert (found[1:] @ ahead < 0).all()
    assert np.cross(ahead, found[1])[2] > 0 > np.cross(ahead, found[2])[2]


def test_a_circle_and_a_grid_have_equal_distances() -> None:
    ring = places({"formation": "circle", "count": 7, "radius_m": 2.0,
                   "centre_m": [0, 0, 1]} | {"centre_m": [0.0, 0.0, 1.0]})  # fmt: skip
    assert np.ptp(gaps(np.vstack([ring, ring[:1]]))) < 1e-12
    np.testing.assert_allclose(np.hypot(*ring[:, :2].T), 2.0)
    grid = places({"formation": "grid", "counts": [2, 3, 4], "spacing_m": 0.5})
    assert len(np.unique(grid.round(9), axis=0)) == 24
    np.testing.assert_allclose(np.ptp(grid, axis=0), [0.5, 1.0, 1.5])
    np.testing.assert_allclose(grid.mean(axis=0), 0, atol=1e-12)


def test_letters_are_as_high_as_asked_and_vehicles_lie_evenly_on_them() -> None:
    given = {"formation": "letters", "text": "I", "count": 40, "height_m": 10.0}
    found = places(given)
    assert found[:, 2].tolist() == [0.0] * 40
    assert 9.0 < np.ptp(found[:, 1]) <= 10.0
    # The outline of an I is a rectangle, so neighbours along its sides are level.
    assert np.median(gaps(found)) == pytest.approx(gaps(found).max(), rel=1e-6)
    assert len(places({**given, "text": "$x_{$"})) == 40
    upright = places({**given, "upright": True})
    np.testing.assert_allclose(upright[:, [0, 2]], found[:, :2])


def test_a_file_gives_places_and_names_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x_m,y_m,z_m\n0,1,2\n3,4,5\n", "utf-8")
    found = places({"formation": "file", "file": "a.csv"}, tmp_path)
    np.testing.assert_array_equal(found, [[0, 1, 2], [3, 4, 5]])
    (tmp_path / "b.csv").write_text("x,y,z\n0,1,2\n", "utf-8")
    with pytest.raises(ValidationError, match="expected the columns x_m, y_m, z_m"):
        places({"formation": "file", "file": "b.csv"}, tmp_path)
    for row, said in (("0,foo,2", "0,foo,2"), ("0,1", "0,1"), ("0,1,nan", "nan")):
        (tmp_path / "c.csv").write_text(f"x_m,y_m,z_m\n{row}\n", "utf-8")
        with pytest.raises(ValidationError, match=rf"c.csv:2: .*{said}"):
            places({"formation": "file", "file": "c.csv"}, tmp_path)
    with pytest.raises(ValidationError, match="expected file to be a CSV file in the"):
        places({"formation": "file", "file": "../a.csv"}, tmp_path)
    with pytest.raises(ValidationError, match="expected the keys formation and file"):
        places({"formation": "file", "file": "a.csv", "count": 3}, tmp_path)


def test_random_places_are_apart_and_clear_and_the_same_for_a_seed() -> None:
    cube = Cube(formation="cube", count=30, side_m=3.0, seed=4)
    scale, ball = np.array([1.0, 1.0, 0.5]), (np.zeros(3), 0.8)
    found = random_places(cube, scale, 0.35, [ball])
    apart = np.linalg.norm((found[:, None] - found[None]) * scale, axis=2)
    np.fill_diagonal(apart, np.inf)
    assert apart.min() >= 0.35
    assert (np.linalg.norm(found * scale, axis=1) > 0.8).all()
    assert (np.abs(found) <= 1.5).all()
    np.testing.assert_array_equal(found, random_places(cube, scale, 0.35, [ball]))


def test_a_cube_without_room_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmstart.cases.kinds.swarm.formations.MOST_TRIES", 300)
    with pytest.raises(ValueError, match="expected room for 50 vehicles in a cube"):
        random_places(
            Cube(formation="cube", count=50, side_m=0.5), np.ones(3), 0.35, []
        )


def test_goals_may_be_opposite_or_several_formations() -> None:
    assert isinstance(GOALS.validate_python({"formation": "opposite"}), Opposite)
    several = GOALS.validate_python(
        [{"formation": "line", "count": 2, "spacing_m": 1.0}] * 2
    )
    assert len(several) == 2
    with pytest.raises(ValidationError, match="formation"):
        FORMATION.validate_python({"formation": "opposite"})
