"""Options of all commands, in one table."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from swarmstart.cases.commands.front.parsing import count, finite, positive, seed, share
from swarmstart.cases.format.registry import BEST_KNOWN, KINDS, POLISHES, SEARCHES
from swarmstart.cases.record.record import FIGURE_FORMATS

SOLVERS = "solve,cpso,de,lshade+ipopt,repeated-ipopt,ipopt"
"""Solvers that are compared by default."""
RESULTS = "results"
"""Folder of all records by default."""
# The list has the same topics. It lies below this room, so a test compares them.
TOPICS = {
    "scenarios": "with kind, variants and run time",
    "searches": "search algorithms, for --search",
    "polishes": "local solvers that finish a search, for --polish",
    "measures": "numbers that a run returns, with unit and meaning",
    "kinds": "kinds of scenario",
}
"""The parts of `swarmstart list`, and what each shows."""
EXPORTS = {
    "crazyswarm": "polynomials for Crazyflies, a CSV file each",
    "skybrush": "a show of all, .skyc",
    "mcap": "a bag of ROS 2 with the poses of all (extra ros)",
    "qgc": "a mission for QGroundControl each, .plan, without times",
    "wpl": "a mission for ArduPilot and PX4 each, .waypoints, without times",
    "csv": "times and positions, a CSV file each",
}
"""Formats of `swarmstart export trajectory`, and what each is."""
SHELLS = ("bash", "zsh", "tcsh")
"""Shells in which `swarmstart completion` completes."""


@dataclass(frozen=True, slots=True)
class Option:
    """An option, or a positional argument, of a command for argparse.

    Attributes:
        names: Names of the option, with their dashes; of a positional argument its
            name.
        help: Text on what the option does.
        more: The other arguments of `add_argument`.
    """

    names: tuple[str, ...]
    help: str
    more: Mapping[str, Any] = field(default_factory=dict)

    def add_to(self, parser: argparse._ActionsContainer) -> None:
        """Add the option to a parser, or to a group of options of a parser."""
        parser.add_argument(*self.names, help=self.help, **self.more)


@dataclass(frozen=True, slots=True)
class OneOf:
    """Options of which a command takes at most one; argparse refuses two."""

    options: tuple[Option, ...]

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Add the options to a parser, as a group."""
        group = parser.add_mutually_exclusive_group()
        for one in self.options:
            one.add_to(group)


def _option(*names: str, help: str, **more: Any) -> Option:
    return Option(names, help, more)


def _flag(*names: str, help: str) -> Option:
    return Option(names, help, {"action": "store_true"})


def _repeatable(*names: str, help: str, **more: Any) -> Option:
    return Option(names, help, {"action": "append", "default": [], **more})


def _out(what: str) -> Option:
    return _option("--out", metavar="DIR", help=what)


def _workers(what: str) -> Option:
    return _option(
        # None: the system does not say how many it has.
        "--workers", type=count, default=os.cpu_count() or 1, metavar="N",
        help=f"{what} (default: the number of cores)",
    )  # fmt: skip


_ASSIGNMENTS = _repeatable(
    "--set", metavar="KEY.PATH=VALUE", dest="assignments",
    help="change one value of the scenario, e.g. prediction.intervals=80; repeatable",
)  # fmt: skip


_QUIET = _flag("-q", "--quiet", help="do not show progress on stderr")
_JSON = _flag("--json", help="print one JSON object instead of text")
_ONLY_JSON = _flag("--json", help="print one JSON object")
_DRY_RUN = _flag(
    "--dry-run", help="print the number of runs and the estimated time, then exit"
)
_SCENARIO = "name of a scenario (swarmstart list scenarios), or path of a YAML file"
_CHANGES = (
    _option(
        "--variant", metavar="NAME",
        help="variant of the scenario, e.g. literal (as printed) or corrected "
        "(default: corrected, if the scenario has variants)",
    ),
    _ASSIGNMENTS,
    _flag(
        "--allow-code", "--allow-python",
        help="allow the scenario to run code of its own: the file of kind python, an "
        "FMU, a network or a program as its plant; do this only with files that you "
        "trust",
    ),
)  # fmt: skip
"""Options that change a scenario before it is run."""
_POLISH = _option(
    "--polish", metavar="NAME",
    help=f"local solver after the search: {', '.join(POLISHES)}, or another NLP solver "
    "of CasADi (default: the one in the scenario)",
)  # fmt: skip
_SEED = _option(
    "--seed", type=seed, default=0, metavar="N",
    help="seed of all randomness: the same seed gives the same result (default: 0)",
)  # fmt: skip
_RECORD = (
    _out("folder of the record (default: results/SCENARIO/KEY)"),
    _flag(
        "--force",
        help="write to --out even if it holds other files; only files that a record "
        "has are replaced",
    ),
    _flag("--no-figures", help="do not draw figures"),
    _repeatable(
        "--format", choices=FIGURE_FORMATS, dest="formats",
        help="file format of the figures; svg and pdf are vector formats; repeatable "
        "(default: png)",
    ),
)  # fmt: skip
"""Options of the record of a run or of a sweep."""

OPTIONS: Mapping[str, tuple[Option | OneOf, ...]] = {
    "run": (
        _option("scenario", metavar="SCENARIO", help=_SCENARIO),
        *_CHANGES,
        _option(
            "--search", choices=[*SEARCHES], metavar="NAME",
            help=f"search algorithm: {', '.join(SEARCHES)} (default: the one in the "
            "scenario)",
        ),
        _POLISH,
        # Over several seeds --seed has no meaning.
        OneOf((
            _SEED,
            _option(
                "--seeds", type=count, metavar="N",
                help="run the seeds 0 to N - 1 and print lowest, median and highest "
                "values",
            ),
        )),
        _workers("number of processes for --seeds, or for the starts of one run"),
        _option(
            "--bound", metavar="TIME",
            help="after the run, search for a proven bound of the cost, with the work "
            "of about so long, such as 120s or 2m; the same work proves the same "
            "everywhere; for scenarios that make one plan (default: no bound)",
        ),
        *_RECORD,
        _option(
            "--animation", choices=["gif", "mp4"],
            help="also draw an animation of the motion (default: none)",
        ),
        OneOf((
            _flag(
                "--measures",
                help="also print all measures, with unit and meaning, and all claims",
            ),
            _JSON,
        )),
        _QUIET,
        _repeatable(
            "--fail-on", metavar="CONDITION",
            help="exit with code 3 if this condition is true, e.g. 'tail_error_m > "
            "1'; repeatable; '== null' tests for an undefined measure",
        ),
        _flag(
            "--print-config",
            help="print the scenario with all defaults as YAML, and exit without "
            "running",
        ),
    ),
    "sweep": (
        _option("scenario", metavar="SCENARIO", help=_SCENARIO),
        *_CHANGES,
        _POLISH,
        _SEED,
        _flag(
            "--strict",
            help="refuse all instances if one is invalid (default: leave it out)",
        ),
        _workers("number of threads and processes"),
        *_RECORD,
        _JSON,
        _QUIET,
    ),
    "replicate": (
        OneOf((
            _flag(
                "--quick",
                help="run one seed only; claims that need more are marked 'not judged'",
            ),
            _option(
                "--seeds", type=count, metavar="N",
                help="number of seeds for each run that uses randomness (default: "
                "what each claim needs)",
            ),
        )),
        _repeatable(
            "--only", type=count, metavar="ID",
            help="judge only the claim with this number; repeatable (default: all "
            "claims)",
        ),
        _DRY_RUN,
        _out("folder of the records (default: results/replication)"),
        _workers("number of processes"),
        OneOf((_JSON, _flag("--markdown", help="print a table in Markdown"))),
        _QUIET,
    ),
    "compare": (
        _option(
            "scenarios", nargs="+", metavar="SCENARIO",
            help="scenarios to compare on, or a plan: a YAML file with the key "
            "`compare`",
        ),
        _option(
            "--solvers", metavar="NAME,...",
            help="solvers, such as lshade[size=60]+ipopt; repeated-ipopt is always "
            f"added (default: {SOLVERS})",
        ),
        # No default values here: those of a plan come before those of the help.
        _option(
            "--seeds", type=count, metavar="N", help="number of seeds (default: 10)"
        ),
        _option(
            "--budget", metavar="BUDGET",
            help="budget of each planning problem: evaluations, such as 4000, or "
            "seconds, such as 5s (default: 4000evals)",
        ),
        _option(
            "--of", choices=["auto", "plan", "flight"],
            help="compare single plans, or whole simulations (flight); auto: what the "
            "scenario runs (default: auto)",
        ),
        *_CHANGES,
        _option(
            "--timeout", type=count, metavar="S",
            help="time after which one run is stopped [s] (default: 300)",
        ),
        _option(
            # None: not given, so that a plan's own `repair` counts.
            "--repair", action=argparse.BooleanOptionalAction, default=None,
            help="solve again, with a margin, if an answer breaks a constraint between "
            "the checks; for all solvers alike (default: --repair)",
        ),
        _option(
            "--bound", metavar="TIME",
            help="then search for a proven bound of the cost, with the work of about "
            "so long, such as 60s; for each scenario that is compared by single plans "
            "(default: no bound)",
        ),
        _DRY_RUN,
        _out("folder of the records (default: results/compare)"),
        _flag(
            "--times", help="also print wall times [s], which differ from run to run"
        ),
        _flag("--parquet", help="also write results.parquet and curves.parquet"),
        _option(
            "--baseline", metavar="DIR",
            help="folder of an earlier comparison, to compare this one with (default: "
            "none)",
        ),
        _option(
            "--fail-on", choices=["regression"],
            help="exit with code 3 if a solver is worse than in the baseline",
        ),
        _option(
            # argparse formats a help with %, so that %% is printed as %.
            "--margin", type=share, default=0.1, metavar="SHARE",
            help="how much worse than in the baseline is accepted, such as 10%% "
            "(default: 10%%)",
        ),
        _option(
            "--engine", choices=["local", "dask"], default="local",
            help="local: processes of this machine; dask: the workers of --scheduler "
            "(default: local)",
        ),
        _option(
            "--scheduler", metavar="ADDRESS",
            help="address of the Dask scheduler, such as tcp://10.0.0.1:8786",
        ),
        _workers("number of processes"),
        _JSON,
        _QUIET,
    ),
    "report": (
        _option(
            "folders", nargs="+", metavar="DIR",
            help="folder that run, compare or replicate wrote (their --out); of a "
            "folder of records, the newest is taken",
        ),
        _repeatable(
            "--format", choices=["html", "md", "latex"], dest="formats",
            help="format of the page; repeatable (default: html and md)",
        ),
        _repeatable(
            "--charts", choices=["svg", "pdf"],
            help="also write each chart of the page as a file of its own, into a "
            "folder beside the page; repeatable (default: no files)",
        ),
        _out("folder to write the files to (default: each record's own folder)"),
        _QUIET,  # As the commands that leave records; `cli` reads it.
    ),
    "open": (
        _option(
            "folder", nargs="?", default=RESULTS, metavar="DIR",
            help="folder of a record; of a folder of records, the newest is opened "
            f"(default: {RESULTS})",
        ),
    ),
    "new": (
        _option(
            "name", metavar="NAME",
            help="name of the scenario, or path of the file; .yaml is appended if "
            "missing",
        ),
        _option(
            "--kind", choices=[*KINDS], default="problem", metavar="KIND",
            help="problem: everything in the YAML file; python: the problem is a "
            "function in NAME.py; formation_flight: UAVs that form a V past an "
            "obstacle; of the other kinds the command says where to start (default: "
            "problem)",
        ),
        _flag("--force", help="replace the files if they exist"),
    ),
    "list": (
        _option(
            "topic", nargs="?", default="", metavar="TOPIC",
            help="; ".join(f"{name}: {what}" for name, what in TOPICS.items())
            + "; any other word is searched for everywhere (default: an overview)",
        ),
        _option(
            "text", nargs="?", default="", metavar="TEXT",
            help="show only entries that contain this text; of measures, the name of "
            "a kind or a scenario, or a path, selects its measures (default: all "
            "entries)",
        ),
        _option(
            "--kind", choices=[*KINDS], metavar="KIND",
            help=f"show only scenarios and measures of this kind: {', '.join(KINDS)} "
            "(default: all kinds)",
        ),
        _flag(
            "--hard",
            help="show the hard problems, which have many optima, instead of the other "
            "scenarios",
        ),
        _ONLY_JSON,
    ),
    "check": (_option("scenarios", nargs="+", metavar="SCENARIO", help=_SCENARIO),),
    "judge": (
        _option("scenario", metavar="SCENARIO", help=_SCENARIO),
        _option(
            "file", metavar="FILE",
            help="CSV file: a column for each control under its name, a row for each "
            "interval; a decided number, such as end_time, is a column with the same "
            "value in all rows",
        ),
        _ONLY_JSON,
    ),
    "export": (
        _option(
            "what", metavar="WHAT", choices=("trajectory", "c", "fmu"),
            help="what is exported: trajectory, the flight of vehicles; c, a "
            "receding-horizon controller in C99; fmu, the same as an FMU",
        ),
        _option(
            "source", metavar="SOURCE",
            help="trajectory: folder of a run, or of a saved result; c and fmu: "
            "name of a scenario, or path of its file",
        ),
        _option(
            "--format", choices=[*EXPORTS], metavar="FORMAT",
            help="; ".join(f"{name}: {what}" for name, what in EXPORTS.items())
            + " (default: csv)",
        ),
        _out("folder of the files (default: export in the record; c and fmu: NAME)"),
        _repeatable(
            "--vehicle", metavar="NAME",
            help="only this vehicle; repeatable (default: all; c and fmu: the first)",
        ),
        _option(
            "--positions", metavar="X,Y[,Z]",
            help="states that are coordinates, without the end that names a vehicle "
            "(default: x_m,y_m,z_m or x,y,z, without z if there is none)",
        ),
        _option(
            "--height", type=finite, metavar="M",
            help="height of vehicles in a plane [m] (default: 0)",
        ),
        _option(
            "--error", type=positive, metavar="M",
            help="largest distance from the flight [m] (default: crazyswarm 0.005, "
            "skybrush 0.001, qgc and wpl 0.1)",
        ),
        _option(
            "--max-speed", type=positive, metavar="M/S",
            help="refuse a trajectory of crazyswarm that is faster (default: no limit)",
        ),
        _option(
            "--max-acceleration", type=positive, metavar="M/S2",
            help="refuse a trajectory of crazyswarm that accelerates more (default: no "
            "limit)",
        ),
        _option(
            "--origin", metavar="LAT,LON,ALT",
            help="place of the origin on the earth, in degrees and metres, for qgc and "
            "wpl; with a minus write --origin=-33.9,18.4,0 (default: none)",
        ),
        _option(
            "--heading", type=finite, metavar="DEG",
            help="direction of the x axis, clockwise from north; y is to its left "
            "(default: 90, so that x is east and y is north)",
        ),
        _option(
            "--variant", metavar="NAME",
            help="variant of the scenario (default: corrected, if there are variants)",
        ),
        _ASSIGNMENTS,
        _option(
            "--name", metavar="NAME",
            help="name of the files and prefix in C (default: that of the scenario)",
        ),
        _option(
            "--starts", type=seed, metavar="N",
            help="seeded starts of a step whose plan is no optimum, or costs "
            "more (default: 16)",
        ),
        _option(
            "--iterations", type=count, metavar="N",
            help="largest number of steps of a local solve (default: 100)",
        ),
        _option(
            "--precision", choices=("double", "single"), metavar="NAME",
            help="double or single (default: double)",
        ),
        _option(
            "--seed", type=seed, metavar="N",
            help="seed of the first plan and of the starts (default: 0)",
        ),
        _flag("--main", help="write a program in C that simulates and compares"),
        _option(
            "--fmi", choices=("3.0", "2.0"), metavar="VERSION",
            help="version of FMI of the FMU, 3.0 or 2.0 (default: 3.0)",
        ),
    ),
    "schema": (
        _option(
            "kind", nargs="?", default="problem", metavar="KIND",
            choices=[*KINDS, BEST_KNOWN],
            help=f"kind of scenario: {', '.join(KINDS)}; or {BEST_KNOWN}: best known "
            "values of the hard problems (default: problem)",
        ),
    ),
    "cache": (_flag("--clear", help="remove all files of the cache"), _ONLY_JSON),
    "completion": (
        _option("shell", choices=SHELLS, help="the shell to complete in"),
    ),
}  # fmt: skip
"""Options of each command, in the order of its help."""
