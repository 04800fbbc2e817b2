"""Figures of any problem: they show what was simulated."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from swarmstart.cases.drawing import plan_figures
from swarmstart.cases.drawing.drawing import write_figures
from swarmstart.cases.drawing.panels import Labels, panels_figure, panels_of
from swarmstart.cases.drawing.problem_figures import (
    Place,
    draw_solution,
    draw_trajectory,
    figures_of,
    labels_of,
)
from swarmstart.cases.drawing.slack import Slack, slack_figure, slacks
from swarmstart.ocp import (
    Bounds,
    Decision,
    Free,
    HeldSignals,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Plan,
    Planner,
    Plant,
    SearchReport,
    Source,
    TerminalConstraint,
    Trajectory,
    solve,
    stack_models,
    verified,
)
from swarmstart.ocp.lanes.answers import Optimum
from swarmstart.ocp.rollout import NOTHING
from swarmstart.ocp.search.account import Lanes, StartsAccount
from swarmstart.tests.cases.drawing.reading import (
    bounds,
    curves,
    held,
    legend,
    level,
    named,
    panel,
    words,
)

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
MODEL = Model(
    states=X, controls=U, ode=ca.vertcat(X[1], U),
    state_names=("place", "speed"), control_names=("force",),
)  # fmt: skip
STEPS, SUBSTEPS = 4, 2


def posed(**changes: object) -> OptimalControlProblem:
    """Return a double integrator over 2 s."""
    settings: dict[str, object] = {
        "horizon": 2.0, "intervals": STEPS, "stage_cost": U**2,
        "bounds": Bounds(controls=(-2.0, 2.0), states=([-np.inf, -3], np.inf)),
    }  # fmt: skip
    return OptimalControlProblem(MODEL, **(settings | changes))  # type: ignore[arg-type]


def plan_of(controls: np.ndarray, **changes: object) -> Plan:
    """Return a plan without states, as a record keeps it."""
    settings: dict[str, object] = {
        "controls": controls, "states": np.empty((0, 0)), "cost": 3.0,
        "violation": 0.0, "feasible": True, "source": Source.POLISH,
    }  # fmt: skip
    return Plan(**(settings | changes))  # type: ignore[arg-type]


def flown(
    problem: OptimalControlProblem,
    controls: Sequence[Sequence[float]],
    x0: Sequence[float],
    *,
    plans: Sequence[Sequence[Plan]] | None = None,
) -> Trajectory:
    """Return a flight with given controls (nu, T), and plans of each step."""
    held = np.array(controls, dtype=float)
    plant = Plant(problem.model, dt=problem.dt, substeps=SUBSTEPS)
    state, dense = np.array(x0, dtype=float), [np.array(x0, dtype=float)[:, None]]
    for control in held.T:
        dense.append(plant(state, control))
        state = dense[-1][:, -1]
    steps, path = held.shape[1], np.hstack(dense)
    if plans is None:
        plans = [[plan_of(held)]] * steps
    return Trajectory(
        times=np.linspace(0.0, steps * problem.dt, steps + 1),
        states=path[:, ::SUBSTEPS],
        controls=held,
        dense_times=np.linspace(0.0, steps * problem.dt, steps * SUBSTEPS + 1),
        dense_states=path,
        decisions=tuple(
            Decision(control=held[:, k], plans=tuple(made))
            for k, made in enumerate(plans)
        ),
        step_seconds=np.linspace(0.1, 0.2, steps),
    )


HELD = [[1.0, -2.0, 0.5, 0.0]]


def drawn(
    problem: OptimalControlProblem | Sequence[OptimalControlProblem],
    trajectory: Trajectory,
    **options: object,
) -> dict[str, Figure]:
    """Return the figures by name."""
    return dict(figures_of(problem, trajectory, **options))  # type: ignore[arg-type]


def plans_of(axes: Axes) -> list[Line2D]:
    """Return the lines of the plans."""
    return named(axes, "plans")


def test_states_are_drawn_along_the_fine_path_with_names_units_and_finite_bounds() -> (
    None
):
    problem, units = posed(), {"place": "m", "speed": "m/s"}
    flight = flown(problem, HELD, [0, 0])
    figure = drawn(problem, flight, labels=labels_of(problem, units=units))["a_sheet"]
    place, speed = figure.axes[:2]
    assert [words(axes) for axes in (place, speed)] == ["place [m]", "speed [m/s]"]
    assert bounds(place) == [] and bounds(speed) == [-3.0]
    for axes, values in zip((place, speed), flight.dense_states, strict=True):
        assert np.array_equal(curves(axes)[0], values)
    assert [axes.get_xlabel() for axes in (place, speed)] == ["", "time [s]"]


def test_controls_are_held_over_their_steps_between_their_bounds() -> None:
    flight = flown(posed(), HELD, [0, 0])
    axes = panel(drawn(posed(), flight)["a_sheet"], "force")
    ((values, edges),) = held(axes)
    assert values.tolist() == HELD[0] and edges.tolist() == flight.times.tolist()
    assert bounds(axes) == [-2.0, 2.0]


def test_outputs_are_drawn_along_the_fine_path_with_their_names() -> None:
    flight = flown(posed(), HELD, [0, 0])
    assert "h_outputs" not in drawn(posed(), flight)
    values = np.vstack([flight.dense_states.sum(axis=0), flight.dense_states[0] ** 2])
    told = replace(flight, outputs=values, output_names=("sum", "square"))
    figure = drawn(posed(), told)["h_outputs"]
    for label, expected in zip(("sum", "square"), values, strict=True):
        assert np.array_equal(curves(panel(figure, label))[0], expected)


def test_what_lies_beyond_a_bound_is_grey() -> None:
    axes = panel(drawn(posed(), flown(posed(), HELD, [0, 0]))["a_sheet"], "force")
    inside = axes.transData.inverted()
    spans = [p.get_extents().transformed(inside) for p in axes.patches[1:]]
    found = np.sort([(span.y0, span.y1) for span in spans], axis=0)
    low, high = axes.get_ylim()
    assert found == pytest.approx(np.array([(low, -2.0), (2.0, high)]))


def test_bounds_far_beyond_the_values_are_told_instead_of_drawn() -> None:
    wide = posed(bounds=Bounds(controls=(-1e6, 4.0)))
    axes = panel(drawn(wide, flown(wide, HELD, [0, 0]))["a_sheet"], "force")
    assert bounds(axes) == [4.0]
    assert axes.get_title(loc="right") == "bounds beyond the axis: -1e+06"


def test_slack_is_the_distance_to_the_limit_before_and_after_each_control_jump() -> (
    None
):
    # From rest: at 0.5 s speed 0.5, place 0.125; at the end place -0.1875.
    limits = [
        PathConstraint(expression=X[1] + U, upper=1.2, name="sum"),
        PathConstraint(expression=X[0], lower=-1.0, upper=4.0, name="range"),
    ]
    ends = [
        TerminalConstraint(expression=X[0] - 7.0, name="goal"),
        TerminalConstraint(expression=X[0], lower=-np.inf, upper=-0.1875, name="wall"),
    ]
    problem = posed(constraints=limits, terminal=ends)
    found = slacks(problem, flown(problem, HELD, [0, 0]), lambda _: NOTHING)
    assert [row.times.size for row in found if row.is_terminal] == [1, 1]
    figure = drawn(problem, flown(problem, HELD, [0, 0]))["d_slack"]
    above, between, at_end = figure.axes
    times = np.asarray(above.lines[1].get_xdata())
    at = np.flatnonzero(times == 0.5)
    assert curves(above)[0][at] == pytest.approx([1.2 - 1.5, 1.2 - (0.5 - 2.0)])
    assert curves(between)[0][at] == pytest.approx([1.125, 1.125])
    assert [axes.get_title(loc="left") for axes in figure.axes[:2]] == [
        "sum\nleast -0.3, at 0.5 s", "range\nleast 0.812, at 2 s",
    ]  # fmt: skip
    assert above.collections[0].get_label() == "broken"
    assert str(between.collections[0].get_label()).startswith("_")
    # Terminal constraints are points, in tolerances, and no lines over time.
    goal, wall = (line for line in at_end.lines if line.get_marker() != "None")
    assert curves(at_end) == []
    assert np.asarray(goal.get_xdata()) == pytest.approx([-7.1875 / 1e-4 / 7], rel=0.3)
    assert np.asarray(wall.get_xdata()) == pytest.approx([0.0], abs=1e-6)
    assert goal.get_label() == "broken at the end"
    assert wall.get_label() == "kept at the end"
    assert [tick.get_text() for tick in at_end.get_yticklabels()] == ["goal", "wall"]
    assert at_end.get_title() == "end conditions, at 2 s"


def test_bounds_that_change_over_time_are_lines_beyond_which_it_is_grey() -> None:
    most, fall = ca.SX.sym("most"), ca.SX.sym("fall")
    rows = np.array([[1.0, 2.0, 1.5, 1.5, 1.5], [900.0, 0.5, 0.4, 0.3, 0.2]])
    problem = posed(
        signals=ca.vertcat(most, fall), features=[HeldSignals(["most"])],
        bounds=Bounds(controls=(-2.0, [most]), states=([-np.inf, -3], [np.inf, fall])),
    )  # fmt: skip
    moved = flown(problem, HELD, [0, 0])
    found = dict(figures_of(problem, moved, known=lambda *_: Known(signals=rows)))
    sheet = found["a_sheet"]
    over_time = next(axes for axes in sheet.axes if words(axes) == "speed")
    (speed,) = [line for line in named(over_time, "bound") if many(line)]
    at, values = np.asarray(speed.get_xdata()), np.asarray(speed.get_ydata())
    near = np.isfinite(values)  # Bounds far from the values are left out.
    assert not near.all()
    expected = np.interp(at, np.linspace(0, 2, 5), rows[1])
    np.testing.assert_allclose(values[near], expected[near], atol=1e-12)
    (force,) = [line for line in named(panel(sheet, "force"), "bound") if many(line)]
    at, values = np.asarray(force.get_xdata()), np.asarray(force.get_ydata())
    np.testing.assert_allclose(values, np.repeat(rows[0, :-1], SUBSTEPS + 1))
    assert bounds(panel(sheet, "place")) == []
    assert len(panel(sheet, "force").collections) == 1


def many(line: Line2D) -> bool:
    return np.size(line.get_xdata()) > 2


def test_an_end_condition_with_slack_is_kept_on_one_side_only() -> None:
    rows = [
        Slack(
            name=f"{value}", times=np.array([2.0]), values=np.array([value]),
            tolerance=0.5, is_equality=False, is_terminal=True,
        )
        for value in (4.0, -0.4, -4.0)
    ]  # fmt: skip
    (axes,) = slack_figure(rows).axes
    points = [line.get_label() for line in axes.lines if line.get_marker() != "None"]
    assert points == [*2 * ["kept at the end"], "broken at the end"]


def test_slack_counts_signals_from_when_the_plan_was_made() -> None:
    # The limit is the time since the start: the plan of step k knows it from k dt on.
    s = ca.SX.sym("s")
    problem = posed(signals=s, constraints=[PathConstraint(expression=s, upper=9.0)])
    plans = [[plan_of(np.zeros((1, STEPS)))] for _ in range(STEPS)]
    plans[1] = plans[0]  # used for one more step

    def known(step: int, number: int) -> Known:
        assert step != 1
        return Known(signals=[step * problem.dt + problem.times])

    flight = flown(problem, HELD, [0, 0], plans=plans)
    (axes,) = drawn(problem, flight, known=known)["d_slack"].axes
    times = np.asarray(axes.lines[1].get_xdata())
    assert curves(axes)[0] == pytest.approx(9.0 - times)


def test_the_phase_plane_is_of_two_states_only() -> None:
    problem = posed()
    flight = flown(problem, HELD, [0, 0])
    axes = drawn(problem, flight)["a_sheet"].axes[2]  # Beside the states: once.
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("place", "speed")
    assert np.asarray(axes.lines[0].get_data()) == pytest.approx(flight.dense_states)
    assert [text.get_text() for text in axes.texts] == ["0.5 s", "1 s", "1.5 s", "2 s"]
    alone = drawn(problem, closed_loop())["e_phase_plane"].axes[0]
    assert len(plans_of(alone)) == STEPS
    three = stack_models([MODEL, MODEL])
    wide = OptimalControlProblem(three, horizon=2.0, intervals=STEPS)
    still = drawn(wide, flown(wide, [*HELD, *HELD], [0, 0, 1, 0]))
    assert [*still] == ["a_sheet"] and len(still["a_sheet"].axes) == 6


def test_states_that_are_a_position_are_drawn_as_tracks_to_scale() -> None:
    place = Place(rows=(1, 0), discs=[(3.0, 4.0, 0.5)])
    flight = flown(posed(), HELD, [0, 0])
    axes = drawn(posed(), flight, place=place)["a_sheet"].axes[2]
    assert axes.get_aspect() == 1.0
    track = next(line for line in axes.lines if np.size(line.get_xdata()) > 5)
    assert np.asarray(track.get_data()) == pytest.approx(flight.dense_states[::-1])
    assert [(p.center, p.radius) for p in axes.patches] == [((3.0, 4.0), 0.5)]  # type: ignore[attr-defined]
    assert "e_tracks" in drawn(posed(), closed_loop(), place=place)


def test_one_plan_has_its_search_and_its_cost_but_no_figures_of_plans() -> None:
    history, spent = np.array([9.0, np.inf, 5.0]), np.array([50.0, 90.0, 120.0])
    report = SearchReport(history=history, evaluations=spent)
    searched = plan_of(np.array(HELD), search=report)
    flight = flown(posed(), HELD, [0, 0], plans=[[searched]] * STEPS)
    figures = drawn(posed(), flight)
    assert list(figures) == ["a_sheet"]
    axes = panel(figures["a_sheet"], "cost")
    assert curves(axes)[0] == pytest.approx([9.0, np.nan, 5.0], nan_ok=True)
    assert [level(line) for line in named(axes, "plan, 3")] == [3.0]
    assert np.asarray(axes.lines[0].get_xdata()).tolist() == spent.tolist()
    assert axes.lines[0].get_label() == "best of the search"
    turned = replace(labels_of(posed()), maximize=True)
    axes = panel(drawn(posed(), flight, labels=turned)["a_sheet"], "objective")
    assert [level(line) for line in named(axes, "plan, -3")] == [-3.0]


def converging(costs: Sequence[float], violations: Sequence[float]) -> Figure:
    """Return the sheet of a plan of cost 3 that was searched."""
    report = SearchReport(
        history=np.array(costs), violations=np.array(violations),
        evaluations=np.linspace(50.0, 50.0 * len(costs), len(costs)),
    )  # fmt: skip
    searched = plan_of(np.array(HELD), search=report)
    flight = flown(posed(), HELD, [0, 0], plans=[[searched]] * STEPS)
    return drawn(posed(), flight)["a_sheet"]


def test_costs_of_points_that_break_limits_are_apart_above_their_violation() -> None:
    sheet = converging([2.0, 5.0, 9.0, 4.0], [3.0, 0.05, 1e-32, 0.0])
    axes, beneath = panel(sheet, "cost"), panel(sheet, "violation (scaled)")
    (kept,) = named(axes, "best of the search")
    assert np.asarray(kept.get_ydata())[2:].tolist() == [9.0, 4.0]
    assert np.isnan(np.asarray(kept.get_ydata())[:2]).all()
    (broken,) = named(axes, "best of the search, while it breaks limits")
    # Its last step lasts until the first point that keeps all limits.
    assert np.asarray(broken.get_ydata())[:3].tolist() == [2.0, 5.0, 9.0]
    assert broken.get_linestyle() == "--" != kept.get_linestyle()
    assert beneath.get_yscale() == "log"
    assert np.asarray(beneath.lines[0].get_ydata())[:2].tolist() == [3.0, 0.05]
    assert beneath.get_xlabel() == "evaluations"


def test_a_search_without_violations_has_one_panel() -> None:
    sheet = converging([9.0, 4.0], [1e-32, 0.0])  # Rounding is no violation.
    assert "violation (scaled)" not in [words(axes) for axes in sheet.axes]
    assert panel(sheet, "cost").get_title(loc="right") == ""


def test_a_search_that_kept_no_limits_and_huge_costs_says_so() -> None:
    sheet = converging([1.51e134, 9e99], [3.0, 0.5])
    axes = panel(sheet, "cost")
    assert axes.get_title(loc="right") == (
        "no point of the search kept all limits; costs beyond the axis: up to 1.51e+134"
    )
    assert axes.get_ylim()[1] < 1e3
    assert len(curves(panel(sheet, "violation (scaled)"))) == 0  # Two points.
    lines = panel(sheet, "violation (scaled)").lines
    assert np.asarray(lines[0].get_ydata()).tolist() == [3.0, 0.5]


def test_local_optima_are_drawn_by_cost_with_their_counts() -> None:
    optima = tuple(
        Optimum(
            lane=k, cost=cost, count=count, controls=np.empty((0, 0)),
            states=np.empty((0, 0)), decided=np.empty(0),
        )
        for k, (cost, count) in enumerate([(3.0, 9), (4.0, 1), (7.0, 2)])
    )  # fmt: skip
    lanes = Lanes(
        starts=12, optima=optima, unseen=None, iterations=1,
        seconds=0, infeasible=0, unfinished=0, lost=0,
    )  # fmt: skip
    found = StartsAccount(won="the lanes", tried=(), lanes=lanes)
    plan = plan_of(np.array(HELD), starts=found)
    flight = flown(posed(), HELD, [0, 0], plans=[[plan]] * STEPS)
    axes = panel(drawn(posed(), flight)["a_sheet"], "cost")
    (points,) = axes.collections
    assert np.asarray(points.get_offsets()).tolist() == [[1, 3], [2, 4], [3, 7]]
    assert [text.get_text() for text in axes.texts] == ["9", "1", "2"]


def test_without_a_search_one_plan_has_no_panel_of_its_cost() -> None:
    flight = flown(posed(), HELD, [0, 0])
    for one in (flight, replace(flight, decisions=())):
        sheet = drawn(posed(), one)["a_sheet"]
        assert "cost" not in [words(axes) for axes in sheet.axes]


def closed_loop(steps: int = STEPS) -> Trajectory:
    """Return a flight with a new plan in every step, the second one infeasible."""
    rng = np.random.default_rng(0)
    plans = [
        [plan_of(rng.uniform(-1, 1, (1, STEPS)), cost=float(k), feasible=k != 1)]
        for k in range(steps)
    ]
    return flown(posed(), [[0.5] * steps], [0, 1], plans=plans)


def test_plans_are_drawn_from_where_they_were_made_computed_again_from_a_record() -> (
    None
):
    flight, problem = closed_loop(), posed()
    place, speed = drawn(problem, flight)["a_sheet"].axes[:2]
    thin = plans_of(speed)
    assert len(thin) == STEPS
    for k, line in enumerate(thin):
        controls = flight.decisions[k].plans[0].controls[0]
        ran = flight.states[1, k] + np.append(0, np.cumsum(controls * problem.dt))
        assert np.asarray(line.get_ydata()) == pytest.approx(ran)
        assert np.asarray(line.get_xdata()) == pytest.approx(
            problem.dt * k + problem.times
        )
    assert np.array_equal(curves(place)[-1], flight.dense_states[0])


def test_of_many_plans_a_part_is_drawn() -> None:
    flight = closed_loop(100)
    thin = plans_of(drawn(posed(), flight)["a_sheet"].axes[0])
    assert len(thin) == plan_figures.MOST_PLANS
    begins = [np.asarray(line.get_xdata())[0] for line in thin]
    assert (begins[0], begins[-1]) == (0.0, pytest.approx(99 * 0.5))


def test_costs_and_times_of_a_closed_loop_are_drawn_over_time() -> None:
    flight = closed_loop()
    sheet = drawn(posed(), flight)["a_sheet"]
    axes = panel(sheet, "cost of the plan")
    assert curves(axes)[0].tolist() == [0, 1, 2, 3]
    (bad,) = (line for line in axes.lines if line.get_label() == "infeasible plan")
    assert np.asarray(bad.get_data()).tolist() == [[0.5], [1.0]]
    (values, edges), (limits, _) = held(panel(sheet, "wall time of a step [s]"))
    assert np.array_equal(values, flight.step_seconds)
    assert np.array_equal(edges, flight.times)
    assert limits == pytest.approx([0.5] * STEPS)
    assert {"dt, 0.5 s", "P  polish"} <= {*legend(sheet)}


def test_vehicles_that_plan_alone_share_panels_and_keep_their_own_bounds() -> None:
    flight, figures = team()
    place, speed = figures["a_sheet"].axes[:2]
    assert bounds(place) == [-9, 9] and bounds(speed) == [-5, -4, 4, 5]
    own = [line for line in speed.lines if line.get_label() == "vehicle 2"]
    assert np.array_equal(np.asarray(own[0].get_ydata()), flight.dense_states[3])


def test_each_vehicle_has_the_slack_and_the_plans_of_its_own_problem() -> None:
    flight, figures = team()
    (slack,) = figures["d_slack"].axes
    assert slack.get_title(loc="left") == "vehicle 2: limit\nleast -0.25, at 2 s"
    # Its speed is 1 at the start, its force 0.5, and it knows of 0.25.
    assert curves(slack)[0][0] == pytest.approx(2.5 - 1.0 - 0.5 - 0.25)
    thin = plans_of(figures["a_sheet"].axes[1])
    begins = sorted(float(np.asarray(line.get_ydata())[0]) for line in thin)
    rises = sorted(float(np.ptp(np.asarray(line.get_ydata()))) for line in thin)
    made = [*flight.states[1, :-1], *flight.states[3, [0, 2, 3]]]
    assert begins == pytest.approx(sorted(made))
    assert rises == pytest.approx([0.0] * 4 + [2.0] * 3)


def team() -> tuple[Trajectory, dict[str, Figure]]:
    """Return a flight of two vehicles, the second of which plans in 3 of 4 steps."""
    s = ca.SX.sym("s")
    fast = posed(bounds=Bounds(controls=(-2.0, 2.0), states=([-9, -5], [9, 5])))
    slow = posed(
        bounds=Bounds(controls=(-2.0, 2.0), states=([-9, -4], [9, 4])),
        signals=s,
        constraints=[PathConstraint(expression=X[1] + U + s, upper=2.5, name="limit")],
    )
    both = OptimalControlProblem(
        stack_models([MODEL] * 2), horizon=2.0, intervals=STEPS
    )
    plans = [[plan_of(k * np.ones((1, STEPS))) for k in range(2)] for _ in range(STEPS)]
    plans[1][1] = plans[0][1]
    flight = flown(both, [*HELD, [0.5] * STEPS], [0, 2, 1, 1], plans=plans)
    seen = Known(signals=np.full((1, slow.nodes), 0.25))
    known = {0: Known(), 1: seen}
    return flight, drawn([fast, slow], flight, known=lambda step, k: known[k])


def test_beyond_the_most_panels_a_sentence_says_how_many_there_are() -> None:
    names = [f"state_{i}" for i in range(30)]
    labels = Labels(states=names, controls=[])
    panels = panels_of(names, labels, np.arange(3.0), np.zeros((30, 3)))
    figure = panels_figure({"states": panels, "controls": []}, labels)
    assert len(figure.axes) == 24
    assert figure.get_suptitle() == "States over time; the first 24 of 30 states"


def test_a_solution_shows_its_verified_path_and_its_bounds() -> None:
    problem = posed()
    plan = Planner(problem, search=None, backend="casadi").evaluated(
        np.array(HELD), [0, 0], source=Source.GUESS
    )
    solution = verified(problem, plan, [0, 0])
    place, speed, force = draw_solution(solution, units={"force": "N"}).axes
    assert np.array_equal(curves(place)[0], solution.path.states[0])
    assert bounds(speed) == [-3.0] and bounds(force) == [-2.0, 2.0]
    assert force.get_ylabel() == "force [N]"
    assert held(force)[0][0].tolist() == HELD[0]


@pytest.fixture(scope="module")
def quickest() -> OptimalControlProblem:
    """Return a double integrator whose end time is decided."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=Free(0.5, 5.0, 2.0),
        intervals=10,
        stage_cost=ca.SX(1),
        terminal=[(x, [0.0, 0.0])],
        bounds=Bounds(controls=(-1, 1)),
    )


def test_a_decided_end_time_is_no_line_of_a_state(
    quickest: OptimalControlProblem,
) -> None:
    found = solve(quickest, [1.0, 0.0], search=None, lanes=0, seed=0)
    assert found.path.states.shape[0] == 3  # With the end time.
    place, speed, _ = draw_solution(found).axes
    for axes, state in ((place, found.path.states[0]), (speed, found.path.states[1])):
        assert np.array_equal(curves(axes), [state])


def test_rows_beyond_the_states_of_a_trajectory_are_not_drawn() -> None:
    flight = flown(posed(), HELD, [0, 0])
    more = np.vstack([flight.dense_states, np.full(flight.dense_times.size, 7.0)])
    place, _, _ = draw_trajectory(
        replace(flight, dense_states=more), labels=labels_of(posed())
    ).axes
    assert np.array_equal(curves(place), flight.dense_states[:1])


def test_a_trajectory_is_drawn_without_bounds_and_numbered_without_names() -> None:
    flight = flown(posed(), HELD, [0, 0])
    figure = draw_trajectory(flight)
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "state_0",
        "state_1",
        "control_0",
    ]
    assert all(bounds(axes) == [] for axes in figure.axes)
    named = draw_trajectory(flight, labels=labels_of(posed()))
    assert [axes.get_ylabel() for axes in named.axes] == ["place", "speed", "force"]


def overlaps(figure: Figure) -> list[tuple[str, str]]:
    """Return pairs of texts of a figure that lie over one another."""
    figure.draw_without_rendering()
    texts = [*figure.texts, *([figure._suptitle] if figure._suptitle else [])]  # type: ignore[attr-defined]
    for axes in figure.axes:
        texts += [axes.title, axes._left_title, axes._right_title]  # type: ignore[attr-defined]
        texts += [axes.xaxis.label, axes.yaxis.label]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            texts += [
                tick.label1
                for tick in axis.get_major_ticks()
                if low <= tick.get_loc() <= high
            ]
    for part in (figure, *figure.subfigs):
        texts += [text for one in part.legends for text in one.get_texts()]
    for part in figure.subfigs:
        texts += [part._suptitle] if part._suptitle else []  # type: ignore[attr-defined]
    boxes = [
        (text.get_text(), text.get_window_extent())
        for text in {id(text): text for text in texts}.values()
        if text.get_text() and text.get_visible()
    ]
    return [
        (one, other)
        for i, (one, box) in enumerate(boxes)
        for other, second in boxes[i + 1 :]
        if box.shrunk(0.9, 0.9).overlaps(second.shrunk(0.9, 0.9))
    ]


def test_long_names_and_many_panels_do_not_overlap() -> None:
    names = tuple(f"temperature_of_the_tank_number_{i}" for i in range(12))
    x, u = ca.SX.sym("x", 12), ca.SX.sym("u")
    model = Model(
        states=x, controls=u, ode=u - x, state_names=names, control_names=("$valve$",)
    )
    limits = [
        PathConstraint(
            expression=x[i] * ca.sin(x[i]) + u, upper=3, name=f"{name} is low"
        )
        for i, name in enumerate(names)
    ]
    problem = OptimalControlProblem(
        model, horizon=2.0, intervals=STEPS, constraints=limits,
        bounds=Bounds(controls=(-2, 2), states=(-1e9, 2)),
    )  # fmt: skip
    flight = flown(problem, HELD, np.linspace(0, 1, 12).tolist())
    figures = drawn(problem, flight, labels=labels_of(problem, units={names[0]: "K"}))
    assert list(figures) == ["a_sheet", "b_states", "d_slack"]
    assert panel(figures["a_sheet"], r"\$valve\$")
    assert len(figures["b_states"].axes) == 12
    assert {name: overlaps(figure) for name, figure in figures.items()} == {
        name: [] for name in figures
    }


def test_states_that_are_not_finite_are_left_out_of_a_figure(tmp_path: Path) -> None:
    flight = flown(posed(), HELD, [0, 0])
    flight.dense_states[:, 5:] = np.inf
    assert len(write_figures(figures_of(posed(), flight), tmp_path)) == 1


def test_figures_are_written_in_order_and_not_blank(tmp_path: Path) -> None:
    problem = posed(constraints=[X[1] <= 5.0])
    figures = figures_of(problem, closed_loop())
    told: list[tuple[int, int, str]] = []
    files = write_figures(
        figures, tmp_path / "figures", progress=lambda *so_far: told.append(so_far)
    )
    assert [file.stem[0] for file in files] == list("ade")
    assert told == [(k, 3, "drawing") for k in range(3)]
    assert sorted(files) == sorted((tmp_path / "figures").iterdir())
    for file in files:
        with Image.open(file) as image:
            assert len(image.convert("RGB").getcolors(1 << 24) or ()) > 50, file.name


def test_each_format_that_is_asked_for_is_a_file_of_its_own(tmp_path: Path) -> None:
    figures = [*figures_of(posed(), flown(posed(), HELD, [0, 0]))]
    files = write_figures(figures, tmp_path, formats=("png", "svg", "pdf"))
    assert [file.name for file in files] == [
        "a_sheet.png",
        "a_sheet.svg",
        "a_sheet.pdf",
    ]
    begins = [file.read_bytes()[:5] for file in files]
    assert begins == [b"\x89PNG\r", b"<?xml", b"%PDF-"]
    with Image.open(files[0]) as image:
        assert image.info["dpi"] == pytest.approx((200, 200), abs=0.1)
