"""Controllers in C against the library: the same decisions, time, size, bounds.

    python benchmarks/controller_c.py [--steps 300] [--random 20000] [--write FILE]

Each controller runs in closed loop with its own model; every 50 steps a random kick
moves the state. At each step the library's lanes (twin.py) decide on the same state,
each with its own memory. The time of a step is compared with that of the library's own
closed loop, with its search, from the same start. A sanitized build takes random
states, huge and small ones, infinities and NaN.
"""

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import swarmstart as ss
from swarmstart.export.controller.exported import FLAGS, compiler_command
from swarmstart.export.controller.twin import Twin
from swarmstart.tests.export.controller import controllers

KICK = 50
SAME = 1e-9
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
      if (!(u[i] - u[i] == 0 && u[i] >= LOWER && u[i] <= UPPER)) {
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


def measured(name: str, steps: int, random: int) -> str:
    """Return the row of a table on one controller."""
    controller, x0 = _case(name)
    made = ss.export_c(controller, x0, name=name, starts=16)
    compiled, twin = made.controller(), Twin(made.posed, iterations=made.iterations)
    rng, x = np.random.default_rng(0), np.array(x0, dtype=np.float64)
    lower, upper = made.posed.problem.control_limits
    size = made.posed.lane.sizes.states[: x.size]
    same, took, most = 0, np.zeros(steps), 0
    for step in range(steps):
        if step % KICK == KICK - 1:
            x = x + 0.1 * size * rng.normal(size=x.size)
        begun = time.perf_counter()
        u = compiled.step(x)
        took[step] = time.perf_counter() - begun
        most = max(most, compiled.operations)
        theirs, _ = twin.step(x)
        same += bool((np.abs(u - theirs) <= SAME * (upper - lower)).all())
        x = twin.model(x, theirs)
    plant = (
        ss.Plant(made.posed.problem.model, dt=controller.dt, substeps=4)
        if not made.posed.remembered.size and not made.posed.problem.ns
        else None
    )
    ratio = cost = float("nan")
    if plant is not None:
        ratio, cost = _against_library(made, controller, plant, x0)
    with tempfile.TemporaryDirectory() as folder:
        bytes_fast, bytes_small = (_size(made, Path(folder), o) for o in ("-O2", "-Os"))
        clean = _sanitized(name, random, Path(folder))
    return (
        f"| {name} | {same / steps:.1%} | {1e6 * took.mean():.0f} | {ratio:.0f} | "
        f"{cost:.4f} | {bytes_fast / 1024:.0f} and {bytes_small / 1024:.0f} | "
        f"{most / made.most_operations:.2f} | {clean} |"
    )


def _case(name: str) -> controllers.Case:
    """Return a controller, with a search for the pendulum, which needs one."""
    return (
        controllers.pendulum("lshade")
        if name == "pendulum"
        else controllers.CASES[name]()
    )


def _against_library(
    made: ss.CExport,
    controller: ss.RecedingHorizon | ss.DualMode,
    plant: ss.Plant,
    x0: list[float],
) -> tuple[float, float]:
    """Return ratios of the mean times of a step after the first, and of costs."""
    steps = round(10.0 / plant.dt)
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


def _sanitized(name: str, steps: int, folder: Path) -> str:
    """Return whether random states leave the sanitizers silent, and all bounds kept."""
    controller, x0 = controllers.CASES[name]()
    made = ss.export_c(controller, x0, name=name, starts=1, iterations=10)
    for file, text in made.files.items():
        (folder / file).write_text(text)
    problem = made.posed.problem
    given = f", parameters[{max(problem.model.np, 1)}] = {{1}}"
    given += f", signals[{max(problem.ns * problem.nodes, 1)}] = {{1}}"
    passed = ", parameters" * bool(problem.model.np) + ", signals" * bool(problem.ns)
    lower, upper = problem.control_limits
    text = RANDOM.replace("GIVEN", given if passed else "").replace("PASSED", passed)
    text = text.replace("LOWER", repr(float(lower.min()))).replace(
        "UPPER", repr(float(upper.max()))
    )
    text = text.replace("STEPS", str(steps)).replace("NAME", name)
    (folder / "random.c").write_text(text)
    command = [
        compiler_command(), "-std=c99", "-O1", "-g", "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all", f"{name}.c", "random.c", "-o", "random", "-lm",
    ]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True)
    done = subprocess.run([folder / "random"], capture_output=True, check=False)
    return "clean" if done.returncode == 0 else f"failed ({done.returncode})"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--random", type=int, default=20_000)
    parser.add_argument("cases", nargs="*", default=[*controllers.CASES])
    options = parser.parse_args()
    print(
        "| controller | steps as the lanes, to 1e-9 of the range | mean step [us] | "
        "times faster | cost of a flight, by the library's | code [kB], -O2 and -Os | "
        "most operations, by the bound | sanitizers |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name in options.cases:
        print(measured(name, options.steps, options.random), flush=True)


if __name__ == "__main__":
    main()
