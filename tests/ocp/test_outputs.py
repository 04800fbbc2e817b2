"""Outputs of a model along answers and runs, and results as python-control's own."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import control
import numpy as np
import pytest

import swarmstart as ss


def swinging(**options: object) -> ss.OptimalControlProblem:
    """A pendulum with a damping of 0.1; its height and the power of its motor."""
    x, u, c = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("c")
    t = ca.SX.sym("t")
    model = ss.Model(
        states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0]) - c * x[1]),
        parameters=c, state_names=("angle", "rate"), time=t,
        outputs={"height": -ca.cos(x[0]), "power": u * x[1], "late": t * c},
    )  # fmt: skip
    settings: dict[str, object] = {
        "horizon": 2.0, "intervals": 10, "stage_cost": u**2 + x[1] ** 2,
        "bounds": ss.Bounds(controls=(-1, 1)), "checks": 2,
    }  # fmt: skip
    return ss.OptimalControlProblem(model, **(settings | options))  # type: ignore[arg-type]


KNOWN = ss.Known(parameters=[0.1], time=3.0)


def solved(problem: ss.OptimalControlProblem, known: ss.Known = KNOWN) -> ss.Solution:
    return ss.solve(problem, [1.0, 0.0], known=known, search=None, lanes=0, seed=0)


def test_outputs_of_an_answer_are_their_expressions_along_it() -> None:
    found = solved(swinging())
    assert found.output_names == ("height", "power", "late")
    np.testing.assert_allclose(found.outputs[0], -np.cos(found.states[0]), atol=1e-12)
    held = np.repeat(found.controls[0], 2)
    held = np.append(held, held[-1])
    np.testing.assert_allclose(found.outputs[1], held * found.states[1], atol=1e-12)
    np.testing.assert_allclose(found.outputs[2], 0.1 * (3.0 + found.times), atol=1e-12)
    assert "outputs     height" in repr(found)


@pytest.mark.parametrize("shape", ["linear", "continuous"])
def test_outputs_follow_linear_controls(shape: str) -> None:
    found = solved(swinging(control_shape=shape))
    knots = np.interp(np.arange(21) / 2, np.arange(11), found.controls[0])
    np.testing.assert_allclose(found.outputs[1], knots * found.states[1], atol=1e-9)


def test_outputs_know_decided_parameters_and_end_times() -> None:
    problem = swinging(
        horizon=ss.Free(1.0, 3.0), decided={"c": ss.Free(0.0, 0.5)}, terminal_cost=0
    )
    found = solved(problem, ss.Known(time=3.0))
    late = found.decided["c"] * (3.0 + found.times)
    np.testing.assert_allclose(found.outputs[2], late, atol=1e-9)
    A = found.linearised(0.5).A
    assert A[1, 1] == pytest.approx(-found.decided["c"], abs=1e-12)


def test_the_linear_system_of_an_answer_is_that_of_its_path() -> None:
    found = solved(swinging())
    for time in (0.0, 0.73, 2.0):
        system = found.linearised(time)
        angle = np.interp(time, found.path.times, found.path.states[0])
        assert system.A[1] == pytest.approx([-np.cos(angle), -0.1], abs=1e-12)
        assert system.C[0, 0] == pytest.approx(np.sin(angle), abs=1e-12)
    # At an interval's end the control that follows counts.
    rate = np.interp(0.2, found.path.times, found.path.states[1])
    assert found.linearised(0.2).D[1, 0] == pytest.approx(rate, abs=1e-12)
    assert found.linearised(0.2).C[1, 1] == pytest.approx(found.controls[0, 1])
    with pytest.raises(
        ss.InvalidProblemError, match="time must be from 0 to 2 s, got 3"
    ):
        found.linearised(3.0)


def test_members_and_phases_keep_their_outputs() -> None:
    x, u, c = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("c")
    model = ss.Model(
        states=x, controls=u, ode=u - c * x, parameters=c, outputs={"square": c * x**2}
    )
    one = ss.OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=u**2 + x**2,
        bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    several = ss.ensemble(one, {"c": [0.5, 2.0]})
    found = ss.solve(several, [1.0], search=None, lanes=0, seed=0)
    assert found.output_names == ("square_0", "square_1")
    np.testing.assert_allclose(found.outputs[1], 2.0 * found.states[1] ** 2, atol=1e-12)
    still = ss.Model(states=x, controls=u, ode=u, outputs={"square": x**2})
    leg = ss.OptimalControlProblem(
        still, horizon=1.0, intervals=3, stage_cost=u**2, terminal=[(x, 1)],
        bounds=ss.Bounds(controls=(-2, 2)),
    )  # fmt: skip
    both = ss.phases([leg, leg])
    joined = ss.solve(both.problem, both.start([0.0]), search=None, lanes=0, seed=0)
    assert joined.output_names == ("square",)
    np.testing.assert_allclose(joined.outputs[0], joined.states[0] ** 2, atol=1e-9)
    two = ss.stack_models([still, still])
    assert two.output_names == ("square_0", "square_1")
    assert ca.is_equal(two.outputs["square_1"], two.states[1] ** 2, 2)


def run_of(problem: ss.OptimalControlProblem) -> tuple[ss.Plant, ss.Trajectory]:
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner, parameters=lambda t: np.array([0.1]))
    plant = ss.Plant(
        problem.model, dt=problem.dt, substeps=5,
        parameters=lambda times: np.full((1, times.size), 0.1),
    )  # fmt: skip
    return plant, ss.simulate(plant, loop, [1.0, 0.0], steps=4, seed=0)


def test_a_run_has_the_outputs_of_its_plant() -> None:
    plant, run = run_of(swinging())
    assert run.outputs.shape == (3, 21) and plant.output_names == run.output_names
    np.testing.assert_allclose(run.outputs[0], -np.cos(run.dense_states[0]), atol=1e-12)
    held = np.append(np.repeat(run.controls[0], 5), run.controls[0, -1])
    np.testing.assert_allclose(run.outputs[1], held * run.dense_states[1], atol=1e-12)
    np.testing.assert_allclose(run.outputs[2], 0.1 * run.dense_times, atol=1e-12)
    x, u = run.at(0.2)
    np.testing.assert_array_equal(x, run.states[:, 1])
    np.testing.assert_array_equal(u, run.controls[:, 1])


def test_outputs_are_those_of_the_mean_control_where_a_plan_jumps_within_a_step() -> (
    None
):
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u - x, outputs={"rate": u}),
        horizon=ss.Free(0.3, 4.0), intervals=5, stage_cost=1 + u**2, terminal=[x - 1],
        bounds=ss.Bounds(controls=(-3, 3)),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner, period=0.3)
    run = ss.simulate(
        ss.Plant(problem.model, dt=0.3, substeps=3), loop, [0.0], steps=2, seed=0
    )
    expected = []
    for decision in run.decisions:
        assert decision.profile is not None and decision.profile.is_held
        parts = (np.arange(30_000) + 0.5) / 30_000
        fine = decision.profile.at((decision.dt or 0.3) * parts)[0]
        expected += [*fine.reshape(3, -1).mean(axis=1)]
    np.testing.assert_allclose(run.outputs[0], [*expected, expected[-1]], atol=1e-4)
    first = run.decisions[0].plans[0].controls[0]
    assert first[0] + 0.01 < run.outputs[0, 1] < first[1] - 0.01


def test_records_keep_outputs(tmp_path: Path) -> None:
    _, run = run_of(swinging())
    kept = ss.load(run.save(tmp_path / "run")).trajectory
    assert kept is not None and kept.output_names == run.output_names
    np.testing.assert_array_equal(kept.outputs, run.outputs)
    found = solved(swinging())
    arrays = ss.load(found.save(tmp_path / "answer")).arrays
    np.testing.assert_array_equal(arrays["outputs"], found.path.outputs)
    assert arrays["output_names"].tolist() == ["height", "power", "late"]


def test_a_table_has_outputs_once() -> None:
    pytest.importorskip("pandas")
    found = solved(swinging())
    table = found.to_dataframe()
    assert [*table.columns][-3:] == ["height", "power", "late"]
    np.testing.assert_array_equal(table["height"], found.outputs[0])
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    same = ss.Model(states=x, controls=u, ode=u, outputs={"x": x, "twice": 2 * x})
    problem = ss.OptimalControlProblem(
        same, horizon=1.0, intervals=2, stage_cost=u**2,
        bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    columns = ss.solve(problem, [1.0], search=None, lanes=0, seed=0).to_dataframe()
    assert [*columns.columns] == ["x", "u", "twice"]


def test_results_are_responses_of_python_control() -> None:
    found = solved(swinging())
    response = found.to_time_response()
    assert isinstance(response, control.TimeResponseData)
    assert response.output_labels == ["height", "power", "late"]
    assert response.state_labels == ["angle", "rate"] and response.input_labels == ["u"]
    np.testing.assert_array_equal(response.time, found.path.times)
    np.testing.assert_array_equal(response.outputs, found.path.outputs)
    np.testing.assert_array_equal(response.inputs[0][:-1], found.path.controls[0])
    assert len(response.to_pandas()) == found.path.times.size
    assert response.plot() is not None
    _, run = run_of(swinging())
    flown = run.to_time_response()
    np.testing.assert_array_equal(flown.states, run.dense_states)
    assert flown.inputs.shape == (1, 21) and flown.inputs[0, 5] == run.controls[0, 1]


def test_without_outputs_a_response_has_the_states() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        stage_cost=u**2, bounds=ss.Bounds(controls=(-1, 1)), control_shape="linear",
    )  # fmt: skip
    found = ss.solve(problem, [1.0], search=None, lanes=0, seed=0)
    response = found.to_time_response()
    assert response.output_labels == ["x"] == response.state_labels
    halves = np.linspace(0, 2, found.path.times.size)
    np.testing.assert_allclose(
        response.inputs[0], np.interp(halves, [0, 1, 2], found.controls[0])
    )


def test_a_run_of_a_scenario_gives_a_response_and_a_linear_system() -> None:
    run = ss.run("pendulum", seed=0, search="none")
    response = run.to_time_response()
    np.testing.assert_array_equal(response.time, run.trajectory.dense_times)
    angle = run.trajectory.at(1.0)[0][0]
    assert run.linearised(1.0).A[1, 0] == pytest.approx(-9.81 * np.cos(angle), rel=1e-9)


def test_a_dual_mode_gives_its_law_with_the_names_of_the_agent() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("force")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        intervals=4, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    near = ss.terminal_set_of(
        problem, at=[0, 0], weights=ss.Weights(Q=np.eye(2), R=np.eye(1)),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    dual = ss.DualMode(loop, sets=[near], targets=[lambda time: np.zeros(2)])
    law = dual.linear_law()
    assert law.input_labels == ["x_0", "x_1"] and law.output_labels == ["force"]
    np.testing.assert_array_equal(law.D, -near.K)
    assert law.dt == problem.dt == 0.5


@pytest.mark.parametrize(
    ("outputs", "message"),
    [
        ([1], "outputs must be a mapping from names to expressions"),
        ({3: 1.0}, "names of outputs must be texts that are not empty, got 3"),
        ({"": 1.0}, "names of outputs must be texts that are not empty, got ''"),
        ({"both": ca.SX.sym("x", 2)}, "output 'both' must be one expression, got 2"),
        ({"far": ca.SX.sym("z")}, "output 'far'.*z"),
        ({"x": ca.SX(1)}, "output 'x' has the name of a state or a control"),
    ],
)
def test_outputs_that_are_no_expressions_are_refused(
    outputs: object, message: str
) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    with pytest.raises(ss.InvalidProblemError, match=message):
        ss.Model(states=x, controls=u, ode=u, outputs=outputs)  # type: ignore[arg-type]
