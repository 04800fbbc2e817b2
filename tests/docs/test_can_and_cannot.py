"""The page that compares packages: what it names and links to exists, in each cell."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmstart.tests.docs.conftest import DOCS, ROOT

PAGE = DOCS / "can_and_cannot.md"
if not PAGE.exists():
    pytest.skip("the page is not beside an installed package", allow_module_level=True)
TEXT = PAGE.read_text(encoding="utf-8")
PACKAGES = {
    "do-mpc": ("https://www.do-mpc.com/", "https://github.com/do-mpc/do-mpc/"),
    "rockit": ("https://github.com/meco-group/rockit/",),
    "Dymos": (
        "https://openmdao.github.io/dymos/",
        "https://github.com/OpenMDAO/dymos/",
    ),
    "PSOPT": ("https://github.com/PSOPT/psopt/",),
    "acados": ("https://docs.acados.org/", "https://github.com/acados/acados/"),
    "CasADi": ("https://github.com/casadi/casadi/",),
    "pygmo": ("https://esa.github.io/pygmo2/", "https://github.com/esa/pygmo2/"),
    "InfiniteOpt": (
        "https://infiniteopt.github.io/InfiniteOpt.jl/",
        "https://github.com/infiniteopt/InfiniteOpt.jl/",
    ),
    "python-control": (
        "https://python-control.readthedocs.io/",
        "https://github.com/python-control/python-control/",
    ),
}
"""Package -> begins of the addresses of its own documentation, in the order of the
columns."""
MARKS = {"yes", "partly", "by hand", "no"}
ADDRESSES = dict(re.findall(r"^\[([\w-]+)\]: (\S+)$", TEXT, re.MULTILINE))
LINKED = re.compile(r"\[([^]]+)\]\[([\w-]+)\]")


def rows() -> list[list[str]]:
    """Return the cells of each row of the tables, heads and rules left out."""
    lines = [line for line in TEXT.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "feature" and set(row[0]) != {"-"}]


def own_links() -> Iterator[tuple[str, str]]:
    """Yield page and anchor of each link to this site; both may be empty."""
    for target in re.findall(r"\]\(([^)]+)\)", TEXT):
        page, _, anchor = target.partition("#")
        yield page, anchor


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings."""
    heads = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


def test_every_test_that_is_named_exists() -> None:
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TEXT)
    assert len(named) == TEXT.count("`tests/") > 20
    for file, name in named:
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        functions = {one.name for one in tree.body if isinstance(one, ast.FunctionDef)}
        assert name in functions, file


def test_every_link_to_this_site_has_its_page_and_heading() -> None:
    links = list(own_links())
    assert len(links) > 30
    for page, anchor in links:
        path = DOCS / page if page else PAGE
        assert path.is_file(), page
        assert not anchor or anchor in anchors(path), (page, anchor)


def test_every_table_has_a_column_for_each_package() -> None:
    head = "| feature | swarmstart | " + " | ".join(PACKAGES) + " |"
    heads = [line for line in TEXT.splitlines() if line.startswith("| feature")]
    assert heads == [head] * 4


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_every_cell_has_a_mark_and_its_evidence(row: list[str]) -> None:
    feature, ours, *others = row
    assert len(others) == len(PACKAGES)
    assert re.fullmatch(r"\[[^]]+\]\([^)]+\)", ours)
    for cell, (package, begins) in zip(others, PACKAGES.items(), strict=True):
        if cell == "not found":
            continue
        link = LINKED.fullmatch(cell)
        assert link, (package, cell)
        assert link[1] in MARKS or feature == "licence"
        assert ADDRESSES[link[2]].startswith(begins), package


def test_every_address_is_used() -> None:
    used = {reference for _, reference in LINKED.findall(TEXT)}
    assert used == set(ADDRESSES)
