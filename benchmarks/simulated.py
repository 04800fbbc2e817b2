"""Plans for simulators by a surrogate and by CMA-ES: docs/measured/simulated.md.

    python benchmarks/simulated.py --write docs/measured/simulated.md [--seeds 5]

Each simulator integrates a formula that the plan's model lacks in part. Costs are
compared with the optimum of that formula, which only the comparison knows. The settings
of the surrogate loop were chosen on other problems: a pendulum, van der Pol's
oscillator, a drone, a boat, two tanks, a cart with a pendulum, and a rocket.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
from fmpy import fmi2

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import command_of, head, page_options, publish, row
from swarmstart.export.controller.exported import compiler_command
from swarmstart.tests.simulators import pendulum

ROLLOUTS = 500
NEAR = 0.01
"""Excess over the optimum that is near."""
FIRST_SEED = 1
SLOW = 1000
"""Steps of the integrator in a step of a simulator that takes long."""
TEXT = "# Plans for simulators\n\n"


class Integrated:
    """A simulator whose formula its user does not know."""

    def __init__(self, model: ss.Model, dt: float, substeps: int = 10) -> None:
        """Compile its steps.

        Args:
            model: The formula.
            dt: Length of a step [s].
            substeps: Number of steps of the integrator in it.
        """
        self._plant = ss.Plant(model, dt=dt, substeps=substeps)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state after a step."""
        del dt
        return self._plant(x, u)[:, -1]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Case:
    """A simulator and the problem that is solved on it.

    Attributes:
        name: Name.
        lacks: What the model of the plan lacks.
        problem: The problem, with the model of the plan.
        true: The problem with the simulator's formula.
        x0: Initial state, shape (nx,).
    """

    name: str
    lacks: str
    problem: ss.OptimalControlProblem
    true: ss.OptimalControlProblem
    x0: Array

    def simulator(self, substeps: int = 10) -> Integrated:
        """Return the simulator."""
        step = self.problem.dt / self.problem.checks
        return Integrated(self.true.model, step, substeps)


def reactor() -> Case:
    """Return a stirred tank with a reaction that gives heat."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")

    def stated(rate: Callable[[ca.SX], ca.SX]) -> ss.OptimalControlProblem:
        used = rate(x[1]) * x[0]
        ode = ca.vertcat(1 - x[0] - used, -x[1] + 2 * used + 0.5 * (u - x[1]))
        return ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=ode), horizon=4.0, intervals=20,
            checks=4, substeps=1, stage_cost=(x[1] - 0.8) ** 2 + 0.02 * u**2,
            bounds=ss.Bounds(controls=(-1, 2)),
        )  # fmt: skip

    return Case(
        name="reactor", lacks="the growth of the reaction's rate with the temperature",
        problem=stated(lambda t: ca.SX(0.5)),
        true=stated(lambda t: 0.5 * ca.exp(t / (1 + t / 4))),
        x0=np.array([1.0, 0.0]),
    )  # fmt: skip


def arm() -> Case:
    """Return an arm of two links that lifts a load."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)

    def stated(load: float, friction: float) -> ss.OptimalControlProblem:
        first, second, w1, w2 = ca.vertsplit(x)
        end = 0.5 + load  # kg at the tip, and half of the second link
        coupled = end * ca.cos(first - second)
        mass = ca.blockcat([[1.0 + end, coupled], [coupled, end]])
        turned = end * ca.sin(first - second)
        force = ca.vertcat(
            u[0] - u[1] - turned * w2**2 - (1.0 + end) * 9.81 * ca.sin(first),
            u[1] + turned * w1**2 - end * 9.81 * ca.sin(second),
        ) - friction * ca.vertcat(ca.tanh(5 * w1), ca.tanh(5 * (w2 - w1)))
        ode = ca.vertcat(w1, w2, ca.solve(mass, force))
        miss = ca.vertcat(first - 1.5, second - 2.2, w1, w2)
        return ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=ode), horizon=1.5, intervals=30,
            checks=4, substeps=1, stage_cost=0.001 * ca.sumsqr(u),
            terminal_cost=20 * ca.sumsqr(miss),
            bounds=ss.Bounds(controls=([-30, -20], [30, 20])),
        )  # fmt: skip

    return Case(
        name="arm", lacks="most of the load, and the joints' friction",
        problem=stated(0.2, 0.0), true=stated(0.5, 0.8), x0=np.zeros(4),
    )  # fmt: skip


def car() -> Case:
    """Return a car that changes its lane: its tyres slide."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)

    def stated(slides: bool) -> ss.OptimalControlProblem:
        turn = x[3] * u[0] / 2.5
        if slides:
            turn = 0.6 * ca.tanh(turn / 0.6) / (1 + 0.01 * x[3] ** 2)
        ode = ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), turn, u[1])
        end = ca.vertcat(x[1] - 3, 3 * x[2], x[3] - 8)
        return ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=ode), horizon=3.0, intervals=30,
            checks=4, substeps=1,
            stage_cost=20 * u[0] ** 2 + 0.1 * u[1] ** 2 + 0.3 * (x[1] - 3) ** 2,
            terminal_cost=20 * ca.sumsqr(end),
            bounds=ss.Bounds(controls=([-0.4, -4], [0.4, 4])),
        )  # fmt: skip

    return Case(
        name="car", lacks="tyres that slide, and understeer",
        problem=stated(False), true=stated(True), x0=np.array([0.0, 0.0, 0.0, 8.0]),
    )  # fmt: skip


def crane() -> Case:
    """Return a trolley that carries a hanging load to a place, and stops it there."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")

    def stated(friction: float, drag: float) -> ss.OptimalControlProblem:
        _, speed, angle, turn = ca.vertsplit(x)
        load, length = 0.5, 1.0  # kg, m; the trolley has 1 kg
        wind = speed + length * turn * ca.cos(angle)  # of the load, to the right
        pull = drag * wind * ca.sqrt(wind**2 + 0.01)
        force = u - friction * speed - pull
        sine, cosine = ca.sin(angle), ca.cos(angle)
        swing = load * sine * (length * turn**2 + 9.81 * cosine)
        gains = (force + swing) / (1.0 + load * sine**2)
        bends = -(gains * cosine + 9.81 * sine + pull * cosine / load) / length
        ode = ca.vertcat(speed, gains, turn, bends)
        miss = ca.vertcat(x[0] - 2, speed, angle, turn)
        return ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=ode), horizon=3.0, intervals=30,
            checks=4, substeps=1, stage_cost=0.05 * u**2 + 0.5 * angle**2,
            terminal_cost=20 * ca.sumsqr(miss),
            bounds=ss.Bounds(controls=(-6, 6)),
        )  # fmt: skip

    return Case(
        name="crane", lacks="the friction of the trolley, and the drag of the load",
        problem=stated(0.0, 0.0), true=stated(0.8, 0.4), x0=np.zeros(4),
    )  # fmt: skip


def fermenter() -> Case:
    """Return a fermenter that is fed for the most biomass at its end."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")

    def stated(inhibits: float, upkeep: float) -> ss.OptimalControlProblem:
        biomass, sugar, volume = ca.vertsplit(x)
        rate = 0.5 * sugar / (0.3 + sugar + inhibits * sugar**2)
        thin = u / volume
        ode = ca.vertcat(
            (rate - upkeep) * biomass - thin * biomass,
            -2 * rate * biomass + thin * (10 - sugar),
            u,
        )
        return ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=ode), horizon=10.0, intervals=20,
            checks=4, substeps=2, stage_cost=0.02 * u**2 + 0.1 * sugar**2,
            terminal_cost=20 - biomass * volume, bounds=ss.Bounds(controls=(0, 1)),
        )  # fmt: skip

    return Case(
        name="fermenter", lacks="sugar that slows the growth, and the cells' upkeep",
        problem=stated(0.0, 0.0), true=stated(0.3, 0.05),
        x0=np.array([0.5, 1.0, 1.0]),
    )  # fmt: skip


CASES = (reactor, arm, car, crane, fermenter)
METHODS: dict[str, dict[str, Any]] = {
    "surrogate": {"surrogate": True},
    "CMA-ES": {"surrogate": False, "search": "cma"},
    "L-SHADE": {"surrogate": False, "search": "lshade"},
}


def table(case: Case, seeds: Sequence[int]) -> tuple[list[str], dict[str, float]]:
    """Return the rows of a case, and the worst excess over the optimum of a method."""
    best = ss.solve(case.true, case.x0, seed=0, progress=False)
    model = ss.solve(case.problem, case.x0, seed=0, progress=False)
    value = simulated_cost(case, model.controls)
    lines = [
        f"## {case.name.capitalize()}", "",
        f"The plan's model lacks {case.lacks}. The optimum of the formula is "
        f"{best.cost:.6g}; the optimal controls of the model cost {value:.6g}.", "",
        *head("method", "above the optimum, median", "worst", "roll-outs, median",
              "CPU [s], median"),
    ]  # fmt: skip
    worst = {}
    for name, settings in METHODS.items():
        above, counts, seconds = [], [], []
        for seed in seeds:
            begun = time.process_time()
            found = ss.solve_simulated(
                case.problem, case.simulator(), case.x0, rollouts=ROLLOUTS, workers=0,
                seed=seed, progress=False, **settings,
            )  # fmt: skip
            seconds.append(time.process_time() - begun)
            above.append(found.cost / best.cost - 1)
            counts.append(found.rollouts)
        worst[name] = max(above)
        lines.append(
            row(name, f"{np.median(above):.2%}", f"{worst[name]:.2%}",
                f"{np.median(counts):.0f}", f"{np.median(seconds):.1f}")
        )  # fmt: skip
    return [*lines, ""], worst


def simulated_cost(case: Case, controls: Array) -> float:
    """Return the cost of controls by the simulator."""
    found = ss.solve_simulated(
        case.problem, case.simulator(), case.x0, rollouts=1, surrogate=False,
        search="random", guess=controls, workers=0, seed=0, progress=False,
    )  # fmt: skip
    return found.cost


def finding(worst: Mapping[str, Mapping[str, float]], seeds: int) -> str:
    """Return the finding in one sentence.

    Args:
        worst: Case -> method -> worst excess over the optimum, relative to it.
        seeds: Number of seeds.
    """
    near = {
        method: [name for name, one in worst.items() if one[method] <= NEAR]
        for method in METHODS
    }
    found = (
        "Five simulators, of a reactor, an arm, a car, a crane and a fermenter, are "
        "used without their formulas. On "
        f"{len(near['surrogate'])} of {len(worst)}, plans by a surrogate model that is "
        f"fitted to at most {ROLLOUTS} rollouts cost at most {NEAR:.0%} more than the "
        f"true optimum, with each of {seeds} seeds; CMA-ES with as many rollouts "
        f"achieves this on {len(near['CMA-ES']) or 'none'}"
    )
    for name, one in worst.items():
        if name in near["surrogate"]:
            continue
        found += (
            f"; on the {name} the worst plan costs {1 + one['surrogate']:.0f} times "
            f"the optimum, with CMA-ES {1 + one['CMA-ES']:.0f} times"
        )
    return found + "."


def with_workers() -> str:
    """Return how much faster a search is with two worker processes, in words."""
    case = reactor()
    slow = case.simulator(SLOW)
    spent, controls = [], []
    for workers in (1, 2):
        begun = time.perf_counter()
        found = ss.solve_simulated(
            case.problem, slow, case.x0, rollouts=400, surrogate=False,
            search="lshade", workers=workers, seed=FIRST_SEED, progress=False,
        )  # fmt: skip
        spent.append(time.perf_counter() - begun)
        controls.append(found.controls)
    same = (
        "the same plan" if np.array_equal(controls[0], controls[1]) else "another plan"
    )
    return (
        f"**Workers.** L-SHADE with 400 roll-outs of {spent[0] / 0.4:.0f} ms each (the "
        f"reactor, integrated in smaller steps) takes {spent[0]:.1f} s with one worker "
        f"process and {spent[1]:.1f} s with two, {spent[0] / spent[1]:.2f} times less, "
        f"and finds {same}."
    )


def of_an_fmu() -> str:
    """Return how much time `FmuPlant` adds to the calls of FMPy, in words."""
    count, h = 20_000, 0.1
    ours, theirs = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = pendulum.built(Path(folder), "2.0", compiler_command())
        plant = ss.FmuPlant(file, states=["angle", "speed"], controls=["torque"])
        slave = opened_by_fmpy(file, folder)
        torques = np.random.default_rng(0).uniform(-1, 1, (count, 1))
        for _ in range(5):
            x = plant.start_at([0.25, 0.0])
            begun = time.process_time()
            for torque in torques:
                x = plant.step(x, torque, h)
            ours.append(time.process_time() - begun)
            slave.reset()
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()
            slave.exitInitializationMode()
            begun, now = time.process_time(), 0.0
            for torque in torques:
                slave.setReal([1], torque.tolist())
                slave.doStep(now, h)
                found = slave.getReal([2, 3])
                now += h
            theirs.append(time.process_time() - begun)
            if found != x.tolist():
                raise AssertionError("expected the same states")
        plant.close()
        slave.freeInstance()
    each, own = (1e6 * float(np.median(one)) / count for one in (ours, theirs))
    return (
        f"**FMU.** A step of a pendulum as an FMU takes {each:.1f} us by `FmuPlant` "
        f"and {own:.1f} us by FMPy's own calls for the same ({each / own:.2f} times; "
        f"medians of 5 runs of {count} steps in turn, with the same bits)."
    )


def opened_by_fmpy(file: Path, folder: str) -> Any:
    """Return an FMU of version 2.0, opened by FMPy alone."""
    described = fmpy.read_model_description(str(file))
    slave = fmi2.FMU2Slave(
        guid=described.guid, unzipDirectory=fmpy.extract(str(file), f"{folder}/open"),
        modelIdentifier=described.coSimulation.modelIdentifier, instanceName="alone",
    )  # fmt: skip
    slave.instantiate()
    return slave


def page(seeds: int, command: str) -> list[str]:
    """Return the lines of the page below its title."""
    which = range(FIRST_SEED, FIRST_SEED + seeds)
    tables, worst = [], {}
    more = with_workers(), of_an_fmu()  # First, while the machine has nothing else.
    for case in (made() for made in CASES):
        lines, worst[case.name] = table(case, which)
        tables += lines
    return [
        finding(worst, seeds),
        "",
        f"Made by `{command}`. The plan's model, of the user, lacks a part; the "
        "surrogate is this model with a correction fitted to rollouts ([plans for a "
        "simulator](../simulators.md)). Each simulator integrates the true formula, "
        "which only the judgement of the results uses, in steps ten times shorter than "
        "those of the plan's model; costs are integrated along the simulator's "
        "rollouts by Simpson's rule. The settings of the surrogate loop were chosen on "
        "seven other problems. The search with a surrogate stops by itself when "
        "predicted and simulated costs agree and plans get no better. CPU times are "
        "mostly those of "
        "planning and searching, since these simulators take little time.",
        "",
        *tables,
        "The friction of the arm's joints changes steeply at rest (tanh of five times "
        "the speed). The polynomials of the surrogate follow this badly, and the arm's "
        "optimum is small beside the costs of other motions. Two changes were tried on "
        "the arm and are no better: more monomials, and new plans that stay near the "
        "best one. Earlier, a rocket, with seven states and controls together, was "
        "among the three problems. It is now among the problems on which the settings "
        "were chosen. With these settings its plans end within 0.7% of the optimum "
        "with two seeds. Crane and fermenter were added last: they were stated, and "
        "then run once, without a change.",
        "",
        "## Workers and FMUs",
        "",
        more[0],
        "",
        more[1],
        "",
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the page, and write it to a file if that is asked for."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args(arguments)
    command = command_of("benchmarks/simulated.py", arguments)
    publish(page(options.seeds, command), options, TEXT)
    return 0


if __name__ == "__main__":
    # Workers import the class of a simulator, which a program itself cannot give them.
    from swarmstart.benchmarks import simulated

    raise SystemExit(simulated.main())
