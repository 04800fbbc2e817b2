"""Wrong answers that were once reported as right; each now has its true status.

The problems come from elsewhere, stated as a new user would; the numbers are from other
tools or closed forms.
"""

import re
import signal
import subprocess
import sys
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.heuristics import InvalidSettingsError
from swarmstart.ocp import (
    Agent,
    Bounds,
    Fitness,
    InvalidProblemError,
    Model,
    NlpOptions,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    SearchSettings,
    SolutionStatus,
    Source,
    Team,
    disc,
    simulate,
    solve,
    verified,
)
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.search.settings import search_settings

BACKENDS = ("llvm", "casadi")


# Not finite is not feasible.


def tank(lower: float | None = None) -> OptimalControlProblem:
    """h' = u - 0.5 sqrt(h) from 1 to 0.5 in 6 s, least int u^2: 0.455183."""
    h, u = ca.SX.sym("h"), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=h, controls=u, ode=u - 0.5 * ca.sqrt(h)),
        horizon=6.0,
        intervals=20,
        stage_cost=u**2,
        bounds=Bounds(
            controls=(0, 1), states=None if lower is None else (lower, np.inf)
        ),
        terminal=[h - 0.5],
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_empty_tank_has_violation_infinity(backend: str) -> None:
    fitness = Fitness(tank(), backend=backend)
    nothing, much = np.zeros((20, 1)), np.full((20, 1), 0.4)
    cost, violation = fitness.objective([1.0])(np.hstack([nothing, much]))
    assert violation[0] == np.inf
    assert np.isfinite([cost[1], violation[1]]).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("polish", ["ipopt", None])
def test_the_tank_is_solved_and_never_run_dry(backend: str, polish: str | None) -> None:
    solution = solve(tank(), [1.0], polish=polish, backend=backend, seed=0)
    assert solution.status.is_confirmed
    assert np.isfinite(solution.path.states).all()
    assert solution.cost >= 0.455183 - 1e-6
    if polish:
        assert solution.status is SolutionStatus.CONVERGED
        assert solution.cost == pytest.approx(0.455183, abs=1e-6)


def test_an_answer_that_leaves_the_numbers_says_when_and_where() -> None:
    problem = tank()
    plan = Planner(problem, search=None).evaluated(
        np.zeros((1, 20)), [1.0], source=Source.GUESS
    )
    solution = verified(problem, plan, [1.0])
    assert solution.status is SolutionStatus.NOT_FINITE
    # sqrt(h) falls from 1 by 0.25 t: empty at 4 s, which a step may reach earlier.
    assert "state h is not a finite number from 3.99" in solution.reason
    assert "bound the states" in solution.advice


def test_a_closed_loop_prefers_a_finite_plan() -> None:
    """x' = u - sqrt(x) held at 1 by a search: a plan that runs dry is never used."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=u - ca.sqrt(x))
    problem = OptimalControlProblem(
        model,
        horizon=4.0,
        intervals=8,
        stage_cost=u**2,
        bounds=Bounds(controls=(0, 2)),
    )
    settings = search_settings("lshade", 1000, None)
    planner = Planner(problem, search=settings)
    flown = simulate(
        Plant(model, dt=0.5, substeps=20),
        RecedingHorizon(planner=planner),
        [1.0],
        steps=4,
        rng=np.random.default_rng(0),
    )
    assert all(np.isfinite(d.plans[0].violation) for d in flown.decisions)
    assert np.isfinite(flown.states).all()


# Constraints hold at all stated points.


@pytest.mark.parametrize("intervals", [5, 10, 40])
def test_braking_power_is_limited_as_an_interval_begins_too(intervals: int) -> None:
    """-u v <= 1.2 from v = 2 to 0 in 2 s; checked at ends only, it rose to 8.61."""
    v, u = ca.SX.sym("v"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=v, controls=u, ode=u),
        horizon=2.0,
        intervals=intervals,
        stage_cost=u**2,
        bounds=Bounds(controls=(-10, 10)),
        constraints=[-u * v <= 1.2],
        terminal=[v],
    )
    solution = solve(problem, [2.0], seed=0)
    least = 2.0
    for _ in range(intervals):  # The hardest allowed braking.
        least -= 1.2 / least * problem.dt if least > 0 else 0.0
    if least > 0:  # Five intervals: 0.114 is the slowest.
        assert solution.status is SolutionStatus.INFEASIBLE
        assert solution.states[0, -1] == pytest.approx(least, abs=1e-4)
        return
    assert solution.status.is_confirmed
    at_begin = -solution.controls[0] * solution.states[0, :-1]
    assert at_begin.max() <= 1.2 * (1 + 1e-4)


def in_a_strip() -> OptimalControlProblem:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(
            states=x,
            controls=u,
            ode=ca.vertcat(x[1], u),
            state_names=("place", "speed"),
        ),
        horizon=3.0,
        intervals=15,
        stage_cost=u**2,
        bounds=Bounds(controls=(-30, 30), states=([-1, -np.inf], [1, np.inf])),
        terminal=[x],
    )


def test_a_start_outside_is_refused_by_name() -> None:
    with pytest.raises(
        InvalidProblemError, match=r"the bound of state place is broken by 4 .* at 0 s"
    ):
        solve(in_a_strip(), [5, 0], seed=0)
    solve(in_a_strip(), [1 + 1e-9, 0], budget=500, seed=0)


def test_a_start_that_may_violate_is_said_in_the_status() -> None:
    problem = in_a_strip()
    solution = solve(problem, [1.05, -2.0], start="may violate", seed=0)
    assert "the start is outside: the bound of state place" in solution.reason
    assert solution.plan.start_excess == pytest.approx(0.025)


def test_a_start_outside_may_come_back_between_the_checks() -> None:
    """The tank begins at 1 with h <= 0.9, and is below it at the first check."""
    h, u = ca.SX.sym("h"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=h, controls=u, ode=u - 0.5 * ca.sqrt(h)),
        horizon=3.0,
        intervals=6,
        stage_cost=u**2 + h,
        bounds=Bounds(controls=(0, 1), states=(0.01, 0.9)),
    )
    solution = solve(problem, [1.0], start="may violate", budget=2000, seed=0)
    assert solution.status is SolutionStatus.CONVERGED
    assert "the start is outside: the bound of state h" in solution.reason
    assert solution.path.states[0, 1] > 0.9


def test_a_closed_loop_goes_on_from_outside_and_counts_it() -> None:
    problem = in_a_strip()
    planner = Planner(problem, search=None, polish=None)
    plan = planner.evaluated(np.zeros((1, 15)), [3.0, 0.0], source=Source.GUESS)
    assert plan.start_excess == pytest.approx(1.0)
    inside = planner.evaluated(np.zeros((1, 15)), [0.5, 0.0], source=Source.GUESS)
    assert inside.start_excess == 0.0


# Verified along the path.

DISCS = [(2.0, 0.3, 0.9), (4.2, -0.6, 1.0), (6.2, 0.5, 1.0), (8.2, -0.3, 0.9)]


def four_discs(intervals: int, along: str = "points") -> OptimalControlProblem:
    """The four discs of the benchmarks, free end time by a stretch."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
    turn, stretch = u[0], u[1]
    ode = stretch * ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), turn)
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ode),
        horizon=1.0,
        intervals=intervals,
        stage_cost=stretch * (1 + 0.1 * turn**2),
        bounds=Bounds(controls=([-3, 10], [3, 20])),
        constraints=[
            disc(x[:2], centre=[a, b], radius=r, along=along)  # type: ignore[arg-type]
            for a, b, r in DISCS
        ],
        terminal=[x[:2] - ca.vertcat(10, 0)],
        substeps=6,
    )


def clearance(problem: OptimalControlProblem, controls: Array) -> float:
    """Return the smallest distance to a disc by DOP853, relative to its radius."""

    def rate(_: float, x: Array, u: Array) -> Array:
        return np.array([np.cos(x[2]), np.sin(x[2]), u[0]]) * float(u[1])

    state, nearest = np.zeros(3), np.inf
    for u in controls.T:
        flown = solve_ivp(
            rate,
            (0, problem.dt),
            state,
            method="DOP853",
            rtol=1e-10,
            atol=1e-12,
            args=(u,),
            t_eval=np.linspace(0, problem.dt, 400),
        )
        for a, b, r in DISCS:
            gap = np.hypot(flown.y[0] - a, flown.y[1] - b) / r - 1
            nearest = min(nearest, float(gap.min()))
        state = flown.y[:, -1]
    return nearest


@pytest.mark.parametrize("intervals", [8, 12, 20, 40])
@pytest.mark.parametrize("repair", [False, True])
def test_no_confirmed_answer_cuts_a_disc(intervals: int, repair: bool) -> None:
    problem = four_discs(intervals)
    solution = solve(problem, [0, 0, 0], seed=0, repair=repair)
    gap = clearance(problem, solution.controls)
    assert solution.status.is_confirmed == (gap >= -problem.path_tolerance)
    assert solution.status.is_confirmed == repair
    if not repair:
        assert solution.status is SolutionStatus.BROKEN
        worst = solution.path.broken[0]
        assert worst.relative == pytest.approx(-gap, rel=0.02)
        assert "repair=True" in solution.advice


@pytest.mark.parametrize("intervals", [12, 40])
def test_segments_get_their_margin_by_measurement(intervals: int) -> None:
    problem = four_discs(intervals, "segments")
    solution = solve(problem, [0, 0, 0], seed=0, repair=True)
    assert solution.status.is_confirmed
    assert clearance(problem, solution.controls) >= -problem.path_tolerance


# No scale.


@pytest.mark.parametrize("metre", [1.0, 1e-3])
def test_a_wrong_euler_answer_is_a_mismatch_in_any_unit(metre: float) -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    spring = u - metre * 9.81 * ca.sin(x[0] / metre)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], spring)),
        horizon=2.0,
        intervals=20,
        stage_cost=(u / metre) ** 2,
        bounds=Bounds(controls=(-20 * metre, 20 * metre)),
        terminal=[x - ca.vertcat(np.pi * metre, 0)],
        integrator="euler",
        substeps=1,
    )
    solution = solve(problem, [0, 0], seed=0)
    assert solution.status is SolutionStatus.MISMATCH
    assert "integrator='rk4'" in solution.advice


def test_the_optimum_does_not_depend_on_the_unit_of_the_cost() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")

    def answer(unit: float) -> tuple[float, Array]:
        problem = OptimalControlProblem(
            Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
            horizon=3.0,
            intervals=30,
            stage_cost=unit * (u**2 + x[0] ** 2 * ca.cos(x[1]) ** 2),
            terminal_cost=unit * ca.sumsqr(x),
            bounds=Bounds(controls=(-5, 5)),
        )
        solution = solve(problem, [2, 1], search=None, seed=0)
        assert solution.status is SolutionStatus.CONVERGED
        return solution.cost / unit, solution.controls

    cost, controls = answer(1.0)
    for unit in (1e-8, 1e-6, 1e8):
        again, other = answer(unit)
        assert again == pytest.approx(cost, rel=1e-9)
        np.testing.assert_allclose(other, controls, atol=1e-6)
    for unit in (2.0**-27, 2.0**27):
        again, other = answer(unit)
        assert again == cost
        np.testing.assert_array_equal(other, controls)


# Stiff, discrete, fixed, not smooth.


def test_a_stiff_model_is_named_as_the_cause() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    ode = ca.vertcat(-1000 * (x[0] - ca.cos(x[1])), u)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ode),
        horizon=2.0,
        intervals=20,
        stage_cost=u**2 + x[0] ** 2,
        bounds=Bounds(controls=(-5, 5)),
    )
    solution = solve(problem, [1, 0], budget=1000, lanes=0, seed=0)
    assert not solution.status.is_confirmed
    assert "the model is stiff" in solution.advice
    # Many starts find the other optimum, which says nothing of the stiffness.
    solution = solve(problem, [1, 0], budget=1000, seed=0)
    assert "the model is stiff" in solution.advice
    assert "substeps to at least 40" in solution.advice


def test_a_control_with_equal_bounds_is_fixed() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u[0] + u[1]),
        horizon=1.0,
        intervals=5,
        stage_cost=u[0] ** 2,
        bounds=Bounds(controls=([-5, 0.5], [5, 0.5])),
        terminal=[x - 2],
    )
    solution = solve(problem, [0.0], budget=1000, seed=0)
    assert solution.status is SolutionStatus.CONVERGED
    np.testing.assert_array_equal(solution.controls[1], 0.5)
    np.testing.assert_allclose(solution.controls[0], 1.5, atol=1e-6)


@pytest.mark.parametrize("split", [False, True])
def test_least_fuel_is_found_through_the_kink(split: bool) -> None:
    """|u| with rest to rest: an LP says 0.5371 here; IPOPT alone ended at 0.68."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2 if split else 1)
    push, spent = (u[0] - u[1], u[0] + u[1]) if split else (u, ca.fabs(u))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], push)),
        horizon=4.0,
        intervals=40,
        stage_cost=spent,
        bounds=Bounds(controls=(0 if split else -1, 1)),
        terminal=[x - ca.vertcat(1, 0)],
    )
    solution = solve(problem, [0, 0], seed=0)
    assert solution.cost == pytest.approx(0.537143, rel=1e-4)
    optimum = SolutionStatus.CONVERGED if split else SolutionStatus.FEASIBLE
    assert solution.status is optimum
    assert split or "touches a kink or jump of fabs(" in solution.reason


# What a user may write.


def line() -> OptimalControlProblem:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=[x[1], u]),  # type: ignore[arg-type]
        horizon=3.0,
        intervals=15,
        stage_cost=u**2,
        bounds=Bounds(controls=(-5, 5)),
        constraints=[x[0] <= 2, u >= -4],
        terminal=[(x, [1, 0])],
    )


REFUSED = NlpOptions(plugin="ipopt", options={"ipopt.no": 1})
OPTIMUM = 12 / 27
"""Rest to rest by 1 in 3 s: 12 d^2 / T^3, the limit of fine intervals."""


@pytest.mark.parametrize(
    "options",
    [
        {"search": "lshade", "budget": 2000},
        {"search": "none", "polish": "ipopt"},
        {"search": None, "polish": True},
        {"search": "cma", "budget": 1500, "polish": "sqpmethod"},
        {"polish": NlpOptions(plugin="sqpmethod"), "search": None},
    ],
    ids=str,
)
def test_names_numbers_lists_and_columns_are_taken(options: dict[str, object]) -> None:
    solution = solve(line(), ca.DM([0, 0]), seed=0, **options)  # type: ignore[arg-type]
    assert solution.status is SolutionStatus.CONVERGED
    assert solution.cost == pytest.approx(OPTIMUM, rel=5e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: solve(line(), [0, 0], search="lshad", seed=0), "lshad"),
        (lambda: solve(line(), [0, 0], polish="snopt", seed=0), "got 'snopt'"),
        (lambda: solve(line(), [0, 0], polish=3, seed=0), "polish must be"),  # type: ignore[arg-type]
        (lambda: solve(line(), [0, 0], budget="5s", seed=0), "budget must be"),  # type: ignore[arg-type]
        (lambda: solve(line(), [0, 0], budget=0, seed=0), "at least 1"),
        (lambda: solve(line(), [0, 0], order="deb", seed=0), "order must be"),  # type: ignore[arg-type]
        (lambda: solve(line(), ["a"], seed=0), "x0 must be an array"),
        (lambda: solve(line(), [0, 0, 0], seed=0), r"shape \(2,\), got \(3,\)"),
        (lambda: solve(line(), [0, np.nan], seed=0), "x0 must be finite"),
        (lambda: solve(line(), [0, 0], guess=["a"], seed=0), "guess must be None"),
        (lambda: solve("problem", [0, 0], seed=0), "problem must be an Opt"),  # type: ignore[arg-type]
        (lambda: solve(ca.Opti(), [0, 0], seed=0), "problem must be an Opt"),  # type: ignore[arg-type]
        (lambda: solve(line(), [0, 0], start="free", seed=0), "start must be"),  # type: ignore[arg-type]
        (lambda: solve(line(), [0, 0]), "seed"),
        (
            lambda: solve(
                line(), [0, 0], search=None, polish=REFUSED, seed=0
            ),
            "refuses its options",
        ),
    ],
)  # fmt: skip
def test_other_arguments_are_refused_in_one_sentence(
    call: Callable[[], object], message: str
) -> None:
    with pytest.raises((InvalidProblemError, InvalidSettingsError, ValueError)) as told:
        call()
    assert type(told.value).__module__.startswith("swarmstart.")
    assert re.search(message, str(told.value))


def test_a_foreign_plant_or_controller_is_refused() -> None:
    loop = RecedingHorizon(planner=Planner(line(), search=None))
    plant, rng = Plant(line().model, dt=0.2, substeps=2), np.random.default_rng(0)
    with pytest.raises(InvalidProblemError, match=r"plant must be a swarmstart\.Plant"):
        simulate("plant", loop, [0, 0], steps=1, rng=rng)  # type: ignore[arg-type]
    with pytest.raises(InvalidProblemError, match=r"controller must have decide\(\)"):
        simulate(plant, "loop", [0, 0], steps=1, rng=rng)  # type: ignore[arg-type]
    with pytest.raises(InvalidProblemError, match="x0 must be an array"):
        simulate(plant, loop, ["a", "b"], steps=1, rng=rng)


def test_what_a_user_holds_prints_in_a_few_lines() -> None:
    problem = line()
    solution = solve(problem, [0, 0], budget=500, seed=0)
    shown = {
        repr(problem.model): 1,
        repr(problem): 8,
        repr(solution): 12,
        repr(solution.plan): 2,
    }
    model = problem.model
    loop = RecedingHorizon(
        planner=Planner(problem, search=search_settings("lshade", 500, None))
    )
    team = Team([Agent(controller=loop)], order=[0])
    flown = simulate(
        Plant(model, dt=problem.dt, substeps=5),
        team,
        [0.0, 0.0],
        steps=2,
        rng=np.random.default_rng(0),
    )
    shown |= {repr(flown): 3, repr(team): 1, repr(flown.decisions[0]): 1}
    shown |= {repr(solution.path): 8}
    for text, lines in shown.items():
        assert text.count("\n") < lines
        assert "array" not in text and "SX(" not in text
        assert len(text) < 1200
    assert "cost" in repr(solution) and "advice" in repr(solution)


# The NLP, and Ctrl-C.


def test_the_nlp_of_four_hundred_intervals_is_one_stage_function() -> None:
    """Unrolling it took 29.7 s; now the graph has the same size for any N."""

    def size(intervals: int) -> int:
        program = multiple_shooting(four_discs(intervals))
        f = ca.Function("f", [program.nlp["x"], program.nlp["p"]], [program.nlp["g"]])
        return int(f.n_instructions())

    assert size(400) == size(100)


INTERRUPTED = """
import os, signal, sys, threading, time
import casadi as ca, numpy as np
import swarmstart as ss
x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
ode = ca.vertcat(x[2:], u - 9.81 * ca.sin(x[:2]) + ca.sin(x[1] - x[0]))
problem = ss.OptimalControlProblem(
    ss.Model(states=x, controls=u, ode=ode), horizon=20.0, intervals=400,
    stage_cost=ca.sumsqr(u), bounds=ss.Bounds(controls=(-3.0, 3.0)),
    terminal=[x - ca.vertcat(np.pi, np.pi, 0, 0)], substeps=10,
)
import swarmstart.ocp.answer.planner as module
whole, evaluated = module.{name}, threading.Event()
def progress(done, of, what):
    if done:
        evaluated.set()
def told(*arguments, **options):
    def kill():
        evaluated.wait(60)
        time.sleep(0.3)
        print("sent", time.time(), flush=True)
        os.kill(os.getpid(), signal.SIGINT)
    threading.Thread(target=kill).start()
    return whole(*arguments, **options)
module.{name} = told
try:
    ss.solve(
        problem, [0, 0, 0, 0], budget={budget}, lanes=0, seed=0, progress=progress
    )
except KeyboardInterrupt as stopped:
    print("caught", time.time(), flush=True)
    partial = stopped.partial
    print("partial", partial.controls.shape, partial.status.name, flush=True)
"""


@pytest.mark.parametrize(
    ("name", "budget"), [("searched", 10_000_000), ("polish_basins", 1000)]
)
def test_ctrl_c_ends_a_solve_with_the_best_so_far(name: str, budget: int) -> None:
    program = INTERRUPTED.format(name=name, budget=budget)
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert "caught" in done.stdout, done.stderr
    assert "partial (2, 400)" in done.stdout
    assert done.returncode == 0


def test_a_default_search_has_the_default_order() -> None:
    settings = search_settings("default", None, None)
    assert isinstance(settings, SearchSettings)
    assert settings.order is None
