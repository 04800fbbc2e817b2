"""Time of the first use: with an empty cache and home, and again with them filled.

Each command runs in a copy of the package without bytecode, with HOME and
XDG_CACHE_HOME in a new folder. Prints the tables of docs/measured/first_minute.md:

    python benchmarks/first_minute.py [--repeats 3]     seconds of the first use
    python benchmarks/first_minute.py --ratios [--repeats 9]   CPU time of later uses

Seconds need an idle machine with two processors. Ratios are CPU time relative to
`import casadi, numpy`, which runs in turn with the commands, so others may work too.
"""

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = (
    "ocp", "heuristics", "terminal_set", "machine_code", "export", "simulators",
    "cases",
)  # fmt: skip

MINIMIZE = """
from swarmstart.heuristics import minimize
minimize(lambda x: (x**2).sum(axis=0), bounds=[(-1, 2)] * 3, budget=5000, seed=0)
"""
SOLVE = """
import casadi as ca
import numpy as np
import swarmstart as ss
x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
model = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
problem = ss.OptimalControlProblem(
    model, horizon=3.0, intervals=50, stage_cost=u**2,
    bounds=ss.Bounds(controls=(-8.0, 8.0)), terminal=[x - ca.vertcat(np.pi, 0)],
)
ss.solve(problem, x0=[0, 0], seed=0)
"""
FLIGHT = ["-m", "swarmstart", "run", "formation_v"]
COMMANDS = {  # Name: arguments of Python, largest allowed time [s].
    "`minimize`, the first": (["-c", MINIMIZE], 10.0),
    "`solve`, the first": (["-c", SOLVE], 10.0),
    "`swarmstart run formation_v`, the first": (FLIGHT, 12.0),
}
NAMES = """
import casadi as ca
import swarmstart as ss
ss.Model, ss.OptimalControlProblem, ss.Bounds, ss.IpoptOptions, ss.solve, ss.minimize
ss.RecedingHorizon, ss.Planner, ss.simulate, ss.Plant
"""
CHECK = ["-m", "swarmstart", "check"]
UNIT = "`import casadi, numpy`"
LATER = {  # Name: arguments of Python, largest allowed ratio; None if there is none.
    UNIT: (["-c", "import casadi, numpy"], None),
    "`import` of the names that solve": (["-c", NAMES], 4.0),
    "`swarmstart check pendulum`": ([*CHECK, "pendulum"], 6.0),
    "`swarmstart check formation_v`": ([*CHECK, "formation_v"], 6.0),
    "`swarmstart check swap_8`": ([*CHECK, "swap_8"], 6.0),
    "`swarmstart check supersonic_climb`": ([*CHECK, "supersonic_climb"], 6.0),
    "`swarmstart check double_pendulum`": ([*CHECK, "double_pendulum"], 6.0),
    "`swarmstart check formation_100`": ([*CHECK, "formation_100"], 6.0),
    "`swarmstart run formation_v --no-figures`": ([*FLIGHT, "--no-figures"], 19.0),
    "`swarmstart run formation_v`": (FLIGHT, None),
}


def main() -> None:
    """Measure and print a table."""
    options = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    options.add_argument("--repeats", type=int, default=3)
    options.add_argument("--ratios", action="store_true")
    chosen = options.parse_args()
    (print_ratios if chosen.ratios else print_seconds)(chosen.repeats)


def print_ratios(repeats: int) -> None:
    """Measure the CPU time of commands that were called before, and print the table."""
    spent: dict[str, list[float]] = {name: [] for name in LATER}
    with tempfile.TemporaryDirectory() as folder:
        environment = new_home(Path(folder))
        for turn in range(1 + repeats):
            for name, (arguments, _) in LATER.items():
                results = Path(tempfile.mkdtemp(dir=folder))
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                run(arguments, results, environment)
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                if turn:  # The first one fills the caches.
                    seconds = after.ru_utime - before.ru_utime
                    spent[name].append(seconds + after.ru_stime - before.ru_stime)
    unit = statistics.median(spent[UNIT])
    print("| | CPU time [s] | ratio | quartiles | at most |")
    print("|---|---|---|---|---|")
    for name, (_, most) in LATER.items():
        low, middle, high = statistics.quantiles(spent[name], method="inclusive")
        ratios = f"{middle / unit:.1f} | {low / unit:.1f} to {high / unit:.1f}"
        limit = "" if most is None else f"{most:g}"
        print(f"| {name} | {middle:.2f} | {ratios} | {limit} |")


def print_seconds(repeats: int) -> None:
    """Measure the wall time of the first use, and print the table."""
    print("| | median [s] | lowest to highest | at most |")
    print("|---|---|---|---|")
    for name, (arguments, most) in COMMANDS.items():
        taken = [measured(arguments) for _ in range(repeats)]
        middle, low, high = statistics.median(taken), min(taken), max(taken)
        print(f"| {name} | {middle:.1f} | {low:.1f} to {high:.1f} | {most:g} |")


def measured(arguments: list[str]) -> float:
    """Return the wall time of a command in a new home [s]."""
    with tempfile.TemporaryDirectory() as folder:
        environment = new_home(Path(folder))
        results = Path(folder, "results")
        results.mkdir()
        begin = time.perf_counter()
        run(arguments, results, environment)
        return time.perf_counter() - begin


def new_home(folder: Path) -> dict[str, str]:
    """Return an environment with a copy of the package and an empty home."""
    home = folder / "home"
    home.mkdir()
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return {
        **kept,
        "HOME": str(home),
        "XDG_CACHE_HOME": str(home / ".cache"),
        "PYTHONPATH": str(copied(folder / "package")),
    }


def run(arguments: list[str], folder: Path, environment: dict[str, str]) -> None:
    """Run Python in a folder, and stop if it fails."""
    subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
    )


def copied(folder: Path) -> Path:
    """Copy the package without bytecode; return the folder to import it from."""
    package = folder / "swarmstart"
    package.mkdir(parents=True)
    for file in ROOT.glob("*.py"):
        shutil.copy(file, package)
    for room in ROOMS:
        without = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / room, package / room, ignore=without)
    return folder


if __name__ == "__main__":
    main()
