"""Parts of a scenario: numbers, mappings, ranges and grids, and their JSON Schema.

All parts are pydantic models, strict and frozen, and refuse unknown keys. A number can
be written as an expression, such as `pi/18`.

Editors read JSON Schema up to draft 7, and pydantic writes 2020-12: so the keys of
definitions are renamed. The key `variants`, which can override any part, is added.

The descriptions of keys are taken from the docstrings of their classes. A class says
under "Attributes:" what each of its keys means, once for readers of the code and of the
JSON Schema. An entry is a name, a colon and a sentence.
"""

import inspect
import re
from collections.abc import Sequence
from pkgutil import resolve_name
from typing import (
    Annotated,
    Any,
    Literal,
)

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    WithJsonSchema,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import (
    CONSTANTS,
    ExpressionError,
    evaluate,
)
from swarmstart.cases.format.registry import words_of
from swarmstart.heuristics import (
    Budget,
    Order,
    epsilon_level,
    feasibility_first,
    static_penalty,
)

DIALECT = "http://json-schema.org/draft-07/schema#"
LARGEST = 1e30
"""Largest magnitude of a number: its powers are still finite."""
_HEADING = "Attributes:"
_ENTRY = re.compile(r"    (\w+): (.*)")
_WITH_UNIT = re.compile(
    r"\s*(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)"
    r"\s*(?P<unit>[^\W\d_][\w/^*²³·-]*|[°%])\s*"
)


def _number(value: object) -> object:
    """Return the value of an expression; leave everything else to pydantic."""
    if not isinstance(value, str):
        return value
    try:
        return evaluate(value)
    except ExpressionError as error:
        unit = _WITH_UNIT.fullmatch(value)
        # 2pi lacks a "*", and has no unit.
        if unit is None or unit["unit"] in CONSTANTS:
            raise
        degrees = unit["number"] if unit["unit"].startswith(("deg", "°")) else "90"
        raise ExpressionError(
            f"expected a number without a unit; for degrees: radians({degrees})",
            value,
            unit.start("unit") + 1,
        ) from error


Number = Annotated[
    float,
    BeforeValidator(_number),
    Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST),
    WithJsonSchema(
        {"type": ["number", "string"], "description": "A number, or as in pi/18."}
    ),
]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Checks = Annotated[int, Field(ge=1, le=100)]


class Part(BaseModel):
    """A mapping of a scenario."""

    # Strict: text is no number, 1 is not true, and 2.0 is no integer.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe every key as the docstrings do, under "Attributes:"."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        if cls.__doc__:
            schema["description"] = summary_of(cls.__doc__)
        texts, keys = attributes_of(cls), schema.get("properties", {})
        for name, field in cls.model_fields.items():
            key = keys.get(field.alias or name)
            if key is not None and name in texts:
                key["description"] = field.description or texts[name]
        return schema


class Range(Part):
    """An interval, written as a list of two: [lower, upper].

    Attributes:
        lower: Lower limit, in the unit of the key.
        upper: Upper limit, in the unit of the key, above the lower one.
    """

    lower: Number
    upper: Number

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, value: object) -> object:
        if not isinstance(value, list) or len(value) != len(cls.model_fields):
            raise ValueError(
                f"expected a list of two numbers, [lower, upper]; found {value}"
            )
        return {"lower": value[0], "upper": value[1]}

    @model_serializer
    def _as_list(self) -> list[float]:
        return [self.lower, self.upper]

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe the form in which it is written: a list of two."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        entry = schema.get("properties", {}).get("lower", {"type": "number"})
        entry.pop("title", None)
        # pydantic describes the fields, but the file has a list.
        schema.clear()
        schema.update(
            type="array",
            items=entry,
            minItems=2,
            maxItems=2,
            description="An interval: [lower, upper].",
        )
        return schema

    @model_validator(mode="after")
    def _ordered(self) -> "Range":
        if not self.lower < self.upper:
            raise ValueError(
                f"expected lower < upper, found [{self.lower:g}, {self.upper:g}]"
            )
        return self


def bounds_of(ranges: Sequence[Range]) -> tuple[Array, Array]:
    """Return the lower and the upper limits of n ranges, each (n,)."""
    return np.array([r.lower for r in ranges]), np.array([r.upper for r in ranges])


class GridPart(Part):
    """Horizon of a plan and its grid; a kind can add `checks` and `integrator`.

    Attributes:
        horizon_s: Length of the horizon of a plan [s].
        intervals: Number of control intervals in the horizon.
        substeps: Number of integrator steps from one check of the constraints to the
            next.
    """

    horizon_s: Positive
    intervals: int = Field(default=1, ge=1, le=1000)
    substeps: int = Field(default=1, ge=1, le=100)

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.horizon_s / self.intervals

    def grid(self) -> dict[str, Any]:
        """Return the arguments of a planning problem for the grid."""
        keys = {"intervals", "substeps", "checks", "integrator"}
        return {"horizon": self.horizon_s, **self.model_dump(include=keys)}


class BudgetPart(Part):
    """Budget of the search for one planning problem; the first limit reached counts.

    Attributes:
        evaluations: Largest number of trajectories that a search evaluates; null means
            no limit.
        seconds: Wall time after which no generation is started [s]; null means no
            limit.
        target: Cost at which a search stops once a feasible point reaches it; null
            means that it does not stop early.
        stagnation: Number of generations (for multistart: batches) without a better
            point after which a search stops; null means never.
    """

    # As in heuristics.Budget.
    evaluations: int | None = Field(default=None, ge=1, lt=2**62)
    seconds: Positive | None = None
    target: Number | None = None
    stagnation: int | None = Field(default=None, ge=1, lt=2**62)

    @model_validator(mode="after")
    def _some(self) -> "BudgetPart":
        if self.evaluations is None and self.seconds is None:
            raise ValueError("expected evaluations, seconds or both; found neither")
        return self

    def budget(self) -> Budget:
        """Return the budget for the search."""
        return Budget(**self.model_dump())


class OrderPart(Part):
    """Order of individuals: how the search weighs cost against violation.

    Attributes:
        name: Rule for comparing two individuals: cost plus weighted violation, feasible
            ones first, or feasible ones first with a tolerance of violations that
            shrinks.
        weight: Factor of the constraint violation in the cost, used by static_penalty
            only.
    """

    name: Literal["static_penalty", "feasibility_first", "epsilon_level"]
    weight: Positive = 1e4

    def order(self) -> Order:
        """Return the order for the search."""
        if self.name == "static_penalty":
            return static_penalty(self.weight)
        if self.name == "epsilon_level":
            return epsilon_level()
        return feasibility_first()


def scenario_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 7) of one kind of scenario.

    Args:
        kind: A key of KINDS.
    """
    model = resolve_name(words_of(kind).kind).scenario
    schema: dict[str, Any] = draft7(model.model_json_schema(by_alias=True))
    variants = {
        "type": "object",
        "description": "Variants by name: overrides of keys, in which mappings merge "
        "and all else replaces.",
        "additionalProperties": {"type": "object"},
    }
    # A key may be given by the variant instead of the top level, so none is required.
    del schema["required"]
    return {
        "$schema": DIALECT,
        **schema,
        "title": f"swarmstart scenario, kind {kind}",
        "properties": {**schema["properties"], "variants": variants},
    }


def attributes_of(given: type) -> dict[str, str]:
    """Return the texts under "Attributes:" of a class and its bases, by name.

    The text of a class takes the place of that of its bases.
    """
    texts: dict[str, str] = {}
    # From the most general class on, so that the text of a subclass replaces it.
    for one in reversed(given.__mro__):
        texts |= _entries(inspect.cleandoc(one.__doc__ or ""))
    return texts


def summary_of(docstring: str) -> str:
    """Return the text of a docstring that comes before its sections."""
    return inspect.cleandoc(docstring).partition(f"\n\n{_HEADING}")[0]


def draft7(node: Any) -> Any:
    """Return a schema with the keywords of draft 7."""
    if isinstance(node, list):
        return [draft7(item) for item in node]
    if not isinstance(node, dict):
        return node
    renamed = {}
    for key, value in node.items():
        if key == "$ref":
            renamed[key] = value.replace("#/$defs/", "#/definitions/")
        elif key == "$defs":
            renamed["definitions"] = draft7(value)
        elif key != "discriminator":
            # A word of OpenAPI, which draft 7 does not have.
            renamed[key] = draft7(value)
    return renamed


def _entries(text: str) -> dict[str, str]:
    """Return the entries of the section "Attributes:" of a docstring, each in one line.

    A sentence begins with a capital letter, whatever name it begins with in the code.
    """
    lines = text.splitlines()
    if _HEADING not in lines:
        return {}
    entries: dict[str, list[str]] = {}
    name = ""
    for line in lines[lines.index(_HEADING) + 1 :]:
        if line and not line.startswith(" "):
            break
        found = _ENTRY.fullmatch(line)
        if found is not None:
            name = found[1]
            entries[name] = [found[2]]
        elif name and line:
            entries[name].append(line.strip())
    joined = {name: " ".join(parts) for name, parts in entries.items()}
    return {name: said[:1].upper() + said[1:] for name, said in joined.items()}
