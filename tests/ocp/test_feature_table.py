"""Features that docs/any_problem.md says work, one by one, on small problems.

Polish, verification and pairs of features are compared with a peer in
test_feature_pairs.py. Here each feature is tested alone: machine code agrees with
CasADi, the closed loop runs or is refused, and a record keeps the answer.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.record.results import load
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    ensemble,
    phases,
    simulate,
    solve,
)
from swarmstart.ocp.nlp.multipliers import Multipliers
from swarmstart.ocp.statement.rewrites.chain import lowered
from swarmstart.tests.ocp.feature_pairs.comparison import Ours, drawn_point
from swarmstart.tests.ocp.feature_pairs.features import FEATURES, drawn
from swarmstart.tests.ocp.feature_pairs.stated import Stated

MEASURED = "a receding horizon starts where the state is measured"
REFUSED = dict.fromkeys(
    ("free start", "tied start", "free initial cost", "periodic state"), MEASURED
)
"""Part of the error of a closed loop for the features that it refuses."""


def alone(name: str) -> Stated:
    return drawn((name,), np.random.default_rng([5, list(FEATURES).index(name)]))


def _over_time(stated: Stated, count: int) -> Callable[[Array], Array] | None:
    """Return the first signals as functions of time; None without signals."""
    rows = stated.signal_values[:count]
    known = np.linspace(0, stated.horizon, stated.nodes)
    if not rows.size:
        return None
    return lambda times: np.array([np.interp(times, known, row) for row in rows])


def _plant(stated: Stated, dt: float) -> Plant:
    """Return a plant with the model; decided parameters are in the middle."""
    known = [value for _, value in stated.parameters.values()]
    decided = [(low + high) / 2 for _, low, high in stated.decided.values()]
    values = np.array([*known, *decided])
    model = stated.problem().model
    return Plant(
        model,
        dt=dt,
        substeps=4,
        parameters=(lambda times: np.tile(values[:, None], (1, times.size)))
        if values.size
        else None,
        signals=_over_time(stated, model.ns),
        integrator="stiff" if stated.integrator == "stiff" else "rk4",
    )


def _loop(stated: Stated) -> RecedingHorizon:
    problem = stated.problem()
    if isinstance(problem.horizon, Free):
        # The horizon must be able to shrink to the last period.
        problem = replace(problem, horizon=replace(problem.horizon, lower=0.05))
    known = np.array([value for _, value in stated.parameters.values()])
    return RecedingHorizon(
        planner=Planner(problem, search=None, polish=IpoptOptions()),
        reference=_over_time(stated, problem.ns),
        parameters=(lambda time: known) if known.size else None,
        period=0.1 if stated.end_time is not None else None,
    )


@pytest.mark.parametrize("name", FEATURES)
def test_machine_code_gives_what_casadi_gives(name: str) -> None:
    stated = alone(name)
    ours = Ours(stated)
    point = drawn_point(stated, np.random.default_rng(0))
    given = point.controls, ours.start(point), ours.known
    compiled, mapped = (
        Fitness(ours.planner.tracer.shooting, backend=backend)
        for backend in ("llvm", "casadi")
    )
    assert compiled.backend == "llvm"
    found, expected = compiled.value(*given), mapped.value(*given)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", FEATURES)
def test_closed_loop_flies_three_steps_or_says_why_not(name: str) -> None:
    stated = alone(name)
    loop = _loop(stated)
    plant = _plant(stated, loop.dt)
    if name in REFUSED:
        with pytest.raises(InvalidProblemError, match=REFUSED[name]):
            simulate(plant, loop, stated.x0, steps=3, seed=0)
        return
    flight = simulate(plant, loop, stated.x0, steps=3, seed=0)
    assert len(flight.decisions) == 3 or flight.decisions[-1].is_last
    for decision in flight.decisions:
        assert decision.plans[0].feasible or stated.ends or stated.periodic
    assert np.isfinite(flight.dense_states).all()
    np.testing.assert_array_equal(flight.states[:, 0], stated.x0)


@pytest.mark.parametrize("name", FEATURES)
def test_record_keeps_the_answer(name: str, tmp_path: Path) -> None:
    stated = alone(name)
    answer = solve(stated.problem(), stated.x0, search=None, known=stated.known, seed=0)
    record = load(answer.save(tmp_path / "answer"))
    assert record.summary["cost"] == answer.cost
    assert record.summary["decided"] == dict(answer.decided)
    assert record.summary["status"] == answer.status.value
    for role, values in (
        ("times", answer.times),
        ("states", answer.states),
        ("controls", answer.controls),
        ("dense_states", answer.path.states),
    ):
        np.testing.assert_array_equal(record.arrays[role], values)
    assert record.arrays["states"].shape == (stated.x0.size, stated.nodes)
    assert record.arrays["state_names"].tolist() == list(answer.state_names)
    assert_same_multipliers(record.multipliers, answer.multipliers)


def assert_same_multipliers(
    found: Multipliers | None, expected: Multipliers | None
) -> None:
    assert (found is None) == (expected is None)
    if found is None or expected is None:
        return
    for part in ("costates", "controls", "states"):
        np.testing.assert_array_equal(getattr(found, part), getattr(expected, part))
    for part in ("path", "terminal"):
        kept, given = getattr(found, part), getattr(expected, part)
        assert list(kept) == list(given)
        for name, values in given.items():
            np.testing.assert_array_equal(kept[name], values)
    assert found.decided == expected.decided


def two_legs() -> tuple[OptimalControlProblem, Array]:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    leg = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - x),
        horizon=Free(0.2, 2.0),
        intervals=3,
        stage_cost=1 + u**2,
        bounds=Bounds(controls=(-3, 3)),
    )
    both = phases([leg, replace(leg, terminal=[(x, 1.0)])])
    return both.problem, both.start([0.0])


def test_phases_run_in_machine_code_are_recorded_and_flown_as_planned(
    tmp_path: Path,
) -> None:
    problem, x0 = two_legs()
    controls, start = np.full((1, 6), 0.7), lowered(problem).start(x0)
    values = [
        Fitness(problem, backend=backend).value(controls, start)
        for backend in ("llvm", "casadi")
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-11, atol=1e-12)
    answer = solve(problem, x0, search=None, seed=0)
    record = load(answer.save(tmp_path / "answer"))
    assert record.summary["decided"] == dict(answer.decided)
    np.testing.assert_array_equal(record.arrays["states"], answer.states)
    loop = RecedingHorizon(planner=Planner(problem, search=None, polish=IpoptOptions()))
    plant = Plant(
        problem.model,
        dt=problem.dt,
        substeps=40,
        parameters=None,
        decided=answer.decided,
        clock=problem.clock,
    )
    with pytest.raises(InvalidProblemError, match="phases cannot be run"):
        simulate(plant, loop, x0, steps=3, seed=0)
    flight = simulate(plant, OpenLoop(loop=loop), x0, steps=6, seed=0)
    # Its times are seconds, and the plant ends where the answer does.
    np.testing.assert_allclose(flight.times, answer.times, rtol=1e-6)
    np.testing.assert_allclose(flight.states[0], answer.states[0], atol=1e-6)


def lag(**more: object) -> OptimalControlProblem:
    x, u, gain = (ca.SX.sym(n) for n in ("x", "u", "gain"))
    stated: dict[str, object] = {
        "horizon": 2.0,
        "intervals": 6,
        "stage_cost": (x - 0.6) ** 2,
        "bounds": Bounds(controls=(0, 1)),
    }
    model = Model(states=x, controls=u, ode=gain * u - x, parameters=gain)
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "problem",
    [
        ensemble(lag(), {"gain": [0.8, 1.2]}, risk="worst"),
        lag(blocks=[1, 2, 3], decided={"gain": Free(0.9, 1.1)}),
        lag(bounds=Bounds(controls=(0, 1), integer=["u"]),
            decided={"gain": Free(0.9, 1.1)}),
        lag(control_shape="linear", decided={"gain": Free(0.9, 1.1)}),
        ensemble(lag(), {"gain": [0.8, 1.2]}, robust_horizon=2),
        lag(scales={"x": 0.3, "u": 2.0}, decided={"gain": Free(0.9, 1.1)}),
    ],
    ids=["uncertain parameters", "blocks", "whole numbers", "linear controls",
         "robust horizon", "sizes by name"],
)  # fmt: skip
def test_other_controls_run_in_machine_code_are_flown_and_recorded(
    problem: OptimalControlProblem, tmp_path: Path
) -> None:
    controls = np.array([[1.0, 0.0, 0.0, 1.0, 1.0, 1.0]])
    controls = np.repeat(controls, problem.model.nu, axis=0)
    planner = Planner(problem, search=None, polish=IpoptOptions())
    start, known, _ = planner.posed([0.0])
    values = [
        Fitness(problem, backend=backend).value(controls, start, known)
        for backend in ("llvm", "casadi")
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-11, atol=1e-12)
    answer = solve(problem, [0.0], search=None, seed=0)
    record = load(answer.save(tmp_path / "answer"))
    np.testing.assert_array_equal(record.arrays["states"], answer.states)
    assert record.summary["cost"] == answer.cost
    np.testing.assert_array_equal(record.member_costs, answer.member_costs)
    assert_same_multipliers(record.multipliers, answer.multipliers)

    def plant_step(x: Array, u: Array, dt: float) -> Array:
        return np.asarray(u + np.exp(-dt) * (x - u))

    class Sampled:
        step = staticmethod(plant_step)

    flight = simulate(
        Sampled(), RecedingHorizon(planner=planner), [0.0], steps=3, seed=0
    )
    assert len(flight.decisions) == 3
