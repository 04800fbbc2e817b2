"""Time of each step, and source of each plan."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarmstart.cases.drawing import planning
from swarmstart.cases.drawing.planning import KINDS, draw_planning, sources_of
from swarmstart.ocp import Decision, Mode, Plan, Source, Trajectory
from swarmstart.tests.cases.drawing.reading import (
    contrast,
    covered,
    held,
    legend,
    panel,
)


def plan(source: Source) -> Plan:
    empty = np.empty((0, 0))
    return Plan(
        controls=empty, states=empty, cost=0.0, violation=0.0, feasible=True,
        source=source,
    )  # fmt: skip


def run_of(rows: list[list[Plan]], modes: list[Mode] | None = None) -> Trajectory:
    """Return a run with these plans in its steps of half a second."""
    steps = len(rows)
    times, still = np.linspace(0.0, 0.5 * steps, steps + 1), np.zeros((1, steps + 1))
    return Trajectory(
        times=times, states=still, controls=still[:, :-1], dense_times=times,
        dense_states=still,
        decisions=tuple(
            Decision(control=np.zeros(1), plans=tuple(row), mode=mode)
            for row, mode in zip(rows, modes or [Mode.PLANNED] * steps, strict=True)
        ),
        step_seconds=np.linspace(0.001, 0.02, steps),
    )  # fmt: skip


def names_of(run: Trajectory, given: tuple[int, ...] = ()) -> list[list[str]]:
    return [[KINDS[k].name for k in row] for row in sources_of(run, given)]


def test_each_step_has_the_source_of_its_plan() -> None:
    every = [Source.GUESS, Source.SEARCH, Source.POLISH, Source.SHIFTED]
    run = run_of([[plan(source)] for source in every])
    (names,) = names_of(run)
    assert names[:3] == ["warm start", "search", "polish"]
    assert names[3].startswith("no feasible plan")


def test_an_earlier_plan_that_goes_on_and_the_terminal_law_are_told_apart() -> None:
    made = plan(Source.SEARCH)
    run = run_of([[made], [made], [made]], [Mode.PLANNED, Mode.PLANNED, Mode.LINEAR])
    assert names_of(run) == [["search", "earlier plan goes on", "terminal law"]]


def test_given_plans_are_no_warm_starts() -> None:
    run = run_of([[plan(Source.SEARCH), plan(Source.GUESS)]])
    assert names_of(run, given=(1,)) == [["search"], ["given plan"]]


def drawn(run: Trajectory, **options: object) -> Figure:
    figure = Figure(layout="constrained")
    draw_planning(figure, run, **options)  # type: ignore[arg-type]
    return figure


def test_the_strip_has_a_row_for_each_planner_with_its_own_name() -> None:
    run = run_of([[plan(Source.SEARCH), plan(Source.POLISH)]] * 3)
    figure = drawn(run, names=["UAV 4", "UAV 5"])
    above, strip = figure.axes
    assert [t.get_text() for t in strip.get_yticklabels()] == ["UAV 4", "UAV 5"]
    assert [text.get_text() for text in strip.texts][::1] == ["S", "e", "P", "e"]
    assert above.get_xlim() == (0.0, 1.5)
    (cells,) = strip.collections
    assert np.asarray(cells.get_array()).tolist() == sources_of(run).tolist()


def test_times_far_below_dt_have_a_logarithmic_axis_with_dt_in_it() -> None:
    run = run_of([[plan(Source.SEARCH)]] * 4)
    axes = panel(drawn(run), "wall time of a step [s]")
    assert axes.get_yscale() == "log"
    (seconds, _), (dt, _) = held(axes)
    assert seconds.tolist() == run.step_seconds.tolist()
    assert dt.tolist() == [0.5] * 4
    assert axes.get_title(loc="right") == "median 0.0105 s, largest 0.02 s"


def test_of_very_many_steps_neighbours_are_summed_up() -> None:
    made = plan(Source.SEARCH)
    run = run_of([[made]] * 2000)
    axes = panel(drawn(run), "wall time of a step [s]")
    ranges, medians, _ = held(axes)
    assert len(medians[0]) == planning.MOST_STEPS // 4
    assert ranges[0].max() == run.step_seconds.max()


def test_of_many_planners_their_number_by_source_is_drawn() -> None:
    rows = [[plan(Source.SEARCH)] * 15 + [plan(Source.POLISH)] * 5 for _ in range(2)]
    strip = drawn(run_of([rows[0]])).axes[1]
    assert strip.get_ylim() == (0, 20)
    assert [values.tolist() for values, _ in held(strip)] == [[15.0], [20.0]]


def test_the_legend_names_what_occurs_only() -> None:
    figure = drawn(run_of([[plan(Source.SEARCH)]] * 2))
    assert {"S  search", "e  earlier plan goes on"} < {*legend(figure)}
    assert "P  polish" not in legend(figure)


def test_sources_differ_in_lightness_for_grey_print() -> None:
    lights = sorted(contrast(kind.colour, "#000000") for kind in KINDS)
    steps = np.array(lights[1:]) / np.array(lights[:-1])
    assert steps.min() > 1.1
    assert len({kind.letter for kind in KINDS}) == len(KINDS)


@pytest.mark.parametrize("source", list(Source))
def test_every_source_of_a_plan_has_a_kind(source: Source) -> None:
    assert names_of(run_of([[plan(source)]]))


def test_the_legend_lies_outside_the_panels() -> None:
    figure = Figure(figsize=(6.0, 4.5), layout="constrained")
    draw_planning(figure, run_of([[plan(Source.SEARCH)], [plan(Source.POLISH)]]))
    assert {"time to plan", "dt, 0.5 s", "S  search"} < {*legend(figure)}
    assert covered(figure) == []
