"""Trials: histories, budgets, hard limits, the same bits, one judge for all."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import textwrap
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.campaign.trials import solvers
from swarmstart.cases.campaign.trials.building import Trial
from swarmstart.cases.campaign.trials.solvers import (
    judge_checkpoint,
    modules_of,
    solve_cell,
    solver_of,
)
from swarmstart.cases.campaign.trials.trial import answered
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.heuristics import Budget
from swarmstart.ocp import Bounds, Known, Model, OptimalControlProblem
from swarmstart.ocp.search.settings import search_settings
from swarmstart.tests.ocp.two_valleys import two_valleys

KEYS = {
    "of", "sense", "claimed_cost", "claimed_violation", "claimed_feasible",
    "verified_cost", "verified_violation", "feasible", "status", "evaluations",
    "counts", "seconds", "build_seconds", "compile_seconds", "judge_seconds",
    "stopped_by", "history", "plan", "repaired", "seconds_repair",
}  # fmt: skip
TIMED = {"seconds", "build_seconds", "compile_seconds", "judge_seconds"}
EVERY = (
    "de[size=20]", "lshade+ipopt", "ipopt", "sqpmethod", "repeated-ipopt",
    "multistart+ipopt", "memetic+ipopt", "solve", "scipy-de[popsize=2]",
    "pygmo-de1220+ipopt", "pygmo-cmaes",
)  # fmt: skip


def job_of(
    name: str, solver: str, seed: int = 0, *, repair: bool = False, **budget: float
) -> dict[str, Any]:
    how = solver_of(solver)
    is_own = how.family == "solve"
    resolved = resolve(
        read_document(name),
        search=None if is_own else how.search,
        polish=None if is_own else "ipopt" if how.polished else "none",
    )
    return {
        "settings": resolved.anonymous_settings(),
        "variant": resolved.variant,
        "solver": how.name,
        "budget": budget or {"evaluations": 2000},
        "seed": seed,
        "repair": repair,
    }


def untimed(found: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a result that must be equal each time."""
    kept = {key: value for key, value in found.items() if key not in TIMED}
    return {**kept, "history": {**found["history"], "seconds": []}}


@pytest.mark.parametrize("solver", EVERY)
def test_history_improves_and_ends_at_the_answer(solver: str, tmp_path: Path) -> None:
    found = solve_cell(job_of("van_der_pol", solver), tmp_path)
    assert found.keys() >= KEYS
    json.dumps(found, allow_nan=False)
    history = found["history"]
    assert len({len(part) for part in history.values()}) == 1
    evaluations, seconds = history["evaluations"], history["seconds"]
    assert evaluations == sorted(evaluations) and seconds == sorted(seconds)
    tolerance = 1e-6
    values = [
        (v if v > tolerance else 0.0, c)
        for c, v in zip(history["cost"], history["violation"], strict=True)
    ]
    assert all(after <= before for before, after in pairwise(values))
    assert history["cost"][-1] == found["claimed_cost"]
    assert history["violation"][-1] == found["claimed_violation"]
    assert evaluations[-1] == found["evaluations"]
    assert seconds[-1] <= found["seconds"] + 1e-3
    assert not list(tmp_path.iterdir())
    if solver != "solve":  # Which has no budget of evaluations.
        assert found["evaluations"] <= 2000 + 40


def test_evaluations_of_derivatives_are_counted_by_their_ratios(tmp_path: Path) -> None:
    found = solve_cell(job_of("double_integrator", "ipopt"), tmp_path)
    counts = found["counts"]
    assert counts["hessians"] > 0
    assert found["evaluations"] == round(
        counts["rollouts"]
        + counts["gradients"] * counts["gradient_ratio"]
        + counts["hessians"] * counts["hessian_ratio"]
    )
    assert found["stopped_by"] == "itself"


@pytest.mark.parametrize("solver", ["de", "lshade+ipopt", "pygmo-de", "solve"])
def test_the_same_bits_whether_the_cache_was_warm(solver: str, tmp_path: Path) -> None:
    job = job_of("double_integrator", solver, seed=3, evaluations=300)
    solvers._built.cache_clear()
    solvers._posed.cache_clear()
    cold = solve_cell(job, tmp_path)
    solve_cell({**job, "seed": 4}, tmp_path)
    warm = solve_cell(job, tmp_path)
    assert untimed(cold) == untimed(warm)


def test_the_same_bits_in_another_process(tmp_path: Path) -> None:
    job = job_of("double_integrator", "lshade[size=20]+ipopt", 1, evaluations=400)
    code = """
    import json, sys
    from pathlib import Path
    from swarmstart.cases.campaign.trials.solvers import solve_cell
    print(json.dumps(solve_cell(json.loads(sys.argv[1]), Path(sys.argv[2]))))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), json.dumps(job), str(tmp_path)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    there = json.loads(done.stdout)
    here = json.loads(json.dumps(solve_cell(job, tmp_path)))
    assert untimed(there) == untimed(here)


def test_banners_of_libraries_do_not_reach_the_output(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    solve_cell(job_of("double_integrator", "sqpmethod[max_iter=3]"), tmp_path)
    assert not capfd.readouterr().out


def test_a_budget_of_seconds_is_kept_by_every_kind_of_solver(tmp_path: Path) -> None:
    for solver in ("lshade+ipopt", "repeated-ipopt", "scipy-de", "solve"):
        found = solve_cell(job_of("passing_side", solver, seconds=0.1), tmp_path)
        assert found["seconds"] <= 1.0, solver  # Far more than it takes, for busy days.
        assert found["stopped_by"] in ("itself", "seconds"), solver


def test_the_system_ends_what_does_not_look_at_the_clock(tmp_path: Path) -> None:
    """A peer that never returns is judged by its best answer until then."""
    job = job_of("passing_side", "scipy-de", seconds=0.5)
    code = """
    import json, os, sys
    from pathlib import Path
    import numpy as np
    from swarmstart.cases.campaign.engine import wall_limit
    from swarmstart.cases.campaign.trials import peers, solvers

    def stuck(task):
        rng = np.random.default_rng(0)
        low, width = task.box.lower[:, None], task.box.width[:, None]
        for _ in range(3):
            task.objective(low + width * rng.random((task.box.dim, 50)))
        while True:
            pass

    peers.scipy_de = stuck
    wall_limit.declare_cell_process(os.open(os.devnull, os.O_WRONLY))
    solvers.solve_cell(json.loads(sys.argv[1]), Path(sys.argv[2]))
    """
    script = [sys.executable, "-c", textwrap.dedent(code)]
    done = subprocess.run(
        [*script, json.dumps(job), str(tmp_path)],
        capture_output=True,
        check=False,
        timeout=60,
        env=os.environ,
    )
    assert done.returncode == -signal.SIGALRM, done.stderr
    found = judge_checkpoint(job, tmp_path)
    assert found.keys() >= KEYS
    assert found["stopped_by"] == "hard limit"
    assert 50 <= found["evaluations"] <= 150
    assert found["history"]["cost"][-1] == found["claimed_cost"]
    assert found["verified_cost"] == pytest.approx(found["claimed_cost"], rel=1e-2)
    assert found["seconds"] == pytest.approx(0.5 * 1.1 + 0.25)
    json.dumps(found, allow_nan=False)
    # Without a checkpoint nothing was found, and nothing is claimed.
    empty = judge_checkpoint(job, tmp_path)
    assert empty.keys() >= KEYS and not empty["feasible"]
    assert empty["claimed_cost"] is None and empty["plan"] is None


def never_a_number() -> PlanningProblem:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.log(-1 - u**2) + x)
    problem = OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=u**2,
        bounds=Bounds(controls=(-1.0, 1.0)),
    )  # fmt: skip
    return PlanningProblem(problem=problem, x0=np.zeros(1), known=Known())


@pytest.mark.parametrize("solver", ["de", "de+ipopt", "ipopt", "scipy-de", "solve"])
def test_a_problem_that_is_never_a_number_is_feasible_for_nobody(solver: str) -> None:
    how, budget = solver_of(solver), Budget(evaluations=200)
    search = search_settings("de", budget) if how.family == "search" else None
    trial = Trial(solver=how, budget={"evaluations": 200}, seed=0, search=search)
    try:
        found = answered(never_a_number(), trial).as_json()
    except Exception as error:  # noqa: BLE001 - whichever it is, it must be ours
        assert type(error).__module__.startswith("swarmstart"), error
        return
    json.dumps(found, allow_nan=False)
    assert not found["feasible"] and not found["claimed_feasible"]
    assert found["claimed_cost"] is None or math.isfinite(found["claimed_cost"])


def test_the_plan_is_the_verified_path_at_the_grid(tmp_path: Path) -> None:
    found = solve_cell(job_of("passing_side", "ipopt"), tmp_path)
    plan = found["plan"]
    intervals = len(plan["time"]) - 1
    assert len(plan["states"]) == len(plan["state_names"])
    assert {len(row) for row in plan["states"]} == {intervals + 1}
    assert {len(row) for row in plan["controls"]} == {intervals}
    assert len(plan["controls"]) == len(plan["control_names"])
    assert np.diff(plan["time"]) == pytest.approx(plan["time"][-1] / intervals)


def test_the_plan_has_the_units_of_its_scenario(tmp_path: Path) -> None:
    plan = solve_cell(job_of("double_integrator", "ipopt"), tmp_path)["plan"]
    assert plan["units"] == {"position": "m", "speed": "m/s", "force": "m/s^2"}


def test_modules_are_those_that_names_of_the_job_stand_for() -> None:
    job = job_of("double_integrator", "lshade+ipopt")
    assert "swarmstart.heuristics.searches.lshade" in modules_of(job)
    peer = modules_of(job_of("double_integrator", "scipy-de"))
    assert "swarmstart.cases.campaign.trials.peers" in peer
    assert any(module.startswith("swarmstart.cases.kinds") for module in peer)


def test_what_a_scenario_defines_keeps_its_order(tmp_path: Path) -> None:
    """Its definitions follow from those before them, so they must not be sorted."""
    found = solve_cell(job_of("stirred_tank", "de", evaluations=200), tmp_path)
    assert found["evaluations"] == 200


def test_whole_numbers_stop_with_the_budget_too(tmp_path: Path) -> None:
    job = job_of("lotka_volterra_whole", "scipy-de[popsize=1]+ipopt", evaluations=1500)
    found = solve_cell(job, tmp_path)
    assert found["feasible"] and found["evaluations"] <= 1.2 * 1500


def test_an_nlp_solver_alone_is_compared_from_zero_controls_only() -> None:
    """Two valleys: from the middle of the bounds it would find the better one."""
    posed = PlanningProblem(problem=two_valleys(), x0=np.zeros(1), known=Known())
    trial = Trial(
        solver=solver_of("ipopt"), budget={"evaluations": 2000}, seed=0, search=None
    )
    plan = answered(posed, trial).plan
    assert plan is not None
    np.testing.assert_allclose(plan["controls"], -1, atol=0.05)
