"""The parser of the whole command line; imports nothing heavy.

`parser()` returns it without running anything, for the reference and for completion.
"""

from __future__ import annotations

import argparse
import sys
from typing import NamedTuple, NoReturn

from swarmstart.cases.commands.front.options import OPTIONS, SOLVERS
from swarmstart.cases.commands.front.parsing import (
    HelpFormatter,
    Parser,
    subcommands_of,
)
from swarmstart.cases.commands.terminal import DONE, answer
from swarmstart.cases.record.record import versions

_ACTIONS = "swarmstart.cases.commands.actions"
EXIT_CODES = """\
exit codes:
    0  done
    1  internal error
    2  wrong usage or invalid input
    3  finished, but a gate failed: a claim with `gate: true`, or --fail-on
    4  no feasible or no confirmed solution
    5  a file could not be read or written
  130  interrupted; finished work is kept"""
_TOP = f"""\
examples:
  swarmstart list scenarios             what can be run at once
  swarmstart run pendulum               solve it; figures and a record on disk
  swarmstart open results               look at the newest figures
  swarmstart new mine                   write mine.yaml, a problem to start from
  swarmstart COMMAND --help             options of a command, with examples

{EXIT_CODES}"""
_RUN = """\
examples:
  swarmstart run pendulum
  swarmstart run formation_obstacle --variant literal --search ga --seed 3
  swarmstart run mine.yaml --set prediction.intervals=80 --out my_run
  swarmstart run two_drones --seeds 20 --measures
  swarmstart run pendulum --json --no-figures --fail-on 'cost > 37'

A run that was interrupted continues if you give the same command again.
Exit code 3: a gate failed; 4: no feasible or no confirmed solution."""
_SWEEP = """\
examples:
  swarmstart sweep mine.yaml
  swarmstart sweep pendulum --set 'instances.values.angle=[0, 1, 2]'
  swarmstart sweep mine.yaml --set instances.samples=500 --out my_sweep

An interrupted sweep keeps the answers that it has.
Exit code 4: no instance has a confirmed solution."""
_REPLICATE = """\
examples:
  swarmstart replicate --quick
  swarmstart replicate --seeds 10 --workers 4
  swarmstart replicate --only 9

Finished runs are kept: the same command again does only the missing ones.
Exit code 3: a verdict differs from the expected one, or a run failed."""
_COMPARE = """\
examples:
  swarmstart compare passing_side --solvers lshade+ipopt,ipopt
  swarmstart compare pendulum mine.yaml --seeds 20 --budget 2s
  swarmstart compare my_plan.yaml --dry-run

Finished runs are kept: the same command again does only the missing ones.
Exit code 3: a regression against --baseline; 4: no solver has solved one of
the scenarios."""
_REPORT = """\
examples:
  swarmstart report results/pendulum/916ba650e7ef81b6
  swarmstart report results/compare --format html --out pages"""
_LIST = """\
examples:
  swarmstart list
  swarmstart list scenarios --kind problem
  swarmstart list scenarios drone
  swarmstart list scenarios --hard
  swarmstart list measures formation_flight
  swarmstart list measures pendulum
  swarmstart list shade"""
_CHECK = """\
examples:
  swarmstart check mine.yaml
  swarmstart check formation_v close_formation

Exit code 2: a scenario is invalid; 5: a file could not be read."""
_JUDGE = """\
examples:
  swarmstart judge hard/walls_4 controls.csv
  swarmstart judge mine.yaml controls.csv --json

Exit code 2: the file does not fit the problem; 4: the trajectory is refused,
with the place and the size of what it breaks; 5: a file could not be read."""
_EXPORT = """\
examples:
  swarmstart export trajectory results/swarm_20/27a3 --format crazyswarm
  swarmstart export trajectory my_run --format skybrush --out show
  swarmstart export trajectory my_run --format qgc --origin 47.38,8.55,408
  swarmstart export c pendulum --main --out pendulum_c
  swarmstart export fmu pendulum --fmi 2.0

Exit code 2: the source or the options do not fit, or the format is not as
exact as asked; 5: a file could not be read or written."""
_SCHEMA = """\
examples:
  swarmstart schema > problem.schema.json
  swarmstart schema formation_flight
  swarmstart schema best_known

With it an editor completes keys and marks wrong ones while you type."""
_CACHE = """\
examples:
  swarmstart cache
  swarmstart cache --clear"""
_NEW = """\
examples:
  swarmstart new mine                   writes mine.yaml
  swarmstart new mine --kind python     writes mine.yaml and mine.py
  swarmstart new mine --kind formation_flight

Then: swarmstart check mine.yaml, and swarmstart run mine.yaml."""
_OPEN = """\
examples:
  swarmstart open results               the newest record
  swarmstart open results/pendulum/916ba650e7ef81b6

The page that `swarmstart report` wrote is opened if there is one, otherwise
the first figure. The path is always printed; without a display nothing else
happens, and the exit code is 0. Exit code 5: there is nothing to open."""
_COMPLETION = """\
to install it:
  bash   swarmstart completion bash >> ~/.bash_completion
  zsh    swarmstart completion zsh > ~/.zfunc/_swarmstart
         with these lines in ~/.zshrc:
           fpath=(~/.zfunc $fpath)
           autoload -U compinit && compinit
  tcsh   swarmstart completion tcsh > ~/.swarmstart.tcsh
         with this line in ~/.tcshrc:
           source ~/.swarmstart.tcsh

Then open a new terminal. It needs the package shtab:
  pip install 'swarmstart[completion]' (in a clone: pip install '.[completion]')"""


class Subcommand(NamedTuple):
    """A command: its texts, and the function that carries it out.

    The function is given as a name, so that only the command that is called imports
    anything.

    Attributes:
        help: Text of one line, for the list of commands.
        about: Text on what the command does, in full sentences.
        epilog: Examples and exit codes.
        command: "module:function" of options -> exit code.
    """

    help: str
    about: str
    epilog: str
    command: str


def parser() -> Parser:
    """Return the parser of the whole command line."""
    top = Parser(
        prog="swarmstart",
        description="Solve nonlinear optimal-control problems: a population search "
        "finds the start, IPOPT polishes it, a finer integration checks the answer.",
        epilog=_TOP,
        formatter_class=HelpFormatter,
    )
    top.add_argument(
        "--version", action=_Version, nargs=0,
        help="print the versions of swarmstart and of the packages it rests on",
    )  # fmt: skip
    # Each command has a --help of its own; argparse refuses a second one.
    common = Parser(add_help=False)
    common.add_argument(
        "--debug", action="store_true", help="show tracebacks and timings of the parts"
    )
    commands = top.add_subparsers(required=True, metavar="COMMAND", title="commands")
    for name, one in SUBCOMMANDS.items():
        made = commands.add_parser(
            name,
            help=one.help,
            description=one.about,
            epilog=one.epilog,
            formatter_class=HelpFormatter,
            parents=[common],
        )
        for option in OPTIONS[name]:
            option.add_to(made)
        # `cli` reports unknown words by the parser; `completion` needs the top.
        made.set_defaults(command=one.command, parser=made, top=top)
        # Not the default of --solvers: the solvers of a plan come before these.
        made.set_defaults(default_solvers=SOLVERS)
    return top


def subcommands() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command by its name, in the order of the help."""
    return subcommands_of(parser())


class _Version(argparse.Action):
    """Print the versions that matter and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the versions, and exit."""
        others = versions()
        # Our version stands first, before Python's.
        ours = others.pop("swarmstart")
        listed = ", ".join(f"{name} {version}" for name, version in others.items())
        python = ".".join(map(str, sys.version_info[:3]))
        answer(f"swarmstart {ours} (Python {python}, {listed})")
        parser.exit(DONE)


SUBCOMMANDS = {
    "run": Subcommand(
        "solve or simulate one scenario; draw and record it",
        "Solve or simulate one scenario. A few lines say in words what came out; "
        "the figures and the record are in a folder, whose "
        "path is the last line.",
        _RUN,
        f"{_ACTIONS}.run:run_command",
    ),
    "sweep": Subcommand(
        "solve the plan of a scenario for many starts and parameters",
        "Solve the first plan of a scenario for all of its `instances`: starts of "
        "states and values of parameters from a CSV file, on a grid, or drawn. The "
        "answers, a table and a figure are in a folder, whose path is the last line.",
        _SWEEP,
        f"{_ACTIONS}.sweep:sweep_command",
    ),
    "replicate": Subcommand(
        "judge every claim of the book chapter by running it",
        "Run all scenarios of the book chapter, and print for each published claim "
        "what was measured and whether it holds.",
        _REPLICATE,
        f"{_ACTIONS}.replicate:replicate_command",
    ),
    "compare": Subcommand(
        "compare solvers under equal budgets, with paired seeds",
        "Solve scenarios with several solvers, under equal budgets and with the same "
        "seeds, and print which solver is better, with statistics.",
        _COMPARE,
        f"{_ACTIONS}.compare:compare_command",
    ),
    "report": Subcommand(
        "write a page from what run, compare or replicate recorded",
        "Write one self-contained page (HTML, Markdown or LaTeX) from what run, "
        "compare or replicate recorded. It needs no network.",
        _REPORT,
        f"{_ACTIONS}.report:report_command",
    ),
    "open": Subcommand(
        "show the figures or the page of a record",
        "Open the page or the figures of a record with the program that the system "
        "uses for such files.",
        _OPEN,
        f"{_ACTIONS}.report:open_command",
    ),
    "new": Subcommand(
        "write a commented scenario to start from",
        "Write a small scenario that runs as it is, with a comment on every key; "
        "optional keys are commented out. Existing files are never replaced without "
        "--force.",
        _NEW,
        f"{_ACTIONS}.new:new_command",
    ),
    "list": Subcommand(
        "list scenarios, searches, measures and kinds",
        "List what there is: scenarios with kind, variants and run time; searches and "
        "polishes; measures with unit and meaning; kinds of scenario.",
        _LIST,
        f"{_ACTIONS}.listing:list_command",
    ),
    "check": Subcommand(
        "check scenarios and print every error at once",
        "Check scenarios in all their variants without running them, and print every "
        "error at once, each with line and column.",
        _CHECK,
        f"{_ACTIONS}.checking:check_command",
    ),
    "judge": Subcommand(
        "judge the controls in a CSV file on a problem",
        "Simulate the controls in a CSV file ten times finer than the problem's grid, "
        "and print the cost, the largest violation with its place, and the ratio to "
        "the best known cost of a hard problem.",
        _JUDGE,
        f"{_ACTIONS}.judging:judge_command",
    ),
    "export": Subcommand(
        "write flights for drones and autopilots, and controllers in C",
        "Write the positions of the vehicles of a record, along the simulated path, in "
        "a format of others; or the receding-horizon controller of a scenario as one "
        "C99 file, or as an FMU. Files that exist are never replaced.",
        _EXPORT,
        f"{_ACTIONS}.exporting:export_command",
    ),
    "schema": Subcommand(
        "print the JSON Schema of a kind of scenario, for editors",
        "Print the JSON Schema of the scenario format, for editors.",
        _SCHEMA,
        f"{_ACTIONS}.new:schema_command",
    ),
    "cache": Subcommand(
        "show the cache of machine code, or clear it",
        "Show where compiled machine code is kept and how large it is, or remove it.",
        _CACHE,
        f"{_ACTIONS}.cache:cache_command",
    ),
    "completion": Subcommand(
        "print a script that completes commands in your shell",
        "Print a script with which your shell completes commands, options and the "
        "names of scenarios and searches.",
        _COMPLETION,
        "swarmstart.cases.commands.front.completion:completion_command",
    ),
}
