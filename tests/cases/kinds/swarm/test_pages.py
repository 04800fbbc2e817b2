"""Sheet, animation, sentences and page of a swarm's run."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import swarmstart as ss
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.kinds.swarm.animation import SwarmFilm, animate
from swarmstart.cases.kinds.swarm.figures import sheet_figure
from swarmstart.cases.kinds.swarm.kind import flight_of, positions_of
from swarmstart.cases.kinds.swarm.report import kept, outcome, surroundings


def test_the_sheet_has_four_parts(flown: ss.Run) -> None:
    figure = sheet_figure(flown.resolved.scenario, flight_of(flown.trajectory))  # type: ignore[arg-type]
    labels = [a.get_ylabel() for part in figure.subfigs for a in part.axes]
    found = labels or [a.get_ylabel() for a in figure.axes]
    assert {"y [m]", "distance [m]", "share arrived", "plans a second"} <= {*found}


def test_the_animation_shows_each_vehicle_and_the_rest_of_its_plan(
    flown: ss.Run, tmp_path: Path
) -> None:
    flight = flight_of(flown.trajectory)
    times = flown.trajectory.dense_times
    film = SwarmFilm(flight, times, positions_of(flown.trajectory), title="Six")
    film.show(0)
    centres = [disc.get_center() for disc in film._discs]
    np.testing.assert_allclose(centres, flight.swarm.starts[:, :2])
    film.show(len(times) - 1)
    ends = [line[-1] for line in film._plans.get_segments()]
    np.testing.assert_allclose(ends, flight.swarm.goals[:, :2], atol=1e-9)
    file = tmp_path / "six.gif"
    animate(
        flown.resolved.scenario, flown.flight, flown.trajectory, file  # type: ignore[arg-type]
    )  # fmt: skip
    with Image.open(file) as picture:
        assert getattr(picture, "n_frames", 1) > 40


def test_sentences_say_arrivals_collisions_and_distances(flown: ss.Run) -> None:
    said = outcome(flown.trajectory, flown.measures)
    assert said.startswith("All vehicles have arrived after ")
    assert kept(flown.measures)[1]
    bad = {
        **flown.measures,
        "collisions": 2,
        "obstacle_hits": 1,
        "arrival_time_s": None,
    }
    text, is_kept = kept(bad)
    assert text.startswith("2 pairs of vehicles collide; 1 vehicle hit an obstacle")
    assert not is_kept
    assert "% of the vehicles arrive within" in outcome(flown.trajectory, bad)


def test_the_page_has_goals_and_standing_obstacles(flown: ss.Run) -> None:
    times, none = np.zeros(2), np.empty((6, 2, 2))
    around = surroundings(flown.resolved.settings, times, none, none)
    assert around.targets is not None
    assert around.targets.shape == (6, 2, 2)
    assert [disc.radius for disc in around.discs] == [0.2]


def test_a_run_tells_its_rule_and_its_page_is_made(
    six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    assert main(["run", str(six), "--out", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "6 vehicles in closed loop" in said
    assert "by committed plans: rule acknowledged, seed 0" in said
    assert "Time per step of all vehicles" in said
    assert main(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text("utf-8")
    assert "each vehicle followed its committed plans" in page
    assert "vehicle 5" in page
    assert "is followed to its end" not in page
