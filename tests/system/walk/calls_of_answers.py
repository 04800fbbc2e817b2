"""Calls of the walk: options, planning and answers."""

from __future__ import annotations

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import swarmstart as ss
from swarmstart import ocp
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import Call, Calls, record, with_defaults


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    return {
        **_options(),
        **_fitness(),
        **_planning(),
        **_solving(),
        **_records(),
        **_foreign(),
    }


def _options() -> Calls:
    box = ss.Box(lower=-np.ones(3), upper=np.ones(3))
    found: Calls = {
        "IpoptOptions": with_defaults(ss.IpoptOptions, options={}),
        "NlpOptions": with_defaults(ss.NlpOptions, plugin="sqpmethod", options={}),
        "Memetic": with_defaults(ss.Memetic),
        "Memetic.population": Call(ss.Memetic().population, {"evaluations": 300}),
        "Multistart": with_defaults(ss.Multistart),
        "SearchSettings": with_defaults(
            ss.SearchSettings,
            algorithm=ss.LSHADE(),
            budget=ss.Budget(evaluations=30),
            order=ss.default_order(),
        ),
        "population_of": Call(
            ocp.population_of, {"algorithm": ss.LSHADE(), "evaluations": 300}
        ),
        "Start": with_defaults(ss.Start, controls=made.CONTROLS),
        "Known": with_defaults(ss.Known),
        "TrajectoryFamily": Call(
            ss.TrajectoryFamily,
            {"box": box, "trajectory": made.family()},
        ),
    }
    for name, options in (
        ("IpoptOptions", ss.IpoptOptions()),
        ("NlpOptions", ss.NlpOptions(plugin="sqpmethod")),
    ):
        found[f"{name}.settings"] = with_defaults(
            options.settings, near=False, warm=False
        )
    return found


def _fitness() -> Calls:
    fitness = made.fitness()
    one = {"controls": made.CONTROLS, "x0": made.START, "known": ss.Known()}
    return {
        "Fitness": with_defaults(ss.Fitness, problem=made.problem(), backend="casadi"),
        "Fitness.objective": Call(
            fitness.objective, {"x0": made.START, "known": ss.Known()}
        ),
        "Fitness.value": Call(fitness.value, one),
        "Fitness.states": Call(fitness.states, one),
        "Fitness.followed": Call(fitness.followed, one),
        "Fitness.decision": Call(
            fitness.decision, {"controls": made.CONTROLS, "x0": made.START}
        ),
        "Fitness.with_threshold": Call(
            fitness.with_threshold,
            {"x0": made.START, "states": np.zeros((2, 4)), "known": ss.Known()},
        ),
        "Polisher": with_defaults(
            ocp.Polisher, fitness=fitness, options=ss.IpoptOptions()
        ),
        "Polisher.__call__": with_defaults(
            ocp.Polisher(fitness, ss.IpoptOptions()).__call__,
            controls=made.CONTROLS,
            x0=made.START,
        ),
    }


def _planning() -> Calls:
    planner = made.planner()
    start = {"x0": made.START, "known": ss.Known()}
    return {
        "Planner": with_defaults(ss.Planner, problem=made.problem(), search=None),
        "Planner.plan": with_defaults(
            planner.plan, **start, guess=made.CONTROLS, rng=made.rng()
        ),
        "Planner.posed": with_defaults(planner.posed, **start),
        "Planner.as_begun": with_defaults(planner.as_begun, **start),
        "Planner.outside": Call(planner.outside, start),
        "Planner.evaluated": Call(
            planner.evaluated,
            {**start, "controls": made.CONTROLS, "source": ss.Source.GUESS}
            | {"value": None},
        ),
        "Planner.with_budget": Call(
            planner.with_budget, {"budget": ss.Budget(evaluations=30)}
        ),
        "multistart": with_defaults(
            ss.multistart,
            planner=planner,
            x0=[0, 0],
            budget=ss.Budget(evaluations=30),
            rng=made.rng(),
        ),
        "verified": with_defaults(
            ocp.verified, problem=made.problem(), plan=made.plan(), x0=made.START
        ),
    }


def _solving() -> Calls:
    solution, problem = made.solution(), made.problem()
    bound = made.bound()
    return {
        "solve": with_defaults(
            ss.solve, problem=problem, x0=[1, 0], search=None, lanes=0, seed=0
        ),
        "solve_many": with_defaults(
            ss.solve_many, problem=problem, x0s=[[1.0, 0.5], [0.0, 0.0]], seed=0
        ),
        "Solutions": record(made.solutions()),
        "Solutions.load": Call(
            ss.Solutions.load, {"path": _saved_solutions(), "problem": problem}
        ),
        "Solutions.sensitivity": Call(
            made.solutions().sensitivity, {"by": ("x0",), "threads": 1}
        ),
        "Solutions.save": Call(
            lambda **given: made.solutions().save(
                **{"path": _new_folder() / "answers.npz", **given}
            ),
            {"force": True},
        ),
        "Solutions.save to": Call(
            made.solutions().save,
            {"path": _new_folder() / "answers.npz", "force": True},
        ),
        "lower_bound": with_defaults(
            ss.lower_bound, problem=problem, x0=[1, 0], seed=0, work=0.001
        ),
        "Solution": record(solution),
        "Solution.as_guess": Call(solution.as_guess, {"problem": problem}),
        "Solution.beside": Call(solution.beside, {"bound": bound}),
        "Solution.sensitivity": Call(solution.sensitivity, {"by": ("x0",)}),
        "Solution.linearised": Call(solution.linearised, {"time": 0.5}),
        "Solution.save": Call(
            lambda **given: solution.save(**{"folder": _new_folder(), **given}),
            {"force": True},
        ),
        "Solution.save to": Call(
            solution.save, {"folder": _new_folder(), "force": True}
        ),
        "LowerBound": record(bound),
        "LowerBound.gap": Call(bound.gap, {"cost": 1.0}),
        "OptimalityGap": record(solution.beside(bound)),
        "OptimalityGap.of": Call(
            ss.OptimalityGap.of, {"bound": bound, "cost": 1.0, "tolerance": 0.0}
        ),
        "OptimalityGap.told": Call(
            solution.beside(bound).told, {"answer": "the answer"}
        ),
    }


def _new_folder() -> Path:
    return Path(mkdtemp())


def _saved_solutions() -> Path:
    return made.solutions().save(_new_folder() / "answers.npz")


def _records() -> Calls:
    plan = made.plan()
    polished = ocp.Polisher(made.fitness(), ss.IpoptOptions())(
        made.CONTROLS, made.START
    )
    return {
        "Plan": record(plan),
        "SearchReport": record(plan.search),
        "SearchReport.lines": with_defaults(plan.search.lines),
        "SearchReport.told": with_defaults(plan.search.told),
        "Multipliers": record(made.solution().multipliers),
        "Sensitivities": record(made.solutions().sensitivity()),
        "Sensitivity": record(made.solution().sensitivity()),
        "Polished": record(polished),
        "StartOutcome": record(made.warm_report().own),
        "WarmStartReport": record(made.warm_report()),
    }


def _foreign() -> Calls:
    opti, x, u = made.nlp()
    return {
        "warm_start": with_defaults(
            ss.warm_start, nlp=opti, controls=[u], states=[x], budget=300
        ),
    }
