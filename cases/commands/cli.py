"""The command line: `swarmstart run | replicate | compare | report | list | ...`.

Exit codes: 0 done; 1 internal error; 2 wrong usage or invalid input; 3 ran, but a gate
failed; 4 no feasible solution; 5 a file could not be read or written; 130 interrupted,
finished work kept.

Everything heavy is imported by the command that needs it.
"""

import argparse
import atexit
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, NoReturn

from swarmstart.cases.commands.output import (
    DONE,
    FILE,
    INTERNAL,
    INTERRUPTED,
    INVALID,
    OutputError,
    answer,
    finish,
    occupy_closed_streams,
    say,
    tell,
)
from swarmstart.cases.commands.progress import first_sign
from swarmstart.cases.format.registry import POLISHES, SEARCHES
from swarmstart.errors import SwarmstartError

logger = logging.getLogger(__name__)

GARBAGE_THRESHOLD = 50_000
"""New objects between two looks for garbage; Python's 700 take 0.2 s of imports."""

MOST_FLAWS = 20
"""What is wrong with a scenario beyond that many is counted."""
SOLVERS = "cpso,de,ga,lshade+ipopt,multistart-ipopt,ipopt"

_EPILOG = """for example:
  swarmstart run formation_v
  swarmstart run formation_obstacle --variant literal --search ga --seed 3
  swarmstart run my_scenario.yaml --set steps=20 --out my_run
  swarmstart replicate --quick
  swarmstart compare passing_side --solvers lshade+ipopt,ipopt

exit codes: 0 done, 1 internal error, 2 invalid input, 3 a gate failed,
4 no feasible solution, 5 a file could not be read or written, 130 interrupted"""


class _Parser(argparse.ArgumentParser):
    """A parser that answers and tells as the commands do, whatever the streams are."""

    def print_help(self, file: object = None) -> None:
        answer(self.format_help().rstrip())

    def error(self, message: str) -> NoReturn:
        """Say what is wrong, and nothing without a standard error; leave."""
        tell(f"{self.format_usage()}{self.prog}: error: {message}")
        raise SystemExit(INVALID)


def program() -> int:
    """Run the command line as what a process is for; return the exit code.

    Signals that come when the command is over change nothing any more.
    """
    occupy_closed_streams()
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        code = _interruptible(None, afterwards=lambda _: signal.SIG_IGN)
    except SystemExit as leaving:  # of argparse
        code = int(leaving.code or DONE)
    try:
        finish()
    except OutputError as error:
        return _reported(error)
    if code == INTERRUPTED:
        # An interrupt within exec() of a text (an import, a dataclass) is remembered by
        # Python, which would end the process by SIGINT in place of this code.
        atexit._run_exitfuncs()
        os._exit(code)
    gc.freeze()  # Python looks for garbage once more at its end: 0.2 s for nothing.
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        arguments: The command line without the program's name; None means sys.argv's.

    Returns:
        The exit code.
    """
    before = {number: signal.getsignal(number) for number in _requests()}
    return _interruptible(arguments, afterwards=before.__getitem__)


def _interruptible(
    arguments: Sequence[str] | None, *, afterwards: Callable[[int], Any]
) -> int:
    """Run a command that signals interrupt; afterwards they are handled otherwise."""
    asked_to_stop: list[int] = []
    is_over = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not is_over:
            asked_to_stop.append(number)
            raise KeyboardInterrupt

    numbers = _requests()
    try:
        for number in numbers:
            signal.signal(number, interrupt)
        return _carried_out(arguments, asked_to_stop)
    except KeyboardInterrupt:  # A second one, while something is said of the first.
        return INTERRUPTED
    finally:
        is_over = True
        for number in numbers:
            signal.signal(number, afterwards(number))


def _requests() -> list[int]:
    """Return the signals that ask to stop, without those that are to be ignored."""
    if threading.current_thread() is not threading.main_thread():
        return []  # Python delivers none there.
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [n for n in numbers if signal.getsignal(n) not in (signal.SIG_IGN, None)]


def _carried_out(arguments: Sequence[str] | None, asked_to_stop: list[int]) -> int:
    """Run a command; return the exit code, however it ends."""
    try:
        options = _parsed(arguments)
        command: Callable[[argparse.Namespace], int] = options.command
        with first_sign(quiet=options.debug or getattr(options, "quiet", False)):
            return command(options)
    except KeyboardInterrupt as interrupt:
        say(f"interrupted{': ' if interrupt.args else ''}{interrupt}")
        return INTERRUPTED
    except BrokenPipeError:  # The reader of our output has gone.
        return DONE
    except Exception as error:
        logger.debug("", exc_info=True)
        if asked_to_stop:  # What the interrupt became on its way.
            say("interrupted")
            return INTERRUPTED
        return _reported(error)


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options; what a command does not know is its own error."""
    options, unknown = parser().parse_known_args(arguments)
    options.words = list(sys.argv[1:] if arguments is None else arguments)
    if unknown:
        options.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    if options.debug:
        logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
        logging.getLogger("swarmstart").setLevel(logging.DEBUG)
    return options


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    top = _Parser(
        prog="swarmstart",
        description="Warm starts for nonlinear optimal control by population search.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action=_Version, nargs=0, help="versions that matter")
    common = _Parser(add_help=False)
    common.add_argument(
        "--debug", action="store_true", help="show tracebacks and timings"
    )
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    _add_run(commands.add_parser("run", help="fly one scenario", parents=[common]))

    about = "every claim of the chapter: what was measured, whether it holds"
    _add_replicate(commands.add_parser("replicate", help=about, parents=[common]))

    about = "solvers side by side: same budget, paired seeds"
    _add_compare(commands.add_parser("compare", help=about, parents=[common]))

    about = "one offline page of what run, compare or replicate recorded"
    _add_report(commands.add_parser("report", help=about, parents=[common]))

    listing = commands.add_parser(
        "list", help="scenarios, searches, measures", parents=[common]
    )
    listing.add_argument(
        "text", nargs="?", default="", metavar="TEXT",
        help="only what contains it, in its name, title or heading",
    )  # fmt: skip
    listing.add_argument("--json", action="store_true", help="one JSON object")
    listing.set_defaults(command=_list, parser=listing)

    check = commands.add_parser(
        "check", help="is this scenario valid: every error at once", parents=[common]
    )
    check.add_argument("scenarios", nargs="+", metavar="SCENARIO")
    check.set_defaults(command=_check, parser=check)

    about = "JSON Schema of the scenario format, for editors"
    schema = commands.add_parser("schema", help=about, parents=[common])
    schema.add_argument(
        "kind", nargs="?", default="problem", metavar="KIND",
        help="of scenario; default: problem",
    )  # fmt: skip
    schema.set_defaults(command=_schema, parser=schema)

    about = "where machine code is kept, and how large it is"
    cache = commands.add_parser("cache", help=about, parents=[common])
    cache.add_argument("--clear", action="store_true", help="remove all of it")
    cache.add_argument("--json", action="store_true", help="one JSON object")
    cache.set_defaults(command=_cache, parser=cache)
    return top


def _add_run(run: _Parser) -> None:
    run.add_argument(
        "scenario", metavar="SCENARIO", help="a name of `swarmstart list`, or a path"
    )
    _add_scenario_options(run)
    run.add_argument("--search", choices=[*SEARCHES], help="default: the scenario's")
    run.add_argument("--polish", choices=[*POLISHES], help="default: the scenario's")
    which = run.add_mutually_exclusive_group()
    which.add_argument("--seed", type=_seed, default=0, metavar="N", help="default: 0")
    which.add_argument(
        "--seeds", type=_count, metavar="N",
        help="run seeds 0 to N - 1; lowest, median and highest of every measure",
    )  # fmt: skip
    run.add_argument(
        "--workers", type=_count, default=os.cpu_count() or 1, metavar="N",
        help="processes for --seeds; default: every core",
    )  # fmt: skip
    run.add_argument(
        "--bound", metavar="120s",
        help="then seek for so long what no plan can cost less than, with a proof; of "
        "scenarios that make one plan",
    )  # fmt: skip
    run.add_argument("--out", metavar="DIR", help="default: results/<scenario>/<key>")
    run.add_argument(
        "--force", action="store_true",
        help="write into --out whatever is there; files of other names stay",
    )  # fmt: skip
    run.add_argument("--no-figures", action="store_true", help="do not draw")
    run.add_argument("--animation", choices=["gif", "mp4"], help="animate the flight")
    run.add_argument("--json", action="store_true", help="one JSON object on stdout")
    run.add_argument("-q", "--quiet", action="store_true", help="no progress on stderr")
    run.add_argument(
        "--fail-on",
        action="append",
        default=[],
        metavar="'MEASURE > NUMBER'",
        help="exit with 3 if this holds (== null: undefined); may be given again",
    )
    run.add_argument(
        "--print-config", action="store_true", help="print the resolved scenario"
    )
    run.set_defaults(command=_run, parser=run)


def _add_replicate(replicate: _Parser) -> None:
    several = replicate.add_mutually_exclusive_group()
    several.add_argument(
        "--quick", action="store_true", help="one seed: 'not judged' if too few"
    )
    several.add_argument(
        "--seeds", type=_count, metavar="N", help="seeds of each run that is random"
    )
    replicate.add_argument(
        "--only", type=_count, action="append", default=[], metavar="ID",
        help="one claim, by its number; may be given several times",
    )  # fmt: skip
    replicate.add_argument(
        "--dry-run", action="store_true", help="say how many runs, and how long"
    )
    replicate.add_argument("--out", metavar="DIR", help="default: results/replication")
    _add_campaign(replicate, markdown=True)
    replicate.set_defaults(command=_replicate, parser=replicate)


def _add_compare(compare: _Parser) -> None:
    compare.add_argument(
        "scenarios", nargs="+", metavar="SCENARIO",
        help="scenarios, or a plan: a YAML file with the key compare",
    )  # fmt: skip
    compare.add_argument(
        "--solvers", metavar="NAME,...",
        help=f"such as lshade[size=60]+ipopt; multistart-ipopt is always among them; "
        f"default: {SOLVERS}",
    )  # fmt: skip
    compare.add_argument("--seeds", type=_count, metavar="N", help="default: 10")
    compare.add_argument(
        "--budget", metavar="4000evals|5s",
        help="of one planning problem; default: 4000evals",
    )  # fmt: skip
    compare.add_argument(
        "--of", choices=["auto", "plan", "flight"],
        help="one planning problem or whole flights; default: what the scenario is",
    )  # fmt: skip
    _add_scenario_options(compare)
    compare.add_argument(
        "--timeout", type=_count, metavar="S",
        help="seconds after which a run is given up; default: 300",
    )  # fmt: skip
    compare.add_argument(
        "--repair", action=argparse.BooleanOptionalAction, default=None,
        help="solve answers that break a constraint between the checks again with a "
        "margin, for all solvers alike; default: yes",
    )  # fmt: skip
    compare.add_argument(
        "--bound", metavar="60s",
        help="then seek for so long what no plan can cost less than, with a proof; of "
        "each scenario that is compared by one plan",
    )  # fmt: skip
    compare.add_argument(
        "--dry-run", action="store_true", help="say how many runs, and how long"
    )
    compare.add_argument("--out", metavar="DIR", help="default: results/compare")
    compare.add_argument(
        "--times", action="store_true", help="print seconds, which differ each time"
    )
    compare.add_argument(
        "--parquet", action="store_true", help="write results.parquet beside the table"
    )
    compare.add_argument(
        "--baseline", metavar="DIR", help="an earlier comparison to judge this one by"
    )
    compare.add_argument(
        "--fail-on", choices=["regression"],
        help="exit with 3 if a solver is worse than in the baseline",
    )  # fmt: skip
    compare.add_argument(
        "--margin", type=_share, default=0.1, metavar="10%",
        help="by which a solver may be worse; default: 10%%",
    )  # fmt: skip
    compare.add_argument(
        "--engine", choices=["local", "dask"], default="local",
        help="dask: on the workers of --scheduler; default: local",
    )  # fmt: skip
    compare.add_argument(
        "--scheduler", metavar="ADDRESS", help="of Dask, such as tcp://10.0.0.1:8786"
    )
    _add_campaign(compare)
    compare.set_defaults(command=_compare, parser=compare, default_solvers=SOLVERS)


def _add_report(report: _Parser) -> None:
    report.add_argument(
        "folders", nargs="+", metavar="DIR", help="what a command wrote, its --out"
    )
    report.add_argument(
        "--format", choices=["html", "md", "latex"], action="append", default=[],
        dest="formats", help="may be given several times; default: html and md",
    )  # fmt: skip
    report.add_argument(
        "--out", metavar="DIR", help="where the files go; default: each into its DIR"
    )
    report.set_defaults(command=_report, parser=report)


def _add_scenario_options(command: argparse.ArgumentParser) -> None:
    """Add the options that change a scenario before it is run."""
    command.add_argument("--variant", metavar="NAME", help="default: corrected")
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY.PATH=VALUE",
        dest="assignments",
        help="change one value of the scenario; may be given several times",
    )  # fmt: skip
    command.add_argument(
        "--allow-python", action="store_true",
        help="run the file that a scenario of kind python names",
    )  # fmt: skip


def _add_campaign(command: argparse.ArgumentParser, *, markdown: bool = False) -> None:
    """Add what all commands of many runs have."""
    command.add_argument(
        "--workers", type=_count, default=os.cpu_count() or 1, metavar="N",
        help="processes; default: every core",
    )  # fmt: skip
    printed = command.add_mutually_exclusive_group()
    printed.add_argument("--json", action="store_true", help="one JSON object")
    if markdown:
        printed.add_argument("--markdown", action="store_true", help="a Markdown table")
    command.add_argument("-q", "--quiet", action="store_true", help="no progress")


class _Version(argparse.Action):
    """Print the versions that matter and leave."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from swarmstart.cases.record.record import versions

        others = versions()
        ours = others.pop("swarmstart")
        listed = ", ".join(f"{name} {version}" for name, version in others.items())
        python = ".".join(map(str, sys.version_info[:3]))
        answer(f"swarmstart {ours} (Python {python}, {listed})")
        parser.exit(DONE)


def _run(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.run import run_command

    return run_command(options)


def _list(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.listing import print_listing

    print_listing(options.text, as_json=options.json)
    return DONE


def _check(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.checking import check

    worst = DONE
    for name in options.scenarios:
        try:
            answer(check(name))
        except SwarmstartError as error:
            worst = max(worst, _reported(error))
    return worst


def _schema(options: argparse.Namespace) -> int:
    import json

    from swarmstart.cases.format.registry import KINDS

    if options.kind not in KINDS:
        say(f"expected KIND to be one of {', '.join(KINDS)}, found {options.kind!r}")
        return INVALID
    from swarmstart.cases.format.schema import scenario_schema

    answer(json.dumps(scenario_schema(options.kind), indent=2))
    return DONE


def _cache(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.cache import cache_command

    return cache_command(options)


def _replicate(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.replicate import replicate_command

    return replicate_command(options)


def _compare(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.compare import compare_command

    return compare_command(options)


def _report(options: argparse.Namespace) -> int:
    from swarmstart.cases.commands.report import report_command

    return report_command(options)


def _share(text: str) -> float:
    """Return a part such as 10% or 0.1."""
    try:
        number = float(text.removesuffix("%"))
    except ValueError:
        number = -1.0
    part = number / 100 if text.endswith("%") else number
    if not 0.0 <= part < 1.0:
        raise argparse.ArgumentTypeError(
            f"expected a part such as 10%, below 100%; found {text!r}"
        )
    return part


def _count(text: str) -> int:
    """Return a whole number from 1."""
    if not text.isdecimal() or not 1 <= int(text) <= 10_000:  # noqa: PLR2004
        raise argparse.ArgumentTypeError(
            f"expected a whole number from 1 to 10000, found {text!r}"
        )
    return int(text)


def _seed(text: str) -> int:
    """Return a seed: a whole number from 0."""
    if not text.isdecimal() or len(text) > 18:  # noqa: PLR2004 - fits 64 bits
        raise argparse.ArgumentTypeError(
            f"expected a whole number from 0 to 10^18, found {text!r}"
        )
    return int(text)


def _reported(error: Exception) -> int:
    """Tell an error in one message and return its exit code."""
    from swarmstart.cases.format.document import UnreadableFileError, YamlError
    from swarmstart.cases.format.scenario import InvalidScenarioError
    from swarmstart.cases.record.files import RecordError

    if isinstance(error, InvalidScenarioError):
        for flaw in error.flaws[:MOST_FLAWS]:
            _tell_with_frame(str(flaw), flaw.frame)
        if len(error.flaws) > MOST_FLAWS:
            say(f"and {len(error.flaws) - MOST_FLAWS} more of the kind")
        return INVALID
    if isinstance(error, YamlError):
        _tell_with_frame(str(error), error.frame)
        return INVALID
    if isinstance(error, SwarmstartError):
        say(str(error))
        of_file = isinstance(error, UnreadableFileError | RecordError | OutputError)
        return FILE if of_file else INVALID
    return _reported_of_system(error)


def _reported_of_system(error: Exception) -> int:
    """Report an error from outside this package and return its exit code."""
    if isinstance(error, OSError):
        say(f"expected to read and write files, found: {error}")
        return FILE
    if isinstance(error, MemoryError):
        say(f"expected enough memory, found too little: {error}")
        return INVALID
    say(f"internal error: {type(error).__name__}: {error} (--debug shows where)")
    return INTERNAL


def _tell_with_frame(text: str, frame: str) -> None:
    tell("\n".join(filter(None, (text, frame))))
