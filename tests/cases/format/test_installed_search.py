"""A search of another package: one module and one entry point."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import swarmstart
from swarmstart.tests.processes import announced, ended, installed_beside

ROOT = Path(swarmstart.__file__).parent
TINY = ["--set", "budget.evaluations=400", "--no-figures", "--polish", "none"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package `lottery` with a copy of random search, as installed."""
    root = tmp_path_factory.mktemp("installed")
    (root / "lottery").mkdir()
    (root / "lottery" / "__init__.py").touch()
    original = ROOT / "heuristics" / "searches" / "random_search.py"
    shutil.copy(original, root / "lottery" / "draws.py")
    announced(
        root,
        "lottery",
        "[swarmstart.searches]\n"
        "lottery = lottery.draws:RandomSearch\n"
        "lost = lottery.absent:Nothing\n"
        "odd = lottery.draws:propose\n"
        "cpso = lottery.draws:RandomSearch\n",
    )
    return root


def ran(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python, run in the folder with the package on the path."""
    return ended(*arguments, root=folder, variables=installed_beside(folder))


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A command, run in the folder with the package on the path."""
    return ran(folder, "-m", "swarmstart", *arguments)


def test_the_search_is_listed_and_replaces_none_of_the_library(folder: Path) -> None:
    listed = json.loads(command(folder, "list", "searches", "--json").stdout)
    titles = {name: entry["title"] for name, entry in listed["searches"].items()}
    assert titles["lottery"] == "a search of lottery.draws"
    assert titles["cpso"].startswith("chaotic particle swarm")


def test_a_scenario_is_searched_by_it(folder: Path) -> None:
    costs = []
    for name in ("lottery", "random"):
        one = command(
            folder, "run", "pendulum", "--search", name, "--out", f"of_{name}", *TINY,
            "--set", "search.size=40",
        )  # fmt: skip
        assert one.returncode in (0, 4), one.stderr
        record = json.loads((folder / f"of_{name}" / "run.json").read_text("utf-8"))
        costs.append(record["measures"]["cost"])
    assert costs[0] == costs[1]


def test_the_library_takes_its_name(folder: Path) -> None:
    program = (
        "import swarmstart as ss\n"
        "found = [ss.minimize(lambda x: (x**2).sum(axis=0), bounds=[(-1, 2)] * 2,\n"
        "    algorithm=a, budget=200, seed=0).cost for a in ('lottery', 'random')]\n"
        "assert found[0] == found[1], found\n"
    )
    done = ran(folder, "-c", program)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lost", "search lost: expected settings at lottery.absent:Nothing"),
        ("odd", "search odd: expected a dataclass at lottery.draws:propose"),
    ],
)
def test_a_search_that_is_none_stops_only_who_names_it(
    folder: Path, name: str, said: str
) -> None:
    done = command(folder, "run", "pendulum", "--search", name, "--out", "x", *TINY)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
