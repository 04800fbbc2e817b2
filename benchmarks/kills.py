"""A campaign killed again and again: nothing finished lost, nothing half-written.

    python benchmarks/kills.py --kills 25

`swarmstart compare` is started, and it or one of its workers is killed (SIGKILL) at a
random moment; and again, until there have been so many kills. After each: every mark
can be read, what was finished is still there unchanged, and no process is left. At the
end the table is that of a comparison that nobody has killed.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from swarmstart.cases.campaign import MARK

COMMAND = (
    *("-m", "swarmstart", "compare", "passing_side", "--quiet", "--workers", "2"),
    *("--solvers", "lshade+ipopt,de,cpso,multistart-ipopt,ipopt"),
)
PATIENCE_S = 30.0


def start(root: Path, seeds: int) -> subprocess.Popen[bytes]:
    """Start the comparison in a process group of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        [sys.executable, *COMMAND, "--seeds", str(seeds), "--out", str(root)],
        env=environment,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )


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
        if pid != group and "spawn_main" in line:
            found.append(pid)
    return found


def kept(root: Path) -> dict[str, str]:
    """Return what is finished, by cell; a mark that cannot be read is an error."""
    marks = {file: file.read_text("utf-8") for file in root.glob(f"cells/*/{MARK}")}
    return {file.parent.name: json.loads(text) and text for file, text in marks.items()}


def killed_once(root: Path, seeds: int, chance: random.Random) -> tuple[str, int]:
    """Kill once; return what was killed, and how many cells are finished."""
    before = kept(root)
    process = start(root, seeds)
    time.sleep(chance.uniform(0.5, 6.0))
    target = "the command"
    busy = workers(process.pid)
    if busy and chance.random() < 0.5:
        target = "a worker"
        os.kill(chance.choice(busy), signal.SIGKILL)
        time.sleep(chance.uniform(0.1, 1.0))
    process.kill()
    process.wait()
    deadline = time.monotonic() + PATIENCE_S
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    left, after = members(process.pid), kept(root)
    if left:
        raise SystemExit(f"processes left after {PATIENCE_S:g} s: {left}")
    lost = [name for name, text in before.items() if after.get(name) != text]
    if lost:
        raise SystemExit(f"finished cells lost or changed: {lost}")
    return target, len(after)


def main(arguments: Sequence[str] | None = None) -> int:
    """Kill, and say what is left each time."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=25)
    parser.add_argument("--seeds", type=int, default=30)
    options = parser.parse_args(arguments)
    chance = random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        root, whole = Path(folder) / "killed", Path(folder) / "whole"
        for number in range(1, options.kills + 1):
            target, count = killed_once(root, options.seeds, chance)
            print(f"kill {number}: {target}, {count} cells finished", flush=True)
        tables = []
        for where in (root, whole):
            said, _ = start(where, options.seeds).communicate()
            tables.append(said.decode().rpartition("results  ")[0])
        failures = [text for text in kept(root).values() if json.loads(text)["failure"]]
        temporary = list(root.glob("cells/*/.*tmp"))
    print(tables[0])
    print(f"same table: {tables[0] == tables[1]}; failed cells: {len(failures)}")
    print(f"files under temporary names: {len(temporary)}")
    return 0 if tables[0] == tables[1] and not failures else 3


if __name__ == "__main__":
    sys.exit(main())
