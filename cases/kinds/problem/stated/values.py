"""Values in the scenario of a problem: expressions, numbers, tables, decided numbers.

Expressions use the file's own names; numbers can be expressions in its constants.
"""

from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    model_validator,
)

from swarmstart.cases.format.expressions import parse
from swarmstart.cases.format.settings import LARGEST, Number, Part, Positive

Names = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$")]


def _text(value: object) -> object:
    """Return an expression in constants as text; numbers are converted, too."""
    value = _written(value)
    if isinstance(value, str):
        parse(value)
    return value


def _text_with_tables(value: object) -> object:
    """Return an expression as text; the tables are not known yet."""
    value = _written(value)
    if isinstance(value, str):
        parse(value, functions=None)
    return value


def _written(value: object) -> object:
    """Return a number as text, anything else as it is."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return repr(value) if abs(value) <= LARGEST else value
    return value


def _text_of_paths(value: object) -> object:
    """Return the expression of a measure as text."""
    if isinstance(value, str):
        parse(value, of_paths=True, functions=None)
    return value


def _schema(what: str) -> WithJsonSchema:
    return WithJsonSchema({"type": ["number", "string"], "description": what})


Expression = Annotated[
    str,
    BeforeValidator(_text_with_tables),
    _schema("An expression in the names of this file."),
]
Quantity = Annotated[
    str, BeforeValidator(_text), _schema("A number, or an expression in constants.")
]
Measured = Annotated[str, BeforeValidator(_text_of_paths)]


class Table(Part):
    """Values at times, held before the first and after the last.

    Attributes:
        times: Increasing times [s].
        values: Values, one at each time.
        between: Values between two times: linear changes evenly, hold keeps the earlier
            one.
    """

    times: list[Number] = Field(min_length=1, max_length=10_000)
    values: list[Number] = Field(min_length=1, max_length=10_000)
    between: Literal["linear", "hold"] = "linear"

    @model_validator(mode="after")
    def _fits(self) -> "Table":
        if len(self.times) != len(self.values):
            raise ValueError(
                f"expected as many values as times; found {len(self.values)} values "
                f"and {len(self.times)} times"
            )
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("expected times that increase")
        return self


def chosen(key: str, otherwise: str) -> Discriminator:
    """Return the choice of a form by its key, so that errors concern one form only."""

    def tag(value: Any) -> str:
        has = key in value if isinstance(value, dict) else hasattr(value, key)
        is_part = isinstance(value, dict | Part)
        found = key if has else otherwise if is_part else "text"
        return f"of {found}"  # Not equal to a key: keys are places of errors.

    return Discriminator(tag)


OverTime = Annotated[
    Annotated[Table, Tag("of table")] | Annotated[Expression, Tag("of text")],
    chosen("table", "table"),
]
"""A table, or an expression in constants and time."""
Limits = Annotated[list[Quantity | None], Field(min_length=2, max_length=2)]
"""[lower, upper]; null means no limit."""
MovingLimits = Annotated[list[Expression | None], Field(min_length=2, max_length=2)]
"""The same; a limit can be an expression of parameters, signals and time."""


class Decided(Part):
    """A number that the plan decides, within bounds.

    Attributes:
        free: Bounds [lower, upper] of the number; null, without a search only, means no
            limit.
        guess: Value at which a polish without a search starts; null means the middle of
            the bounds.
    """

    free: Limits
    guess: Quantity | None = None


class Tied(Part):
    """A start that is decided together with that of another state, whose value it has.

    Attributes:
        same_as: Name of the state whose decided start this state shares.
    """

    same_as: Names


def _decided_or(otherwise: str, *, or_tied: bool = False) -> Discriminator:
    """Return the choice between a decided number and another form."""

    def tag(value: Any) -> str:
        is_mapping = isinstance(value, dict) and "same_as" in value
        if or_tied and (isinstance(value, Tied) or is_mapping):
            return "is tied"
        if isinstance(value, Decided) or (isinstance(value, dict) and "free" in value):
            return "is decided"
        if otherwise == "over time" and isinstance(value, dict | Table):
            return "table"
        return otherwise

    return Discriminator(tag)


Start = Annotated[
    Annotated[Decided, Tag("is decided")]
    | Annotated[Tied, Tag("is tied")]
    | Annotated[Quantity, Tag("number")],
    _decided_or("number", or_tied=True),
]
"""Start of a state: a number, decided, or decided with another one."""
Parameter = Annotated[
    Annotated[Decided, Tag("is decided")]
    | Annotated[Table, Tag("table")]
    | Annotated[Expression, Tag("over time")],
    _decided_or("over time"),
]
"""A table or an expression as OverTime, or a decided number."""
Horizon = Annotated[
    Annotated[Decided, Tag("is decided")] | Annotated[Positive, Tag("number")],
    _decided_or("number"),
]
"""A length [s], or decided."""
