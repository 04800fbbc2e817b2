"""Share of deliberate faults in the code that the mirrored tests notice.

    python benchmarks/faults.py --seed 16 --count 200
    python benchmarks/faults.py --seed 1 --count 30 --file 'ocp/*' --jobs 2

Places are drawn with a seed from the files that make proofs, statuses and verdicts
sound; at each a sign, a comparison, a constant or an extreme is changed
(`fault_places`). Each fault is put into a private copy of the tree, and the tests of
its own file are run, tests/<folder>/test_<module>.py, and no others. A fault is caught
if one of them fails or if they no longer end. Faults that change nothing but effort or
text are named with the reason and not counted (`harmless_faults.yaml`).
"""

import argparse
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from scipy.stats import binomtest

from swarmstart.benchmarks.fault_places import Fault, applied, faults, line_of
from swarmstart.benchmarks.tables import row

ROOT = Path(__file__).resolve().parent.parent
FILES = {
    "proofs": (
        *(f"terminal_set/*/{name}.py" for name in (
            "intervals", "interval_kernel", "smoothness", "taylor", "enclosure",
            "decrease", "flow_error", "hold_margins", "residual", "proof",
            "level_search", "drift", "certification", "ellipsoid", "stability",
            "matrix_equations", "linearisation",
        )),
        "terminal_set/checker/*.py", "terminal_set/checker/*/*.py",
    ),
    "statuses": tuple(f"ocp/*/{name}.py" for name in (
        "status", "solution", "checking", "constraints", "separation", "optimality",
        "dual_mode", "improving", "repair", "path", "kinks", "scaling",
    )),
    "verdicts": tuple(f"cases/{name}.py" for name in (
        "campaign/running/claims", "campaign/studies/verdicts",
        "campaign/judging/statistics", "campaign/studies/replication",
        "record/trajectory_arrays", "kinds/planar", "commands/actions/checking",
    )),
}  # fmt: skip
"""Patterns of the files that faults are drawn from, by what they make sound."""
MORE_TESTS: Mapping[str, tuple[str, ...]] = {
    "cases/campaign/judging/statistics.py": (
        "tests/cases/campaign/judging/test_change_intervals.py",
        "tests/cases/campaign/judging/test_ranks.py",
    ),
    "cases/record/trajectory_arrays.py": (
        "tests/cases/record/test_partial.py",
        "tests/cases/record/test_step_table.py",
    ),
    "ocp/answer/improving.py": ("tests/ocp/test_improving_settled.py",),
    "ocp/answer/solution.py": ("tests/ocp/answer/test_said.py",),
    "ocp/loop/dual_mode.py": ("tests/terminal_set/test_rest.py",),
    "ocp/rollout/kinks.py": ("tests/ocp/rollout/test_smoothing.py",),
    "ocp/rollout/scaling.py": ("tests/ocp/rollout/test_sizes_by_hand.py",),
    "ocp/rollout/status.py": (
        "tests/ocp/rollout/test_stiffness.py",
        "tests/ocp/test_status_advice.py",
    ),
    "ocp/system/constraints.py": (
        "tests/ocp/statement/test_problem.py",
        "tests/ocp/system/test_moving_bounds.py",
        "tests/ocp/rollout/test_soft.py",
    ),
    "terminal_set/interval_arithmetic/interval_kernel.py": (
        "tests/terminal_set/interval_arithmetic/test_interval_functions.py",
    ),
    "terminal_set/interval_arithmetic/taylor.py": (
        "tests/terminal_set/interval_arithmetic/test_cells.py",
    ),
    "terminal_set/linear/ellipsoid.py": (
        "tests/terminal_set/linear/test_level.py",
        "tests/terminal_set/linear/test_reference.py",
    ),
    "terminal_set/linear/matrix_equations.py": (
        "tests/terminal_set/linear/test_lyapunov.py",
    ),
    "terminal_set/proving/certification.py": (
        "tests/terminal_set/proving/test_certify.py",
        "tests/terminal_set/proving/test_drift.py",
    ),
    "terminal_set/proving/drift.py": (
        "tests/terminal_set/proving/test_prerequisites.py",
    ),
    "terminal_set/proving/flow_error.py": (
        "tests/terminal_set/proving/test_error_search.py",
    ),
    "terminal_set/proving/hold_margins.py": (
        "tests/terminal_set/proving/test_growth.py",
        "tests/terminal_set/proving/test_held_motion.py",
    ),
    "terminal_set/proving/level_search.py": (
        "tests/terminal_set/proving/test_choice.py",
    ),
    "terminal_set/proving/proof.py": ("tests/terminal_set/proving/test_refutation.py",),
    "terminal_set/checker/findings.py": (
        "tests/terminal_set/checker/test_motion.py",
        "tests/terminal_set/test_check.py",
    ),
    "terminal_set/checker/certificate_file.py": ("tests/terminal_set/test_check.py",),
    "terminal_set/checker/command.py": ("tests/terminal_set/checker/test_output.py",),
    "terminal_set/checker/ellipsoid_statements.py": (
        "tests/terminal_set/checker/test_closed_form.py",
        "tests/terminal_set/checker/test_closed_form_edges.py",
        "tests/terminal_set/checker/test_statements_by_parts.py",
    ),
    "terminal_set/checker/ellipsoid_search.py": (
        "tests/terminal_set/checker/test_ellipsoid_statements.py",
    ),
    "terminal_set/checker/models.py": (
        "tests/terminal_set/checker/test_evaluation.py",
        "tests/terminal_set/checker/test_functions.py",
    ),
    "terminal_set/checker/rays.py": (
        "tests/terminal_set/checker/test_evaluation.py",
        "tests/terminal_set/checker/test_functions.py",
    ),
    "terminal_set/checker/evaluation.py": (
        "tests/terminal_set/checker/test_functions.py",
    ),
    "terminal_set/checker/search.py": (
        "tests/terminal_set/checker/test_boxes.py",
        "tests/terminal_set/checker/test_ellipsoid_search.py",
        "tests/terminal_set/checker/lower_bound/test_least.py",
    ),
    "terminal_set/checker/lower_bound/*.py": (
        "tests/terminal_set/checker/lower_bound/test_faces.py",
        "tests/terminal_set/checker/lower_bound/test_tasks.py",
        "tests/terminal_set/checker/lower_bound/test_tube.py",
        "tests/ocp/lower_bound/test_check.py",
    ),
    "terminal_set/checker/motion.py": ("tests/terminal_set/checker/test_drift.py",),
    "terminal_set/checker/swarm/*": (
        "tests/terminal_set/checker/swarm/test_statements.py",
    ),
}
"""Pattern of files -> further tests, run after those of the same name."""
LIMIT_GB = 8
_LIMITED = (
    "import resource, sys, pytest; "
    f"resource.setrlimit(resource.RLIMIT_DATA, 2 * ({LIMIT_GB} * 10**9,)); "
    "sys.exit(pytest.main())"
)
NO_TESTS = 5
"""Exit status of pytest if there is no test to run."""
PATIENCE = 4.0
"""Multiple of the time without a fault after which tests count as endless."""
HARMLESS_FILE = ROOT / "benchmarks" / "harmless_faults.yaml"
HARMLESS: tuple[tuple[str, str, str, str], ...] = tuple(
    (file, line, after, reason)
    for reason, files in yaml.safe_load(HARMLESS_FILE.read_text("utf-8")).items()
    for file, lines in files.items()
    for line, faulty in lines.items()
    for after in faulty
)
"""File, line, line with the fault or "*" for any, and why it does no harm."""


class Outcome(Enum):
    """Fate of a fault."""

    CAUGHT = "caught"
    ENDLESS = "caught by time"
    SURVIVED = "SURVIVED"
    HARMLESS = "harmless"


class Drawn(NamedTuple):
    """A fault and its place.

    Attributes:
        file: Path of its file in the tree.
        fault: The fault.
        line: Number of its line, from 1.
        before: The line without it, stripped.
        after: The line with it, stripped.
    """

    file: str
    fault: Fault
    line: int
    before: str
    after: str

    def __str__(self) -> str:
        """Return the place, the line, and the line with the fault."""
        return f"{self.file}:{self.line}\n    - {self.before}\n    + {self.after}"


def soundness_files(root: Path, patterns: Sequence[str] = ("*",)) -> list[str]:
    """Return the files that faults are drawn from, sorted.

    Args:
        root: Root of the tree.
        patterns: Only files that match any of these patterns.
    """
    found = {
        path.relative_to(root).as_posix()
        for group in FILES.values()
        for pattern in group
        for path in root.glob(pattern)
    }
    return sorted(f for f in found if any(fnmatch(f, p) for p in patterns))


def all_faults(root: Path, files: Iterable[str]) -> list[tuple[Drawn, ...]]:
    """Return the faults of files, place by place."""
    places = []
    for file in files:
        source = (root / file).read_text(encoding="utf-8")
        lines = source.splitlines()
        for place in faults(source):
            number = line_of(source, place[0])
            places.append(
                tuple(
                    Drawn(
                        file,
                        fault,
                        number,
                        lines[number - 1].strip(),
                        applied(source, fault).splitlines()[number - 1].strip(),
                    )
                    for fault in place
                )
            )
    return places


def drawn(
    places: Sequence[tuple[Drawn, ...]], count: int, rng: np.random.Generator
) -> list[Drawn]:
    """Return faults of different places, each place as likely as any other.

    Args:
        places: The faults of each place.
        count: Number of faults; all places if there are fewer.
        rng: Source of all randomness.
    """
    chosen = rng.permutation(len(places))[:count]
    return [places[k][int(rng.integers(len(places[k])))] for k in chosen]


def tests_of(root: Path, file: str) -> list[str]:
    """Return the test files of a file: the one that mirrors it, and those listed.

    Args:
        root: Root of the tree.
        file: Path of the file in the tree.

    Raises:
        FileNotFoundError: If it has no test file.
    """
    path = Path("tests") / Path(file).with_name(f"test_{Path(file).name}")
    names = [path.as_posix()]
    for pattern, tests in MORE_TESTS.items():
        names += tests if fnmatch(file, pattern) else ()
    found = [name for name in names if (root / name).exists()]
    if not found:
        raise FileNotFoundError(f"expected tests of {file} in {names}, found none")
    return found


def copied(root: Path, into: Path) -> Path:
    """Copy the tree as git sees it, changes that are not committed included.

    Args:
        root: Root of the tree.
        into: An empty folder.

    Returns:
        The folder.
    """
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root, check=True, capture_output=True,
    )  # fmt: skip
    for name in filter(None, listed.stdout.decode().split("\0")):
        source, target = root / name, into / name
        if source.exists() or source.is_symlink():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target, follow_symlinks=False)
    return into


def outcome_of(
    copy: Path, file: str, faulty: str, tests: Sequence[str], limit_s: float
) -> Outcome:
    """Run tests on a copy whose file has another text; then put the old text back.

    Args:
        copy: Root of a copy of the tree.
        file: Path of the file in the tree.
        faulty: Its text with a fault.
        tests: Paths of test files in the tree.
        limit_s: After this time they count as endless [s].
    """
    path = copy / file
    original = path.read_text(encoding="utf-8")
    path.write_text(faulty, encoding="utf-8")
    try:
        code = _tested(copy, tests, limit_s)
    finally:
        path.write_text(original, encoding="utf-8")
    if code is None:
        return Outcome.ENDLESS
    return Outcome.SURVIVED if code == 0 else Outcome.CAUGHT


def _tested(copy: Path, tests: Sequence[str], limit_s: float) -> int | None:
    """Return the exit status of tests run in a copy; None if they did not end.

    Tests that take long are run only if the others pass.
    """
    code: int | None = NO_TESTS
    for mark in ("not long", "long"):
        found = _marked(copy, tests, mark, limit_s)
        code = code if found == NO_TESTS else found
        if code not in (0, NO_TESTS):
            break
    return code


def _marked(copy: Path, tests: Sequence[str], mark: str, limit_s: float) -> int | None:
    """Return the exit status of tests with a mark; None if they did not end."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(copy / ".dev"),
        # A fault may leave size and time of a file as they were.
        "PYTHONDONTWRITEBYTECODE": "1",
        "XDG_CACHE_HOME": str(copy.parent / f"{copy.name}-cache"),
    }
    # The options stand in sys.argv, behind the "-c" that pytest.main skips.
    options = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", mark)
    process = subprocess.Popen(
        [sys.executable, "-c", _LIMITED, *options, *tests],
        cwd=copy, env=environment, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        return process.wait(limit_s)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def limits(copy: Path, files: Iterable[str]) -> dict[str, float]:
    """Return how long the tests of each file may take [s]: they pass without a fault.

    Raises:
        RuntimeError: If they fail though there is no fault.
    """
    allowed = {}
    for file in files:
        begin = time.perf_counter()
        if _tested(copy, tests_of(copy, file), 3600.0) != 0:
            raise RuntimeError(
                f"expected {tests_of(copy, file)} to pass without a fault; they fail"
            )
        allowed[file] = max(60.0, PATIENCE * (time.perf_counter() - begin))
    return allowed


def judged(root: Path, chosen: Sequence[Drawn], jobs: int) -> list[Outcome]:
    """Return the outcome of each fault, and print it.

    Args:
        root: Root of the tree.
        chosen: The faults.
        jobs: Number of faults tried at a time, each in its own copy.
    """
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        copies: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for k in range(jobs):
            copies.put(copied(root, Path(folder) / f"copy{k}"))
        first = copies.get()
        allowed = limits(first, sorted({d.file for d in chosen if not reason_of(d)}))
        copies.put(first)

        def judge(one: Drawn) -> Outcome:
            found = Outcome.HARMLESS
            if not reason_of(one):
                copy = copies.get()
                text = applied((copy / one.file).read_text(encoding="utf-8"), one.fault)
                tests = tests_of(copy, one.file)
                found = outcome_of(copy, one.file, text, tests, allowed[one.file])
                copies.put(copy)
            print(f"{found.value:14} {one.fault.kind:10} {one}", flush=True)
            return found

        with ThreadPoolExecutor(jobs) as pool:
            return [*pool.map(judge, chosen)]


def reason_of(one: Drawn) -> str:
    """Return why a fault does no harm; empty if it would."""
    for file, before, after, reason in HARMLESS:
        if one.file == file and one.before == before and after in ("*", one.after):
            return reason
    return ""


def report(chosen: Sequence[Drawn], found: Sequence[Outcome]) -> str:
    """Return a table by kind, the harmless ones with reasons, and the share caught."""
    lines = ["", row("kind", "faults", "caught", "survived"), row(*4 * ("---",))]
    caught = (Outcome.CAUGHT, Outcome.ENDLESS)
    kinds = sorted({one.fault.kind for one in chosen})
    for kind in (*kinds, "all"):
        of_kind = Counter(
            o
            for d, o in zip(chosen, found, strict=True)
            if kind in (d.fault.kind, "all")
        )
        good, bad = sum(of_kind[o] for o in caught), of_kind[Outcome.SURVIVED]
        lines.append(row(kind, str(good + bad), str(good), str(bad)))
    for one, outcome in zip(chosen, found, strict=True):
        if outcome is Outcome.HARMLESS:
            lines.append(f"harmless: {reason_of(one)}: {one}")
    if good + bad:
        low, high = binomtest(good, good + bad).proportion_ci(method="wilson")
        lines.append(
            f"caught {good} of {good + bad}, {good / (good + bad):.1%} "
            f"(Wilson, 95 %: {low:.1%} to {high:.1%}); "
            f"{of_kind[Outcome.ENDLESS]} of them by time"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw faults, try them, and print the table; 1 if any survived."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=16)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--file", action="append", metavar="PATTERN", default=[])
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="only list the faults")
    asked = parser.parse_args(arguments)
    places = all_faults(ROOT, soundness_files(ROOT, asked.file or ["*"]))
    chosen = drawn(places, asked.count, np.random.default_rng(asked.seed))
    print(f"{len(chosen)} faults of {len(places)} places, seed {asked.seed}")
    if asked.list:
        print(*chosen, sep="\n")
        return 0
    # By file, so that its machine code is still warm.
    chosen.sort()
    found = judged(ROOT, chosen, asked.jobs)
    print(report(chosen, found))
    return int(Outcome.SURVIVED in found)


if __name__ == "__main__":
    sys.exit(main())
