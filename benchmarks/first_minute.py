"""Time of the first use: with an empty cache and home, and again with them filled.

Each command runs in a copy of the package without bytecode, with HOME and
XDG_CACHE_HOME in a new folder. Prints the table of docs/measured/first_minute.md:

    python benchmarks/first_minute.py [--repeats 3]

The machine must be idle and have two processors.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("ocp", "heuristics", "terminal_set", "cases")

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
    "`swarmstart run formation_v --no-figures`, later": (
        [*FLIGHT, "--no-figures"],
        2.5,
    ),
}


def main() -> None:
    """Measure and print the table."""
    options = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    options.add_argument("--repeats", type=int, default=3)
    repeats = options.parse_args().repeats
    print("| | median [s] | lowest to highest | at most |")
    print("|---|---|---|---|")
    for name, (arguments, most) in COMMANDS.items():
        taken = [measured(arguments, "later" in name) for _ in range(repeats)]
        middle, low, high = statistics.median(taken), min(taken), max(taken)
        print(f"| {name} | {middle:.1f} | {low:.1f} to {high:.1f} | {most:g} |")


def measured(arguments: list[str], again: bool) -> float:
    """Return the wall time of a command in a new home [s], or of its second call."""
    with tempfile.TemporaryDirectory() as folder:
        package = copied(Path(folder, "package"))
        home = Path(folder, "home")
        home.mkdir()
        environment = {
            **os.environ,
            "HOME": str(home),
            "XDG_CACHE_HOME": str(home / ".cache"),
            "PYTHONPATH": str(package),
        }
        for call in range(1 + again):
            results = Path(folder, f"results{call}")
            results.mkdir()
            begin = time.perf_counter()
            subprocess.run(
                [sys.executable, *arguments],
                cwd=results,
                env=environment,
                check=True,
                capture_output=True,
            )
            seconds = time.perf_counter() - begin
    return seconds


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
