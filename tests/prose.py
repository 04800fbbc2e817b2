"""Rules of plain English for docstrings, comments, messages and pages, as patterns.

    python tests/prose.py [FOLDER ...]

prints every place that breaks one. `tests/test_prose.py` runs them over the whole
project. A rule has a name, a pattern, what to write instead, and the texts it is for.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
ROOMS = (
    *(
        "machine_code",
        "ocp",
        "heuristics",
        "terminal_set",
        "export",
        "simulators",
        "cases",
        "benchmarks",
    ),
    "tests",
)
AIRCRAFT = re.compile(
    r"formation|wingman|reconfiguration|transfer|swap|drone|planar|vortex|chapter"
    r"|assignment|climb|markov|errata|rocket|uav|shuttle|claims|bars|flight",
    re.IGNORECASE,
)
"""Files that are about aircraft: here things fly."""


class Place(NamedTuple):
    """A text and where it stands.

    Attributes:
        file: Path in the tree.
        line: Number of its first line, from 1.
        sort: "docstring", "comment", "string" or "page".
        text: The text.
    """

    file: str
    line: int
    sort: str
    text: str


class Rule(NamedTuple):
    """A forbidden turn.

    Attributes:
        name: Short name.
        pattern: What is found.
        instead: What to write.
        sorts: Sorts of text it is for.
    """

    name: str
    pattern: re.Pattern[str]
    instead: str
    sorts: frozenset[str]


PROSE = frozenset({"docstring", "comment", "page", "string"})
DOCSTRINGS = frozenset({"docstring"})


def _rule(name: str, pattern: str, instead: str, sorts: frozenset[str] = PROSE) -> Rule:
    return Rule(name, re.compile(pattern, re.IGNORECASE), instead, sorts)


RULES = (
    _rule(
        "clause",
        r"\A\s*(what|which|where|how|whether|when|who|whose|why|that|as|if|those)\b",
        'a first line led by a verb or a noun: "Return ...", "Options of ..."',
        DOCSTRINGS,
    ),
    _rule(
        "none",
        r"(?<!there )\b(is|are|was|were|be|being) (?-i:none)\b"
        r"(?! of| at| within| in | to )",
        '"invalid" or "missing", or the condition itself',
    ),
    _rule(
        "nobody",
        r"\b(nobody|anybody|whoever|whomever|somebody|everybody)\b",
        "the subject: the user, the caller, another process",
    ),
    _rule(
        "where",
        r"\bwhere (nobody|nothing|none|no|it|they|this|that|there|one|some|any)\b",
        '"if" for a condition',
    ),
    _rule(
        "raises",
        r"Error: (where|what|which|when)\b",
        '"Error: If ..."',
        DOCSTRINGS,
    ),
    _rule("dear", r"\b(dearer|dearest|dear)\b", '"costlier", "more expensive"'),
    _rule(
        "told",
        r"\b(unless|if|where) (it is |they are )?told\b|\bis told\b|\bnobody says\b",
        '"given", "by default"',
    ),
    _rule("wanted", r"\bwants nothing\b|\basks nothing of\b", "name what is needed"),
)
FLY = _rule(
    "fly",
    r"(?<!ss\.)(?<!`)\b(fly|flies|flew|flown|flying)\b",
    '"simulate", "run" or "solve"; aircraft fly',
)


def places(folders: tuple[str, ...]) -> Iterator[Place]:
    """Yield every text of these folders of the tree, and of the files at its top."""
    for folder in folders:
        start = ROOT / folder
        files = [start] if start.is_file() else sorted(start.rglob("*"))
        for path in files:
            if "__pycache__" in path.parts or not path.is_file():
                continue
            name = path.relative_to(ROOT).as_posix()
            if path.suffix == ".py":
                yield from _of_code(name, path)
            elif path.suffix == ".md":
                yield from _of_page(name, path)


def _of_code(name: str, path: Path) -> Iterator[Place]:
    source = path.read_text(encoding="utf-8")
    alone = set[int]()
    for node in ast.walk(ast.parse(source)):  # A node comes before its parts.
        if isinstance(node, ast.Expr):
            alone.add(id(node.value))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) in alone:
                yield Place(name, node.lineno, "docstring", node.value)
            elif " " in node.value:
                yield Place(name, node.lineno, "string", node.value)
    yield from _comments(name, source)


def _comments(name: str, source: str) -> Iterator[Place]:
    comments = "\n".join(line for line in source.splitlines() if "#" in line)
    if not any(rule.pattern.search(comments) for rule in (*RULES, FLY)):
        return  # To split a file into tokens takes long.
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield Place(name, token.start[0], "comment", token.string)


def _of_page(name: str, path: Path) -> Iterator[Place]:
    fenced = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced and not line.startswith("    "):
            yield Place(name, number, "page", line)


def found(folders: tuple[str, ...]) -> Iterator[tuple[Place, Rule, str]]:
    """Yield each place that breaks a rule, the rule, and the words.

    Args:
        folders: Of the tree, or files.
    """
    for place in places(folders):
        for rule in (*RULES, *(() if AIRCRAFT.search(place.file) else (FLY,))):
            if place.sort in rule.sorts:
                for match in rule.pattern.finditer(place.text):
                    yield place, rule, match[0]


def main() -> int:
    """Print every place, a line each; return 1 if there is one."""
    count = 0
    for place, rule, words in found(tuple(sys.argv[1:]) or ROOMS):
        line = place.line + place.text.count("\n", 0, place.text.find(words))
        sys.stdout.write(
            f"{place.file}:{line}: {rule.name}: {words.strip()!r} -> {rule.instead}\n"
        )
        count += 1
    sys.stdout.write(f"{count} places\n")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
