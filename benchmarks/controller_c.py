"""Controllers in C against the library: docs/measured/controller_c.md.

    python benchmarks/controller_c.py --write docs/measured/controller_c.md
        [--steps 300] [--random 20000] [pendulum van_der_pol ...]

Each controller runs in closed loop with its own model; every 50 steps a random kick
moves the state. At each step the library's lanes (twin.py) decide on the same state,
each with its own memory; so do builds with other optimisations. The time of a step is
compared with that of the library's own closed loop, with its search, from the same
start. A sanitized build takes random states, huge and small ones, infinities and NaN.
"""

import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import command_of, head, page_options, publish, row
from swarmstart.cases.commands.actions.exporting_code import controller_of
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.export.controller.exported import FLAGS, compiler_command
from swarmstart.export.controller.twin import Twin
from swarmstart.tests.export.controller import controllers

KICK = 50
SAME = 1e-9
Loop = ss.RecedingHorizon | ss.DualMode
SHIPPED = {
    "van_der_pol": ("polish=ipopt",),
    "formation_v": (
        "search.when=needed",
        "polish=ipopt",
        "avoidance.along=points",
        "prediction.checks=1",
    ),
    "formation_obstacle_uav3": (
        "search.when=needed",
        "polish=ipopt",
        "prediction.substeps=1",
    ),
    "close_formation": (
        "search.when=needed",
        "polish=ipopt",
        "prediction.intervals=10",
        "prediction.horizon_s=1",
        "leader_as_candidate=false",
    ),
}
"""Shipped scenario -> settings with which it can be exported."""
OTHERS = ("-O0", "-O3")
"""Optimisations beside that of FLAGS, which must give the same bits."""
CASES: dict[str, tuple[str, Callable[[], controllers.Case]]] = {
    "pendulum": ("2 states, 20 intervals", lambda: controllers.pendulum("lshade")),
    "dual_mode": (
        "a double integrator with a terminal set, 10 intervals",
        controllers.dual_mode,
    ),
    "way_round": (
        "a point round a disc, 4 states, 20 intervals",
        controllers.way_round,
    ),
    "tracking": (
        "a lag with a parameter, a signal, a soft limit and costs of change",
        controllers.tracking,
    ),
    "curved": ("powers, exponentials and angles, 2 states", controllers.curved),
}
"""Name -> what it is, and the controller with its initial state."""
TEXT = "# Controllers in C\n\n"
RANDOM = r"""
#include "NAME.h"
#include <math.h>
#include <stdio.h>
static NAME_memory m;
static unsigned long long state = 88172645463325252ull;
static double next(void)
{
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return (double)(state >> 11) / 9007199254740992.0;
}
int main(void)
{
  static const double lower[] = {LOWER}, upper[] = {UPPER};
  NAME_real x[NAME_NX], u[NAME_NU]GIVEN;
  int i;
  long step;
  NAME_reset(&m);
  for (step = 0; step < STEPS; ++step) {
    for (i = 0; i < NAME_NX; ++i) {
      const double size = pow(10.0, -3 + 15 * next() * next());
      x[i] = (NAME_real)(size * (2 * next() - 1));
      if (next() < 0.01) {
        x[i] = (NAME_real)(next() < 0.5 ? NAN : next() < 0.5 ? INFINITY : 1e300);
      }
    }
    NAME_step(&m, xPASSED, u);
    for (i = 0; i < NAME_NU; ++i) {
      if (!(u[i] - u[i] == 0 && u[i] >= lower[i] && u[i] <= upper[i])) {
        return 1;
      }
    }
    if (m.operations > NAME_MOST_OPERATIONS) {
      return 2;
    }
  }
  return 0;
}
"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Measured:
    """Results of a controller.

    Attributes:
        name: Its name.
        what: What it is.
        same: Share of the steps whose control is that of the lanes, within SAME.
        bits: True if the builds of OTHERS gave the same bits at all steps.
        step_us: Mean time of a step [us].
        faster: Ratio of the mean times of a step, the library's loop by it.
        cost: Ratio of the costs of a flight, its by the library's.
        kilobytes: Size of the object with -O2 and -Os.
        operations: Most operations of a step, by the bound.
        is_clean: True if the sanitizers said nothing, and all bounds were kept.
    """

    name: str
    what: str
    same: float
    bits: bool
    step_us: float
    faster: float | None
    cost: float | None
    kilobytes: tuple[float, float]
    operations: float
    is_clean: bool


def made_of(
    name: str, starts: int, iterations: int = 100
) -> tuple[str, ss.CExport, Loop]:
    """Return what a controller is, its export, and the controller itself."""
    seen: tuple[Array, ...] = ()
    if name in SHIPPED:
        what = "shipped, with " + ", ".join(f"`{one}`" for one in SHIPPED[name])
        resolved = resolve(read_document(name), assignments=SHIPPED[name])
        controller, x0, seen = controller_of(
            flight_of(resolved.posed(), resolved.scenario)
        )
    else:
        what, build = CASES[name]
        controller, start = build()
        x0 = np.asarray(start)
    made = ss.export_c(
        controller, x0, name=name, seen=seen, starts=starts, iterations=iterations
    )
    return what, made, controller


def measured(name: str, steps: int, random: int) -> Measured:
    """Run a controller in C beside the library's lanes."""
    what, made, controller = made_of(name, starts=16)
    compiled, twin = made.controller(), Twin(made.posed, iterations=made.iterations)
    others = [made.controller(FLAGS[0], one, *FLAGS[2:]) for one in OTHERS]
    rng, nx = np.random.default_rng(0), made.posed.problem.model.nx
    x: Array = np.asarray(made.posed.x0)[: nx - made.posed.remembered.size]
    lower, upper = made.posed.problem.control_limits
    size = made.posed.lane.sizes.states[: x.size]
    same, bits, took, most = 0, True, np.zeros(steps), 0
    for step in range(steps):
        if step % KICK == KICK - 1:
            x = x + 0.1 * size * rng.normal(size=x.size)
        begun = time.perf_counter()
        u = compiled.step(x)
        took[step] = time.perf_counter() - begun
        most = max(most, compiled.operations)
        bits &= all((other.step(x) == u).all() for other in others)
        theirs, _ = twin.step(x)
        same += bool((np.abs(u - theirs) <= SAME * (upper - lower)).all())
        x = twin.model(x, theirs)
    faster, cost = _against_library(made, controller, x.size)
    with tempfile.TemporaryDirectory() as folder:
        fast, small = (_size(made, Path(folder), one) / 1024 for one in ("-O2", "-Os"))
        is_clean = _sanitized(name, random, Path(folder))
    return Measured(
        name=name, what=what, same=same / steps, bits=bits,
        step_us=1e6 * float(took.mean()), faster=faster, cost=cost,
        kilobytes=(fast, small),
        operations=most / made.most_operations, is_clean=is_clean,
    )  # fmt: skip


def _against_library(
    made: ss.CExport, controller: Loop, nx: int
) -> tuple[float | None, float | None]:
    """Return ratios of the mean times of a step after the first, and of costs.

    None for both, if the C file takes parameters or signals, or remembers a control:
    it is no controller of the stated plant then.
    """
    problem = made.posed.problem
    if made.posed.remembered.size or problem.ns or problem.model.np:
        return None, None
    plant = ss.Plant(problem.model, dt=problem.dt, substeps=4)
    steps, x0 = round(10.0 / plant.dt), made.posed.x0[:nx]
    ss.simulate(plant, controller, x0, steps=2, seed=0)
    theirs = ss.simulate(plant, controller, x0, steps=steps, seed=0)
    mine = ss.simulate(plant, made.controller(), x0, steps=steps, seed=0)
    costs = [_cost(made, run) for run in (mine, theirs)]
    times = [np.mean(run.step_seconds[1:]) for run in (mine, theirs)]
    return float(times[1] / times[0]), costs[0] / costs[1]


def _cost(made: ss.CExport, run: ss.Trajectory) -> float:
    one, known = made.posed, made.posed.known
    p = np.concatenate([np.asarray(known.parameters), one.lane.weights])
    signals = np.zeros((0, one.problem.checks + 1))
    pairs = zip(run.states.T[:-1], run.controls.T, strict=True)
    return sum(float(one.interval(x, u, p, signals)[1]) for x, u in pairs)


def _size(made: ss.CExport, folder: Path, optimised: str) -> int:
    for file, text in made.files.items():
        (folder / file).write_text(text)
    flags = [*FLAGS[:1], optimised, *FLAGS[2:]]
    command = [compiler_command(), *flags, "-c", f"{made.name}.c", "-o", "one.o"]
    subprocess.run(command, cwd=folder, check=True)
    said = subprocess.run(
        ["size", "one.o"], cwd=folder, check=True, capture_output=True, text=True
    ).stdout
    return int(said.splitlines()[1].split()[0])


def _sanitized(name: str, steps: int, folder: Path) -> bool:
    """Return whether random states leave the sanitizers silent, and all bounds kept."""
    _, made, _ = made_of(name, starts=1, iterations=10)
    for file, text in made.files.items():
        (folder / file).write_text(text)
    problem = made.posed.problem
    given = f", parameters[{max(problem.model.np, 1)}] = {{1}}"
    given += f", signals[{max(problem.ns * problem.nodes, 1)}] = {{1}}"
    passed = ", parameters" * bool(problem.model.np) + ", signals" * bool(problem.ns)
    text = RANDOM.replace("GIVEN", given if passed else "").replace("PASSED", passed)
    lower, upper = problem.control_limits
    for word, values in {"LOWER": lower, "UPPER": upper}.items():
        text = text.replace(word, ", ".join(repr(float(one)) for one in values))
    text = text.replace("STEPS", str(steps)).replace("NAME", name)
    (folder / "random.c").write_text(text)
    command = [
        compiler_command(), "-std=c99", "-O1", "-g", "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all", f"{name}.c", "random.c", "-o", "random", "-lm",
    ]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True)
    done = subprocess.run([folder / "random"], capture_output=True, check=False)
    return done.returncode == 0


def finding(results: Sequence[Measured]) -> str:
    """Return the finding, in words."""
    worst = min(one.same for one in results)
    costs = [one.cost for one in results if one.cost is not None]
    ratios = [one.faster for one in results if one.faster is not None]
    equal = "the same bits" if all(one.bits for one in results) else "NOT the same bits"
    clean = all(one.is_clean for one in results)
    loop = ratios and (
        f"A step is {min(ratios):.0f} to {max(ratios):.0f} times faster than that of "
        f"the library's closed loop, and a flight costs {min(costs):.4f} to "
        f"{max(costs):.4f} times as much. "
    )
    return (
        f"Each of {len(results)} exported controllers gives, in at least {worst:.2%} "
        "of its steps, the control that the library's [lanes](../glossary.md#lane) "
        f"give, up to {SAME:g} of the control's range. All optimisation levels of the "
        f"compiler give {equal}. {loop or ''}Sanitizers find "
        f"{'nothing' if clean else 'ERRORS'}."
    )


def page(
    results: Sequence[Measured], command: str, steps: int, random: int
) -> list[str]:
    """Return the lines of the page below its title."""
    table = head(
        "controller", "steps as the lanes", "same bits", "mean step [us]",
        "times faster", "cost by the library's", "code [kB], -O2 and -Os",
        "most operations by the bound", "sanitizers",
    )  # fmt: skip
    for one in results:
        table.append(
            row(
                f"`{one.name}`", f"{one.same:.2%}", "yes" if one.bits else "**no**",
                f"{one.step_us:.0f}",
                "-" if one.faster is None else f"{one.faster:.0f}",
                "-" if one.cost is None else f"{one.cost:.4f}",
                f"{one.kilobytes[0]:.0f} and {one.kilobytes[1]:.0f}",
                f"{one.operations:.2f}", "clean" if one.is_clean else "**errors**",
            )
        )  # fmt: skip
    return [
        finding(results), "",
        f"Made by `{command}` on one of {os.cpu_count()} cores: {steps:,} steps of "
        "each controller in closed loop, with a random change of the state every "
        f"{KICK} steps. At each step the library's lanes (machine code) and builds of "
        f"the C code with {' and '.join(OTHERS)} in place of {FLAGS[1]} decide from "
        "the same state. \"Times faster\" compares the mean step of a flight of 10 s, "
        "without its first step, with that of the library's own closed loop, which "
        "also searches. Controllers that take parameters, signals or the plans of "
        "others, or remember a control, are not compared with that loop. \"Most "
        "operations by the bound\" is the largest number of operations of a step, "
        "divided by the bound that the export states. A build with sanitizers is "
        f"called with {random:,} random states, among them huge ones, infinities and "
        "NaN.",
        "", *table, "",
        *(f"- `{one.name}`: {one.what}" for one in results),
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the page, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--random", type=int, default=20_000)
    parser.add_argument("cases", nargs="*", default=[*CASES, *SHIPPED])
    options = parser.parse_args(arguments)
    results = []
    for name in options.cases:
        results.append(measured(name, options.steps, options.random))
        print(results[-1], flush=True)
    command = command_of("benchmarks/controller_c.py", arguments)
    publish(page(results, command, options.steps, options.random), options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
