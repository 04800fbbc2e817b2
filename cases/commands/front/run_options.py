"""Options of the commands that run something: run, replicate and compare."""

import argparse
import os

from swarmstart.cases.commands.front.parsing import count, seed, share
from swarmstart.cases.format.registry import POLISHES, SEARCHES
from swarmstart.cases.record.record import FIGURE_FORMATS

SOLVERS = "solve,cpso,de,lshade+ipopt,repeated-ipopt,ipopt"
"""Solvers that are compared by default."""


def add_run(run: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    run.add_argument(
        "scenario", metavar="SCENARIO",
        help="name of a scenario (swarmstart list scenarios), or path of a YAML file",
    )  # fmt: skip
    _add_scenario(run)
    run.add_argument(
        "--search", choices=[*SEARCHES], metavar="NAME",
        help=f"search algorithm: {', '.join(SEARCHES)} (default: the one in the "
        "scenario)",
    )  # fmt: skip
    run.add_argument(
        "--polish", metavar="NAME",
        help=f"local solver after the search: {', '.join(POLISHES)}, or another NLP "
        "solver of CasADi (default: the one in the scenario)",
    )  # fmt: skip
    # Over several seeds --seed has no meaning, so argparse refuses both at once.
    which = run.add_mutually_exclusive_group()
    which.add_argument(
        "--seed", type=seed, default=0, metavar="N",
        help="seed of all randomness: the same seed gives the same result (default: 0)",
    )  # fmt: skip
    which.add_argument(
        "--seeds", type=count, metavar="N",
        help="run the seeds 0 to N - 1 and print lowest, median and highest values",
    )  # fmt: skip
    _add_workers(run, "number of processes for --seeds")
    run.add_argument(
        "--bound", metavar="TIME",
        help="after the run, search for a proven bound of the cost, with the work of "
        "about so long, such as 120s or 2m; the same work proves the same everywhere; "
        "for scenarios that make one plan (default: no bound)",
    )  # fmt: skip
    run.add_argument(
        "--out", metavar="DIR",
        help="folder of the record (default: results/SCENARIO/KEY)",
    )  # fmt: skip
    run.add_argument(
        "--force", action="store_true",
        help="write to --out even if it holds other files; only files that a record "
        "has are replaced",
    )  # fmt: skip
    run.add_argument("--no-figures", action="store_true", help="do not draw figures")
    run.add_argument(
        "--format", choices=FIGURE_FORMATS, action="append", default=[],
        dest="formats",
        help="file format of the figures; svg and pdf are vector formats; repeatable "
        "(default: png)",
    )  # fmt: skip
    run.add_argument(
        "--animation", choices=["gif", "mp4"],
        help="also draw an animation of the motion (default: none)",
    )  # fmt: skip
    printed = run.add_mutually_exclusive_group()
    printed.add_argument(
        "--measures", action="store_true",
        help="also print all measures, with unit and meaning, and all claims",
    )  # fmt: skip
    printed.add_argument(
        "--json", action="store_true", help="print one JSON object instead of text"
    )
    run.add_argument(
        "-q", "--quiet", action="store_true", help="do not show progress on stderr"
    )
    run.add_argument(
        "--fail-on", action="append", default=[], metavar="CONDITION",
        help="exit with code 3 if this condition is true, e.g. 'tail_error_m > 1'; "
        "repeatable; '== null' tests for an undefined measure",
    )  # fmt: skip
    run.add_argument(
        "--print-config", action="store_true",
        help="print the scenario with all defaults as YAML, and exit without running",
    )  # fmt: skip


def add_replicate(replicate: argparse.ArgumentParser) -> None:
    """Add the options of `replicate`."""
    several = replicate.add_mutually_exclusive_group()
    several.add_argument(
        "--quick", action="store_true",
        help="run one seed only; claims that need more are marked 'not judged'",
    )  # fmt: skip
    several.add_argument(
        "--seeds", type=count, metavar="N",
        help="number of seeds for each run that uses randomness (default: what each "
        "claim needs)",
    )  # fmt: skip
    replicate.add_argument(
        "--only", type=count, action="append", default=[], metavar="ID",
        help="judge only the claim with this number; repeatable (default: all claims)",
    )  # fmt: skip
    _add_dry_run(replicate)
    replicate.add_argument(
        "--out", metavar="DIR",
        help="folder of the records (default: results/replication)",
    )  # fmt: skip
    add_campaign(replicate, markdown=True)


def add_compare(compare: argparse.ArgumentParser) -> None:
    """Add the options of `compare`."""
    compare.add_argument(
        "scenarios", nargs="+", metavar="SCENARIO",
        help="scenarios to compare on, or a plan: a YAML file with the key `compare`",
    )  # fmt: skip
    compare.add_argument(
        "--solvers", metavar="NAME,...",
        help="solvers, such as lshade[size=60]+ipopt; repeated-ipopt is always "
        f"added (default: {SOLVERS})",
    )  # fmt: skip
    # No default values here: those of a plan come before those of the help.
    compare.add_argument(
        "--seeds", type=count, metavar="N", help="number of seeds (default: 10)"
    )
    compare.add_argument(
        "--budget", metavar="BUDGET",
        help="budget of each planning problem: evaluations, such as 4000, or "
        "seconds, such as 5s (default: 4000evals)",
    )  # fmt: skip
    compare.add_argument(
        "--of", choices=["auto", "plan", "flight"],
        help="compare single plans, or whole simulations (flight); auto: what the "
        "scenario runs (default: auto)",
    )  # fmt: skip
    _add_scenario(compare)
    compare.add_argument(
        "--timeout", type=count, metavar="S",
        help="time after which one run is stopped [s] (default: 300)",
    )  # fmt: skip
    compare.add_argument(
        # None: not given, so that a plan's own `repair` counts.
        "--repair", action=argparse.BooleanOptionalAction, default=None,
        help="solve again, with a margin, if an answer breaks a constraint between the "
        "checks; for all solvers alike (default: --repair)",
    )  # fmt: skip
    compare.add_argument(
        "--bound", metavar="TIME",
        help="then search for a proven bound of the cost, with the work of about so "
        "long, such as 60s; for each scenario that is compared by single plans "
        "(default: no bound)",
    )  # fmt: skip
    _add_dry_run(compare)
    compare.add_argument(
        "--out", metavar="DIR",
        help="folder of the records (default: results/compare)",
    )  # fmt: skip
    compare.add_argument(
        "--times", action="store_true",
        help="also print wall times [s], which differ from run to run",
    )  # fmt: skip
    compare.add_argument(
        "--parquet", action="store_true",
        help="also write results.parquet and curves.parquet",
    )  # fmt: skip
    compare.add_argument(
        "--baseline", metavar="DIR",
        help="folder of an earlier comparison, to compare this one with (default: "
        "none)",
    )  # fmt: skip
    compare.add_argument(
        "--fail-on", choices=["regression"],
        help="exit with code 3 if a solver is worse than in the baseline",
    )  # fmt: skip
    compare.add_argument(
        # argparse formats a help with %, so that %% is printed as %.
        "--margin", type=share, default=0.1, metavar="SHARE",
        help="how much worse than in the baseline is accepted, such as 10%% (default: "
        "10%%)",
    )  # fmt: skip
    compare.add_argument(
        "--engine", choices=["local", "dask"], default="local",
        help="local: processes of this machine; dask: the workers of --scheduler "
        "(default: local)",
    )  # fmt: skip
    compare.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="address of the Dask scheduler, such as tcp://10.0.0.1:8786",
    )  # fmt: skip
    add_campaign(compare)
    # Not the default of --solvers: the solvers of a plan come before these.
    compare.set_defaults(default_solvers=SOLVERS)


def add_campaign(command: argparse.ArgumentParser, *, markdown: bool = False) -> None:
    """Add the options that all commands of many runs have."""
    _add_workers(command, "number of processes")
    printed = command.add_mutually_exclusive_group()
    printed.add_argument(
        "--json", action="store_true", help="print one JSON object instead of text"
    )
    if markdown:
        printed.add_argument(
            "--markdown", action="store_true", help="print a table in Markdown"
        )
    command.add_argument(
        "-q", "--quiet", action="store_true", help="do not show progress on stderr"
    )


def _add_scenario(command: argparse.ArgumentParser) -> None:
    """Add the options that change a scenario before it is run."""
    command.add_argument(
        "--variant", metavar="NAME",
        help="variant of the scenario, e.g. literal (as printed) or corrected "
        "(default: corrected, if the scenario has variants)",
    )  # fmt: skip
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY.PATH=VALUE",
        dest="assignments",
        help="change one value of the scenario, e.g. prediction.intervals=80; "
        "repeatable",
    )  # fmt: skip
    command.add_argument(
        "--allow-python", action="store_true",
        help="allow a scenario of kind python to run its Python file; do this only "
        "with files that you trust",
    )  # fmt: skip


def _add_workers(command: argparse.ArgumentParser, what: str) -> None:
    command.add_argument(
        # None: the system does not say how many it has.
        "--workers", type=count, default=os.cpu_count() or 1, metavar="N",
        help=f"{what} (default: the number of cores)",
    )  # fmt: skip


def _add_dry_run(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--dry-run", action="store_true",
        help="print the number of runs and the estimated time, then exit",
    )  # fmt: skip
