"""Best known values of the hard problems, and the grounds for each value.

The values are in `best_known.json`, to which anyone can contribute: a better value
needs a trajectory that `swarmstart judge` accepts.
"""

from __future__ import annotations

import importlib.resources
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from swarmstart.cases.format.document import meant, shown
from swarmstart.cases.format.flaws import InvalidScenarioError, checked, flaw_at
from swarmstart.cases.format.parts import DIALECT, Part, draft7
from swarmstart.cases.format.scenario import hard_problems
from swarmstart.cases.format.yaml_reader import read_yaml

FILE = Path(str(importlib.resources.files("swarmstart.cases"))) / (
    "hard/best_known.json"
)
"""The file that comes with the package."""
KnownBy = Literal["exact", "bound", "runs", "unknown"]


class BestKnown(Part):
    """The best known value of a problem.

    Attributes:
        cost: Cost of the best known trajectory, in the sense of the problem's file;
            null if none is known.
        known_by: Grounds for the value: exact, from an independent exact method; bound,
            within a proven gap; runs, from runs of solvers that found nothing better;
            unknown, the problem is open.
        gap: Proven relative gap of a bound.
        runs: Number of runs with distinct seeds.
        agreeing: Number of these runs whose cost is within 0.1 % of the value.
        methods: Methods that found the value or prove it.
        date: Day on which it was found, as 2026-01-31.
        version: Version of the program that judged it.
    """

    cost: float | None = None
    known_by: KnownBy
    gap: float | None = Field(default=None, ge=0)
    runs: int | None = Field(default=None, ge=1)
    agreeing: int | None = Field(default=None, ge=0)
    methods: list[str] = Field(default_factory=list)
    date: str = Field(default="", pattern=r"^(\d{4}-\d\d-\d\d)?$")
    version: str = ""

    @model_validator(mode="after")
    def _is_complete(self) -> BestKnown:
        needed = {
            "exact": ("cost", "methods"),
            "bound": ("cost", "gap", "methods"),
            "runs": ("cost", "runs", "agreeing", "methods"),
            "unknown": (),
        }[self.known_by]
        missing = [name for name in needed if getattr(self, name) in (None, [])]
        if missing:
            raise ValueError(
                f"expected {', '.join(needed)} with known_by: {self.known_by}; "
                f"found no {' and no '.join(missing)}"
            )
        if self.known_by == "unknown" and self.cost is not None:
            raise ValueError("expected no cost with known_by: unknown; found one")
        return self


class BestKnownFile(Part):
    """Best known values of the hard problems.

    Attributes:
        schema_version: Version of this format.
        problems: Best known values by the names of the problems, such as hard/walls_4.
    """

    schema_version: Literal[1] = Field(alias="schema")
    problems: Mapping[str, BestKnown]


def best_known(path: Path = FILE) -> Mapping[str, BestKnown]:
    """Return the best known values by the names of problems.

    Args:
        path: A file of this format; the one of the package by default.

    Raises:
        UnreadableFileError: If the file cannot be read.
        YamlError: If it is no JSON or YAML.
        InvalidScenarioError: If a value is invalid, with line and column of each.
    """
    document = read_yaml(path)
    found = checked(document, BestKnownFile).problems
    known = hard_problems()
    flaws = []
    for name in found:
        if name not in known:
            hint = meant(name, known, otherwise="swarmstart list scenarios --hard")
            what = f"expected a hard problem, found {shown(name)}; {hint}"
            flaws.append(flaw_at(document, ("problems", name), what, of_key=True))
    if flaws:
        raise InvalidScenarioError(flaws)
    return found


def best_known_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 7) of a file of best known values."""
    schema: dict[str, Any] = draft7(BestKnownFile.model_json_schema(by_alias=True))
    return {
        "$schema": DIALECT,
        **schema,
        "title": "swarmstart best known values of hard problems",
    }
