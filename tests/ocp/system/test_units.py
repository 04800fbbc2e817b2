"""Units are carried to prints, figures, records and tables, and are compared."""

import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.drawing.problem_figures import labels_of
from swarmstart.ocp.statement.rewrites.chain import lowered
from swarmstart.ocp.statement.rewrites.delay import TransportDelay
from swarmstart.ocp.system.units import read_unit

X, Y, U, T = (ca.SX.sym(name) for name in ("x", "y", "u", "t"))
P = ca.SX.sym("p")


def conflicts(ode: list[ca.SX], units: dict[str, str]) -> tuple[str, ...]:
    model = ss.Model(
        states=ca.vertcat(X, Y),
        controls=U,
        parameters=P,
        time=T,
        ode=ca.vertcat(*ode),
        units=units,
    )
    return model.unit_conflicts()


@pytest.mark.parametrize(
    ("rate", "units"),
    [
        (Y, {"x": "m", "y": "m/s"}),
        (Y, {"x": "km", "y": "km/h"}),  # The time may be in hours.
        (-Y + 3 * U, {"x": "m", "y": "m/s", "u": "kg"}),  # 3 may have any unit.
        (P * U, {"x": "m", "u": "K"}),
        (Y * ca.cos(U), {"x": "m", "y": "m/s", "u": "rad"}),
        (Y**2 / X * T, {"x": "m", "y": "m/s", "u": ""}),
        (ca.sqrt(Y), {"x": "m", "y": "m^2/s^2"}),
        (U / P, {"x": "m", "u": "N s", "p": "kg"}),
        (Y, {"x": "kWh", "y": "kW"}),
        (X / T, {"x": "UAV", "y": "m"}),
        (X / T, {"x": "m"}),
        (ca.if_else(X > 0, Y, 0), {"x": "m", "y": "m/s"}),
    ],
)
def test_what_may_be_right_gives_no_word(rate: ca.SX, units: dict[str, str]) -> None:
    assert conflicts([rate, P], units) == ()


@pytest.mark.parametrize(
    ("rate", "units", "words"),
    [
        (Y, {"x": "m", "y": "m"}, "the rate of x is in m, expected m/s: x is in m"),
        (Y, {"x": "rad", "y": "deg/s"}, "the rate of x is in deg/s, expected rad/s"),
        (Y, {"x": "m", "y": "ft/s"}, "the rate of x is in ft/s"),
        (Y + U, {"y": "m/s", "u": "m/s^2"}, "m/s and m/s^2 are added or compared"),
        (ca.sin(U), {"u": "deg"}, "sin is taken of a value in deg"),
        (ca.exp(U), {"u": "m"}, "exp is taken of a value in m"),
        (Y * U, {"x": "m", "y": "m/s", "u": "m"}, "the rate of x is in"),
        (Y / U, {"x": "m", "y": "m/s", "u": "m"}, "the rate of x is in"),
        (ca.sqrt(Y), {"x": "m", "y": "m/s"}, "the rate of x is in"),
        (Y**3, {"x": "m", "y": "m/s"}, "the rate of x is in"),
        (1 / Y, {"x": "m", "y": "m/s"}, "the rate of x is in"),
        (X / T, {"x": "m", "y": "m"}, ""),
        (X * T, {"x": "m"}, "the rate of x is in"),
        (ca.fmin(Y, U), {"y": "m/s", "u": "m"}, "are added or compared"),
        (ca.atan2(Y, U), {"y": "m/s", "u": "m"}, "are added or compared"),
        (ca.if_else(X > Y, U, 0), {"x": "m", "y": "s"}, "are added or compared"),
        (ca.if_else(P > 0, U, 0), {"x": "m", "u": "m"}, "the rate of x is in m, "),
    ],
)
def test_a_contradiction_is_named(
    rate: ca.SX, units: dict[str, str], words: str
) -> None:
    found = conflicts([rate, 0 * U], units)
    assert bool(found) == bool(words)
    assert words in "".join(found)


@pytest.mark.parametrize(
    ("text", "factor"),
    [("m/s^2", 1.0), ("m/s2", 1.0), ("m.s-2", 1.0), ("N m", 1000.0), ("km/h", 1 / 3.6),
     ("deg", np.pi / 180), ("deg C", 1.0), ("%", 0.01), ("kg.m2/s2", 1000.0)],
)  # fmt: skip
def test_units_are_read_in_the_words_that_files_use(text: str, factor: float) -> None:
    unit = read_unit(text)
    base = {"N m": 1.0, "kg.m2/s2": 1.0}.get(text, factor)
    assert unit is not None
    # pint's base unit of a mass is the kilogram.
    assert unit.factor == pytest.approx(base)


@pytest.mark.parametrize("text", ["", "-", "UAV", "EUR/MWh", "m//s", "__import__", "("])
def test_labels_that_are_no_units_are_not_compared(text: str) -> None:
    assert read_unit(text) is None


def test_a_unit_of_an_unknown_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(ss.InvalidProblemError, match="did you mean 'speed'"):
        speed = ca.SX.sym("speed")
        ss.Model(states=speed, controls=U, ode=U, units={"sped": "m/s"})


def stated() -> ss.OptimalControlProblem:
    model = ss.Model(
        states=ca.vertcat(X, Y), controls=U, ode=ca.vertcat(Y, U),
        outputs={"double": X + X},
        units={"x": "m", "y": "m/s", "u": "m/s^2", "double": "m"},
    )  # fmt: skip
    return ss.OptimalControlProblem(
        model, horizon=2.0, intervals=8, stage_cost=U**2, terminal=[X - 1, Y],
        bounds=ss.Bounds(controls=(-4, 4)),
    )  # fmt: skip


def test_prints_figures_records_and_tables_have_the_units(tmp_path: Path) -> None:
    problem = stated()
    solution = ss.solve(problem, [0, 0], search=None, lanes=0, seed=0)
    assert "y 0 to" in repr(solution)
    assert "] m/s; " in repr(solution) or "] m/s\n" in repr(solution)
    assert labels_of(problem).of("u") == "u [m/s^2]"
    labels = [axes.get_ylabel() for axes in solution.plot().axes]
    assert {"x [m]", "y [m/s]", "u [m/s^2]", "double [m]"} <= set(labels)
    assert solution.to_dataframe().attrs["units"]["double"] == "m"
    solution.save(tmp_path / "solved")
    read = ss.load(tmp_path / "solved")
    assert dict(read.arrays["units"].tolist())["y"] == "m/s"


def test_a_run_and_its_record_have_the_units(tmp_path: Path) -> None:
    problem = stated()
    plant = ss.Plant(problem.model, dt=problem.dt, substeps=4)
    loop = ss.RecedingHorizon(planner=ss.Planner(problem, search=None))
    run = ss.simulate(plant, loop, [0, 0], steps=2, seed=0)
    assert run.units["u"] == "m/s^2"
    run.save(tmp_path / "flown")
    again = ss.load(tmp_path / "flown").trajectory
    assert again is not None
    assert dict(again.units) == dict(run.units)
    assert "y [m/s]" in [axes.get_ylabel() for axes in again.plot().axes]


def test_stacked_members_phases_and_ensembles_keep_the_units() -> None:
    problem = stated()
    two = ss.stack_models([problem.model, problem.model])
    assert two.units["y_1"] == "m/s"
    joined = ss.phases([problem, stated()]).problem.model
    assert joined.units["u"] == "m/s^2"
    loop = ss.phased_horizon([problem, stated()], period=0.25, search=None, polish=None)
    plant = loop.plant(substeps=4)
    assert plant.units["y"] == "m/s"
    pushed = ss.Model(
        states=X, controls=U, parameters=P, ode=P * U, units={"x": "m", "u": "N"}
    )
    one = ss.OptimalControlProblem(pushed, horizon=1.0, intervals=4, stage_cost=U**2)
    members = ss.ensemble(one, {"p": [1.0, 2.0]}).model
    assert members.units["u"] == "N"
    assert [members.units[name] for name in members.state_names] == ["m", "m"]


def test_a_delay_keeps_the_units() -> None:
    problem = replace(stated(), features=(TransportDelay({"u": 0.25}),))
    assert lowered(problem).core.model.units["x"] == "m"


def test_solve_solve_many_and_simulate_warn_of_units_at_their_call() -> None:
    """An angle in degrees: nothing is converted, and its sine is taken."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = ss.Model(
        states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0])),
        state_names=("angle", "rate"), units={"angle": "deg", "rate": "deg/s"},
    )  # fmt: skip
    problem = ss.OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=ca.sumsqr(x) + u**2,
        bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    loop = ss.RecedingHorizon(
        planner=ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    )
    plant, start = ss.Plant(model, dt=loop.dt, substeps=2), [0.1, 0.0]
    words = re.escape("sin is taken of a value in deg")
    for call in (
        lambda: ss.solve(problem, start, search=None, lanes=0, seed=0),
        lambda: ss.solve_many(problem, [[0.1], [0.0]], seed=0),
        lambda: ss.simulate(plant, loop, start, steps=1, seed=0),
    ):
        with pytest.warns(ss.UnitWarning, match=words) as found:
            call()
        assert {one.filename for one in found} == {__file__}
