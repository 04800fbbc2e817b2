"""Public constructors and functions refuse wrong values by name, with an own error.

Every argument of every call below gets each of WRONG in turn. Nothing else than an own
error may come of it, unless the call takes the value, which TAKEN must allow.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss

inf = float("inf")
WRONG: Mapping[str, object] = {
    "None": None,
    "text": "abc",
    "a number as text": "0.3",
    "bytes": b"x",
    "complex": 1 + 2j,
    "complex array": np.array([1 + 2j, 0.5j]),
    "NaN": float("nan"),
    "inf": inf,
    "-inf": -inf,
    "NaN array": np.array([np.nan, 1.0]),
    "-1": -1,
    "0": 0,
    "10**30": 10**30,
    "1e300": 1e300,
    "True": True,
    "list": [],
    "mapping": {},
    "tuple": (1, 2, 3),
    "object": object(),
    "function": lambda: None,
    "class": int,
    "set": {1, 2},
    "ragged list": [[1], [1, 2]],
    "strings": np.array(["a", "b"]),
    "objects": np.array([object(), None]),
    "empty array": np.zeros(0),
    "three axes": np.zeros((3, 7, 2)),
    "huge text": "x" * 100_000,
}
NONSENSE = frozenset(
    {"bytes", "complex", "complex array", "object", "class", "set", "objects"}
) | {"strings", "huge text"}
"""Values that no argument below may take."""

Call = tuple[Callable[..., object], dict[str, Any]]


def calls() -> dict[str, Call]:
    """Return the calls by name, each with valid arguments by name."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
    problem = ss.OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=3,
        stage_cost=u**2 + ca.sumsqr(x),
        bounds=ss.Bounds(controls=(-1, 1)),
        integrator_tolerance=None,
    )
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    plant = ss.Plant(model, dt=problem.dt, substeps=1)
    box, rng = ss.Box(lower=-np.ones(2), upper=np.ones(2)), np.random.default_rng(0)
    dynamics = ca.Function("f", [x, u], [ca.vertcat(x[1], u)])
    one, two = np.ones(1), np.zeros(2)
    rest = ss.Reference(x_ref=two, u_ref=0 * one, u_lower=-one, u_upper=one)
    stated: dict[str, Call] = {
        name: (thing, {k: p.default for k, p in parameters(thing).items()})
        for name in (
            "CMAES LSHADE ChaoticPSO DifferentialEvolution GeneticAlgorithm "
            "ParticleSwarm RandomSearch SelfAdaptiveDE Multistart Memetic"
        ).split()
        if (thing := getattr(ss, name))
    }
    stated["static_penalty"] = ss.static_penalty, {"weight": 1.0}
    stated["feasibility_first"] = ss.feasibility_first, {"tolerance": 0.0}
    stated["epsilon_level"] = (
        ss.epsilon_level,
        {"tolerance": 0.0, "quantile": 0.1, "control": 0.8, "power": 5.0},
    )
    stated["Search"] = (
        ss.Search,
        {"algorithm": ss.RandomSearch(), "box": box, "rng": rng, "radius": 0.1},
    )
    stated["Box.contains"] = box.contains, {"points": np.zeros((2, 3))}
    stated["Plant"] = ss.Plant, {"model": model, "dt": 0.1, "substeps": 2}
    stated["Plant.along"] = (
        plant.along,
        {"state": np.zeros(2), "controls": np.zeros((1, 3)), "time": 0.0},
    )
    stated["RecedingHorizon"] = (
        ss.RecedingHorizon,
        {"planner": planner, "append": "zero", "shift": True, "carries": True},
    )
    stated["OpenLoop"] = ss.OpenLoop, {"loop": loop, "repair": True}
    stated["Planner"] = ss.Planner, {"problem": problem, "search": None, "lanes": 0}
    stated["fly"] = (
        lambda **given: [*ss.fly(**given)],
        {"plant": plant, "controller": loop, "x0": [0, 0], "steps": 1, "rng": rng},
    )
    stated["multistart"] = (
        ss.multistart,
        {"planner": planner, "x0": [0, 0], "budget": ss.Budget(evaluations=30)}
        | {"rng": rng},
    )
    stated["solve"] = (
        ss.solve,
        {"problem": problem, "x0": [0, 0], "search": None, "lanes": 0, "polish": True}
        | {"guess": None, "repair": False, "seed": 0}
        | {"start": "must hold", "backend": None, "known": ss.Known()},
    )
    stated["compare"] = (
        ss.compare,
        {"problems": (problem, [0, 0]), "solvers": "ipopt", "seeds": 1, "budget": 30}
        | {"repair": False, "allow_python": False, "settings": {}},
    )
    stated["run"] = (
        ss.run,
        {"scenario": "double_integrator", "seed": 0, "search": "none"}
        | {"figures": False, "force": False, "allow_python": False, "settings": {}}
        | {"variant": None},
    )
    stated["SearchSettings"] = (
        ss.SearchSettings,
        {"algorithm": ss.LSHADE(), "budget": ss.Budget(evaluations=30)}
        | {"basins": 0, "radius": 0.1, "warm_start": "one", "when": "needed"},
    )
    stated["IpoptOptions"] = (
        ss.IpoptOptions,
        {"max_iterations": 9, "tolerance": 1e-8, "options": {}},
    )
    stated["ProofOptions"] = (
        ss.ProofOptions,
        {"substeps": 1, "growth": True, "work": 1.0},
    )
    stated["sampled_terminal_set"] = (
        ss.sampled_terminal_set,
        {"dynamics": dynamics, "reference": rest, "dt": 0.1}
        | {"Q": np.eye(2), "R": np.eye(1), "kappa": 0.0},
    )
    stated["Start"] = ss.Start, {"controls": np.zeros((1, 3)), "is_guess": False}
    stated["Known"] = ss.Known, {"time": 0.0}
    stated["compile_batch"] = (
        ss.compile_batch,
        {"function": dynamics, "precision": "double", "gradient": False},
    )
    return stated


def parameters(thing: Callable[..., object]) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a call by name."""
    return inspect.signature(thing).parameters


CALLS = calls()


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_value_ends_in_an_own_error_that_names_it(name: str) -> None:
    call, valid = CALLS[name]
    call(**valid)
    for parameter in valid:
        for what, value in WRONG.items():
            try:
                call(**{**valid, parameter: value})
            except ss.SwarmstartError as error:
                assert len(str(error)) < 1000, (parameter, what)
            else:
                assert what not in NONSENSE, f"{name}({parameter}={what}) is accepted"


def test_what_was_taken_without_a_look_is_refused() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        bounds=ss.Bounds(controls=(-1, 1)),
    )
    with pytest.raises(ss.InvalidProblemError, match=r"lanes must be .*, got 'abc'"):
        ss.Planner(problem, search=None, lanes="abc")  # type: ignore[arg-type]
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    plant = ss.Plant(problem.model, dt=problem.dt, substeps=1)
    # At the call, not with the first step.
    with pytest.raises(ss.InvalidProblemError, match=r"steps must be .*, got -1"):
        ss.fly(plant, loop, [0.0], steps=-1, rng=np.random.default_rng(0))
    with pytest.raises(ss.InvalidProblemError, match=r"x0 must be .* real numbers"):
        ss.solve(problem, np.array([1j]), seed=0)
    with pytest.raises(ss.InvalidSettingsError, match=r"size must be .* got 10000"):
        ss.LSHADE(size=10**30)
