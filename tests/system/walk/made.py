"""Valid objects that the calls of the walk are made of, each made once."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart import heuristics, ocp, terminal_set
from swarmstart.arrays import Array

START = np.zeros(2)
CONTROLS = np.zeros((1, 3))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@cache
def model() -> ss.Model:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u), outputs={"v": x[1]})


def problem_of(signals: int = 0, parameters: int = 0) -> ss.OptimalControlProblem:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    s, p = ca.SX.sym("s", signals), ca.SX.sym("p", parameters)
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u), parameters=p),
        horizon=1.0,
        intervals=3,
        stage_cost=u**2 + ca.sumsqr(x) + ca.sumsqr(s) + ca.sumsqr(p),
        bounds=ss.Bounds(controls=(-1, 1)),
        signals=s,
        integrator_tolerance=None,
    )


@cache
def problem() -> ss.OptimalControlProblem:
    x = model().states
    return ss.OptimalControlProblem(
        model(),
        horizon=1.0,
        intervals=3,
        stage_cost=model().controls ** 2 + ca.sumsqr(x),
        bounds=ss.Bounds(controls=(-1, 1)),
        integrator_tolerance=None,
    )


@cache
def planner() -> ss.Planner:
    return ss.Planner(problem(), search=None, polish=ss.IpoptOptions())


@cache
def loop() -> ss.RecedingHorizon:
    return ss.RecedingHorizon(planner=planner())


@cache
def plant() -> ss.Plant:
    return ss.Plant(model(), dt=problem().dt, substeps=1)


class Tank:
    """A plant of a user, with one state."""

    def step(self, x: Array, u: Array, dt: float) -> Array:
        return x + dt * (u - x)


@cache
def simulated_plan() -> ss.SimulatedPlan:
    return ss.solve_simulated(
        problem(), Tank(), [1.0, 0.0], rollouts=20, workers=0, seed=0, progress=False
    )


TANK = [sys.executable, "-c", """
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    found = {"states": ["level"], "controls": ["inflow"]}
    if "start_at" in asked:
        found = {"x": asked["start_at"]}
    elif "u" in asked:
        found = {"x": [asked["x"][0] + asked["dt"] * asked["u"][0]]}
    print(json.dumps(found), flush=True)
"""]  # fmt: skip
"""The command of a program that is a plant with one state."""


@cache
def plan() -> ss.Plan:
    return planner().plan(START, known=ss.Known(), guess=CONTROLS, rng=rng())


@cache
def decision() -> ss.Decision:
    return loop().decide(0.0, START, None, rng=rng())


@cache
def trajectory() -> ss.Trajectory:
    return ss.simulate(plant(), loop(), START, steps=2, seed=0)


@cache
def solution() -> ss.Solution:
    return ss.solve(problem(), [1, 0], search=None, lanes=0, seed=0)


@cache
def solutions() -> ss.Solutions:
    return ss.solve_many(problem(), [[1.0, 0.5], [0.0, 0.0]], seed=0)


@cache
def bound() -> ss.LowerBound:
    return ss.lower_bound(problem(), [1.0, 0.0], seed=0, work=0.01)


@cache
def fitness() -> ss.Fitness:
    return ss.Fitness(problem(), backend="casadi")


@cache
def table() -> ss.Table:
    return ss.table([0, 1, 2], [1.0, 2.0, 4.0])


@cache
def legs() -> tuple[ss.OptimalControlProblem, ...]:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    leg = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u),
        horizon=0.5,
        intervals=2,
        stage_cost=u**2,
        bounds=ss.Bounds(controls=(-4, 4)),
        terminal=[(x, 1)],
    )
    return leg, leg


@cache
def phased() -> ss.PhasedHorizon:
    return ss.phased_horizon(legs(), period=0.25, polish=ss.IpoptOptions())


@cache
def family() -> ca.Function:
    c, x0 = ca.SX.sym("c", 3), ca.SX.sym("x", 2)
    states = ca.repmat(x0, 1, problem().nodes)
    return ca.Function(
        "family", [c, x0, ca.SX(0, 1)], [states, c[0] + 0 * states[0, :]]
    )


@cache
def team() -> ss.Team:
    return ss.Team([ss.Agent(controller=loop())])


@cache
def local_team() -> ss.LocalTeam:
    return ss.LocalTeam([local_agent()], **local_parts(), order=(0,))


def swarm() -> ss.Swarm:
    return ss.Swarm(starts=np.eye(2, 3), goals=-np.eye(2, 3), distance=0.3)


def swarm_loop() -> ss.SwarmController:
    return ss.SwarmController(swarm())


@cache
def committed_parts() -> dict[str, Any]:
    """Return a team of one vehicle and its certified set."""
    posed = problem_of(signals=1)
    near = ss.terminal_set_of(
        posed, at=START, weights=ss.Weights(Q=np.eye(2), R=np.eye(1)), rng=rng()
    )
    planner = ss.Planner(posed, search=None, polish=ss.IpoptOptions())
    agent = ss.Agent(controller=ss.RecedingHorizon(planner=planner), shows=(0,))
    return {"team": ss.Team([agent]), "sets": [near], "distance": 1.0}


def committed_team() -> ss.CommittedTeam:
    return ss.CommittedTeam(**committed_parts())


def swarm_decision() -> ss.Decision:
    loop = swarm_loop()
    return loop.decide(0.0, loop.x0, None, rng=rng())


def obstacle() -> ss.Obstacle:
    return ss.Obstacle(radius=0.5, path=np.eye(2, 3), times=(0.0, 1.0))


def local_agent() -> ss.LocalAgent:
    return ss.LocalAgent(parameters=[0], reference=lambda t: np.zeros((2, t.size)))


@cache
def local_planner() -> ss.Planner:
    own = problem_of(signals=2, parameters=1)
    return ss.Planner(own, search=None, polish=ss.IpoptOptions())


def local_parts() -> dict[str, Any]:
    return {"planners": {0: local_planner()}, "range": 10.0, "position": (0,)}


@cache
def dynamics() -> ca.Function:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return ca.Function("f", [x, u], [ca.vertcat(x[1], u)])


@cache
def reference() -> ss.Reference:
    one = np.ones(1)
    return ss.Reference(x_ref=START, u_ref=0 * one, u_lower=-one, u_upper=one)


@cache
def weights() -> ss.Weights:
    return ss.Weights(Q=np.eye(2), R=np.eye(1))


OPTIONS = ss.ProofOptions(substeps=1, growth=False, work=0.1)


@cache
def design() -> ss.TerminalSet:
    return ss.sampled_terminal_set(
        dynamics(), reference(), dt=0.1, Q=np.eye(2), R=np.eye(1)
    )


@cache
def certified() -> ss.TerminalSet:
    return ss.certify(
        dynamics(), reference(), design(), rng=rng(), dt=0.1, options=OPTIONS
    )


@cache
def continuous() -> ss.TerminalSet:
    return terminal_set.continuous_terminal_set(
        dynamics(), reference(), Q=np.eye(2), R=np.eye(1)
    )


@cache
def change() -> terminal_set.Change:
    return terminal_set.continuous_change(dynamics(), continuous())


@cache
def step() -> ca.Function:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    held = ocp.held_step(model(), 0.1, method="rk4", substeps=1)
    return ca.Function("step", [x, u], [held(x, u, [])])


@cache
def dual_mode() -> ss.DualMode:
    return ss.DualMode(
        team(), sets=[held_set()], targets=[lambda time: START], uncertified=True
    )


@cache
def held_set() -> ss.TerminalSet:
    return ss.sampled_terminal_set(
        dynamics(), reference(), dt=problem().dt, Q=np.eye(2), R=np.eye(1)
    )


@cache
def box() -> ss.Box:
    return ss.Box(lower=-np.ones(2), upper=np.ones(2))


def search() -> ss.Search:
    return ss.Search(ss.RandomSearch(size=4), box(), rng=rng())


@cache
def search_result() -> ss.SearchResult:
    return ss.minimize(
        lambda x: (x**2).sum(axis=0), box(), budget=60, algorithm="random", seed=0
    )


@cache
def generation() -> heuristics.GenerationEvent:
    seen: list[heuristics.GenerationEvent] = []
    heuristics.run(
        search(), lambda x: x[0], budget=ss.Budget(evaluations=8),
        on_generation=seen.append,
    )  # fmt: skip
    return seen[0]


def nlp() -> tuple[ca.Opti, ca.MX, ca.MX]:
    opti = ca.Opti()
    x, u = opti.variable(1, 4), opti.variable(1, 3)
    opti.subject_to(x[1:].T == x[:3].T + u.T)
    opti.subject_to(x[0] == 0)
    opti.subject_to(opti.bounded(-1, u, 1))
    opti.minimize((x[3] ** 2 - 1) ** 2 + 0.1 * x[3])
    opti.solver("ipopt", {"ipopt.print_level": 0, "print_time": False})
    return opti, x, u


@cache
def folder() -> Path:
    return Path(mkdtemp())


@cache
def finished() -> ss.Run:
    return ss.run(
        "double_integrator", seed=0, search="none", figures=False, out=folder() / "run"
    )


@cache
def batch() -> ocp.BatchFunction:
    return ss.compile_batch(dynamics())


@cache
def rows() -> tuple[ss.Row, ...]:
    return tuple(ss.compare((problem(), [0, 0]), "ipopt", seeds=1, budget=30))


def warm_report() -> ss.WarmStartReport:
    one = ss.StartOutcome(
        cost=1.0, violation=0.0, status="Solve_Succeeded", iterations=3, seconds=0.1
    )
    return ss.WarmStartReport(
        winner="own start", own=one, searched=one, compile_seconds=0.0
    )
