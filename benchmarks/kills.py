"""Repeated interrupts and kills of commands: no finished work lost, nothing left over.

    python benchmarks/kills.py --signals 50 --kills 50 --seed 0

`swarmstart run`, `compare` and `replicate` are started in turn and sent SIGINT, SIGTERM
or SIGHUP, or killed (SIGKILL; of `compare` and `replicate` a worker or the command), at
a random moment after the program has begun to listen to signals; and again in the same
folder, until each kind has happened so often. After each:

- what was finished is still there, unchanged, and every mark can be read;
- a signal ended the command with 130 and without a traceback, and it left neither a
  process nor a file under a temporary name;
- a kill left no process.

A command that ends by itself has the numbers of one that was never interrupted, and no
rests of any kill; then its folder is emptied, and the next round begins.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cell_work import MARK
from swarmstart.cases.commands.terminal import GATE, INTERRUPTED
from swarmstart.cases.record.files import is_temporary
from swarmstart.cases.record.partial import load_partial

PATIENCE_S = 60.0
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
WALL_TIMES = ("step_seconds", "wall_s", "seconds", "compile_seconds")
WHOLE = {"run": "whole"}
Numbers = Any
"""Results of a command, without wall times and the folder."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command that continues from finished work.

    Attributes:
        name: Its name.
        arguments: Its arguments without --out.
        finished: Folder -> finished work there: name -> content.
        numbers: (folder, standard output) -> its results.
    """

    name: str
    arguments: tuple[str, ...]
    finished: Callable[[Path], dict[str, str]]
    numbers: Callable[[Path, str], Numbers]


def without_times(content: Any) -> Any:
    """Return JSON content without wall times and folders."""
    if isinstance(content, dict):
        return {
            key: without_times(value)
            for key, value in content.items()
            if not key.startswith(WALL_TIMES) and key not in ("out", "resumed_steps")
        }
    return [*map(without_times, content)] if isinstance(content, list) else content


def finished_steps(folder: Path) -> dict[str, str]:
    """Return the finished steps of a run, or that all are; raises if unreadable."""
    if (folder / "run.json").exists():
        return WHOLE
    if not (folder / "partial.json").exists():
        return {}
    mark = json.loads((folder / "partial.json").read_text())
    kept = load_partial(folder, mark["key"], substeps=20)
    steps = [] if kept is None else kept[0]
    return {f"step {step.number}": step.state.tobytes().hex() for step in steps}


def flown(folder: Path, _: str) -> Numbers:
    """Return the flight and the measures of a run."""
    with np.load(folder / "trajectory.npz", allow_pickle=False) as arrays:
        flight = {
            name: arrays[name].tobytes() for name in arrays if name not in WALL_TIMES
        }
    figures = sorted(file.name for file in folder.glob("figures/*"))
    told = json.loads((folder / "run.json").read_text())
    return flight, without_times({**told, "figures": sorted(told["figures"])}), figures


def finished_cells(folder: Path) -> dict[str, str]:
    """Return the marks of finished cells; one that cannot be read is an error."""
    marks = {
        file.parent.name: file.read_text("utf-8")
        for file in folder.glob(f"cells/*/{MARK}")
    }
    return {name: text for name, text in marks.items() if not json.loads(text)["again"]}


def told(_: Path, out: str) -> Numbers:
    """Return what a campaign has printed, as JSON."""
    return without_times(json.loads(out))


COMMANDS = (
    Command(
        name="run",
        arguments=(
            *("run", "formation_v", "--variant", "literal", "--quiet"),
            *("--set", "steps=16", "--set", "budget.evaluations=2000"),
        ),
        finished=finished_steps,
        numbers=flown,
    ),
    Command(
        name="compare",
        arguments=(
            *("compare", "passing_side", "--quiet", "--json", "--workers", "2"),
            *("--solvers", "lshade+ipopt,de", "--seeds", "3", "--budget", "600evals"),
        ),
        finished=finished_cells,
        numbers=told,
    ),
    Command(
        name="replicate",
        arguments=(
            *("replicate", "--only", "1", "--seeds", "4"),
            *("--quiet", "--json", "--workers", "2"),
        ),
        finished=finished_cells,
        numbers=told,
    ),
)


def started(command: Command, folder: Path) -> subprocess.Popen[str]:
    """Start a command in a process group of its own; return when it listens."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "swarmstart"),
            *(*command.arguments, "--out", str(folder)),
        ],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while process.poll() is None and not listens(process.pid):
        time.sleep(1e-3)
    return process


def listens(pid: int) -> bool:
    """Return whether a process handles SIGTERM, from /proc."""
    try:
        status = (Path("/proc") / str(pid) / "status").read_text()
    except OSError:
        return False
    (caught,) = (line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def members(group: int) -> list[int]:
    """Return the living processes of a group, from /proc."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            _, _, rest = (folder / "stat").read_text().rpartition(") ")
        except OSError:
            continue
        state, _, its_group = rest.split()[:3]
        if int(its_group) == group and state != "Z":
            found.append(int(folder.name))
    return found


def workers(group: int) -> list[int]:
    """Return the processes of a group that work, not its head or its helpers."""
    found = []
    for pid in members(group):
        try:
            line = (Path("/proc") / str(pid) / "cmdline").read_text()
        except OSError:
            continue
        if pid != group and "cell_work" in line:
            found.append(pid)
    return found


def temporary_files(folder: Path) -> set[Path]:
    """Return what lies under temporary names."""
    return {file for file in folder.rglob("*") if is_temporary(file.name)}


@dataclass(frozen=True, kw_only=True)
class Before:
    """Files before an attack: finished work, and rests of earlier kills."""

    finished: dict[str, str]
    rests: set[Path]


@dataclass(frozen=True, kw_only=True)
class Ending:
    """End of a command: exit code, standard output and error, and the signal sent."""

    code: int
    out: str
    err: str
    sent: str


def ended(process: subprocess.Popen[str], sent: str = "") -> Ending:
    """Wait for a command and all of its processes, longer if nothing was sent."""
    patience = PATIENCE_S if sent else 10 * PATIENCE_S
    try:
        out, err = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        after = sent or "it was started"
        raise SystemExit(f"still there {patience:g} s after {after}") from None
    deadline = time.monotonic() + PATIENCE_S
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    if left := members(process.pid):
        raise SystemExit(f"processes left after {sent}: {left}")
    return Ending(code=process.returncode, out=out, err=err, sent=sent)


def waited(process: subprocess.Popen[str], seconds: float) -> bool:
    """Wait; return whether the command is still under way."""
    try:
        process.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        return True
    return False


def signalled(
    process: subprocess.Popen[str], chance: random.Random, seconds: float
) -> Ending | None:
    """Send a signal at a random moment; None if the command ended before."""
    number = chance.choice(SIGNALS)
    if not waited(process, chance.uniform(0.0, seconds)):
        return None
    # A terminal sends SIGINT and SIGHUP to all processes of a command.
    if number != signal.SIGTERM and chance.random() < 0.5:
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    return ended(process, signal.Signals(number).name)


def killed(
    process: subprocess.Popen[str], chance: random.Random, seconds: float
) -> Ending | None:
    """Kill a command, and perhaps one of its workers before; None: it ended before."""
    if not waited(process, chance.uniform(0.0, seconds)):
        return None
    sent, busy = "SIGKILL", workers(process.pid)
    if busy and chance.random() < 0.5:
        sent = "SIGKILL of a worker, and SIGKILL"
        os.kill(chance.choice(busy), signal.SIGKILL)
        if not waited(process, chance.uniform(0.0, 1.0)):
            return None
    process.kill()
    return ended(process, sent)


def complaints(
    command: Command, folder: Path, before: Before, ending: Ending
) -> list[str]:
    """Return what is wrong after a signal or a kill."""
    wrong = []
    after = command.finished(folder)
    if after != WHOLE and any(
        after.get(name) != content for name, content in before.finished.items()
    ):
        wrong.append("finished work is lost or changed")
    if ending.sent.startswith("SIGKILL"):
        return wrong
    if ending.code != INTERRUPTED:
        wrong.append(f"exit code {ending.code}: {ending.err[-500:]}")
    if "Traceback" in ending.err or "internal error" in ending.err:
        wrong.append(f"a traceback: {ending.err[-2000:]}")
    # It may have been stopped before it removed those of an earlier kill.
    if rests := temporary_files(folder) - before.rests:
        wrong.append(f"temporary files: {rests}")
    return wrong


def undisturbed(command: Command, folder: Path) -> tuple[Numbers, float]:
    """Return what a command finds if nothing happens to it, and how long it takes."""
    shutil.rmtree(folder, ignore_errors=True)
    process = started(command, folder)
    began = time.monotonic()
    out, err = process.communicate()
    if process.returncode not in (0, GATE):
        raise SystemExit(f"{command.name} fails by itself: {err}")
    return command.numbers(folder, out), time.monotonic() - began


@dataclass(kw_only=True)
class Siege:
    """A command under attack, in one folder.

    Attributes:
        command: The command.
        folder: Its folder.
        whole: What it finds undisturbed.
        seconds: How long that takes.
        rounds: How often it has finished between the attacks.
        wrong: Everything that was wrong.
    """

    command: Command
    folder: Path
    whole: Numbers
    seconds: float
    rounds: int
    wrong: list[str]

    def attacked(
        self, attack: Callable[..., Ending | None], chance: random.Random
    ) -> str:
        """Attack until the attack comes in time; return what happened."""
        while True:
            before = Before(
                finished=self.command.finished(self.folder),
                rests=temporary_files(self.folder),
            )
            process = started(self.command, self.folder)
            ending = attack(process, chance, self.seconds)
            if ending is None or ending.code in (0, GATE):  # It has ended by itself.
                self.end_round(ending or ended(process))
                continue
            wrong = complaints(self.command, self.folder, before, ending)
            after = self.command.finished(self.folder)
            if after == WHOLE:  # Committed before the attack.
                self.judge(self.command.numbers(self.folder, ""))
                shutil.rmtree(self.folder)
            what = f"{self.command.name}, {ending.sent}"
            for text in wrong:
                self.note(f"{what}: {text}")
            return f"{what}: {len(after)} finished"

    def judge(self, found: Numbers) -> None:
        """Note if other numbers than those of an undisturbed command are found."""
        if found != self.whole:
            self.note(f"{self.command.name} has found other numbers")

    def note(self, text: str) -> None:
        """Note, and say at once, that something is wrong."""
        print(f"wrong: {text}", flush=True)
        self.wrong.append(text)

    def end_round(self, ending: Ending) -> None:
        """Compare what a command found that has ended by itself; empty the folder."""
        name = self.command.name
        if ending.code not in (0, GATE):
            self.note(f"{name} ends with {ending.code}: {ending.err[-2000:]}")
        else:
            self.judge(self.command.numbers(self.folder, ending.out))
        rests = [*temporary_files(self.folder), *self.folder.glob("partial.*")]
        if rests:
            self.note(f"{name} has left {rests}")
        self.rounds += 1
        shutil.rmtree(self.folder)


def besieged(
    commands: Sequence[Command], *, signals: int, kills: int, seed: int
) -> tuple[Counter[str], int, list[str]]:
    """Attack commands in turn.

    Args:
        commands: The commands.
        signals: Number of signals, over all commands.
        kills: Number of kills.
        seed: Of the moments and of what is sent.

    Returns:
        What happened how often, rounds that ended by themselves, and
        everything that was wrong.
    """
    chance, happened = random.Random(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as place:
        sieges = []
        for command in commands:
            whole, seconds = undisturbed(command, Path(place) / "whole")
            folder = Path(place) / command.name
            sieges.append(
                Siege(
                    command=command,
                    folder=folder,
                    whole=whole,
                    seconds=seconds,
                    rounds=0,
                    wrong=[],
                )
            )
        attacks = [signalled] * signals + [killed] * kills
        chance.shuffle(attacks)
        for number, attack in enumerate(attacks):
            what = sieges[number % len(sieges)].attacked(attack, chance)
            happened[what.partition(":")[0]] += 1
            print(f"{number + 1}: {what}", flush=True)
        for siege in sieges:
            process = started(siege.command, siege.folder)
            siege.end_round(ended(process))
    wrong = [text for siege in sieges for text in siege.wrong]
    return happened, sum(siege.rounds for siege in sieges), wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack, and say what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--signals", type=int, default=50)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    happened, rounds, wrong = besieged(
        COMMANDS, signals=options.signals, kills=options.kills, seed=options.seed
    )
    for what, count in sorted(happened.items()):
        print(f"{count:4d}  {what}")
    print(f"finished {rounds} times in between and at the end; wrong: {len(wrong)}")
    for text in wrong:
        print(f"  {text}")
    return GATE if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
