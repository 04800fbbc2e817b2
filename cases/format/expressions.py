"""Numbers written as expressions, such as `pi/18`: parsed, never run by Python.

    text -> tokens -> ast of Python -> tree of Number, Name, Operation -> interpret

The tree contains no arithmetic: `interpret` walks it with a table of operations, on
floats here (`FLOAT_OPERATIONS`), on symbols elsewhere. Allowed: decimal numbers, names,
pi, + - * / **, parentheses and `FUNCTIONS`; an exponent without names is at most
`MAX_EXPONENT` in magnitude. Everything else Python's grammar knows is refused, from
attributes to 1_000, 0x10, 1j and line breaks.

Measures of a path can also use `x.start`, `x.end` and `REDUCTIONS`.
"""

import ast
import difflib
import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NoReturn, TypeAlias, TypeVar

from swarmstart.errors import SwarmstartError

T = TypeVar("T")

MAX_CHARACTERS = 500
MAX_NODES = 200
MAX_DEPTH = 100
MAX_EXPONENT = 8
MAX_SHOWN = 60  # characters of an expression in a message
MAX_NAMES = 20  # known names in a message

CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": math.pi})
FUNCTIONS: Mapping[str, int] = MappingProxyType(  # number of arguments
    {
        "sqrt": 1,
        "sin": 1,
        "cos": 1,
        "tan": 1,
        "asin": 1,
        "acos": 1,
        "atan": 1,
        "sinh": 1,
        "cosh": 1,
        "tanh": 1,
        "exp": 1,
        "log": 1,
        "abs": 1,
        "radians": 1,
        "atan2": 2,
        "min": 2,  # or more, in pairs from the left
        "max": 2,  # or more
    }
)
REDUCTIONS: Mapping[str, int] = MappingProxyType(  # from a path to a number
    {"integral": 1, "mean": 1, "settling": 3, "overshoot": 2}
)
PREVIOUS = "previous"
"""Function of the name of a control: its value in the interval before."""
ENDS = ("start", "end")
"""Ends of a path, written after its name: `x.end`."""
FLOAT_OPERATIONS: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        **{name: getattr(math, name) for name in FUNCTIONS if hasattr(math, name)},
        "abs": abs,
        "min": min,
        "max": max,
        "neg": operator.neg,
        "+": operator.add,
        "-": operator.sub,
        "*": operator.mul,
        "/": operator.truediv,
        "**": math.pow,  # never complex, unlike Python's **
    }
)

_SYMBOLS: Mapping[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}
_TOKEN = re.compile(
    r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?(?![A-Za-z0-9_.])"
    r"|[A-Za-z_][A-Za-z0-9_]*|[-+*/(),]|[ \t]+"
)
_TOKEN_OF_PATHS = re.compile(_TOKEN.pattern + r"|\.(?:start|end)(?![A-Za-z0-9_])")
_ALLOWED = "numbers, names, pi, + - * / **, parentheses and " + ", ".join(FUNCTIONS)


def previous_of(control: str) -> str:
    """Return the name for the value of a control in the interval before."""
    return f"{PREVIOUS}({control})"


class ExpressionError(SwarmstartError, ValueError):
    """An expression that is refused, or has no finite real value.

    Attributes:
        what: Description of what was expected and what was found.
        expression: The text, in full.
        column: Column of the error in `expression`, from 1.
    """

    def __init__(self, what: str, expression: str, column: int) -> None:
        """Keep the parts."""
        super().__init__(what, expression, column)
        self.what = what
        self.expression = expression
        self.column = column

    def __str__(self) -> str:
        """Return the expression, escaped and shortened, the column and the error."""
        text = self.expression
        shown = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
        return f"expression {shown!a}, column {self.column}: {self.what}"


@dataclass(frozen=True, slots=True)
class Number:
    """A finite literal."""

    value: float


@dataclass(frozen=True, slots=True)
class Name:
    """A name to look up; column counts from 1."""

    name: str
    column: int


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation by its key in a table, such as "+", "neg" or "atan2"."""

    name: str
    arguments: "tuple[Tree, ...]"
    column: int


Tree: TypeAlias = Number | Name | Operation


@dataclass(frozen=True, slots=True)
class Expression:
    """A checked expression.

    Attributes:
        text: Text as written, for messages.
        tree: Operations of the expression, as nested objects.
    """

    text: str
    tree: Tree

    @property
    def names(self) -> frozenset[str]:
        """The names used, constants included."""
        return frozenset(name.name for name in self.name_places)

    @property
    def name_places(self) -> tuple[Name, ...]:
        """All uses of names, from left to right."""
        return tuple(_names(self.tree))


def evaluate(text: str, names: Mapping[str, float] = MappingProxyType({})) -> float:
    """Compute an expression in floats.

    Args:
        text: At most `MAX_CHARACTERS` long.
        names: The value of each further name that is allowed; a name that is also a
            constant, such as pi, has the value given here.

    Returns:
        A finite number.

    Raises:
        ExpressionError: If the text is no such expression, a name is unknown, or any
            step leaves the finite real numbers.
    """
    expression = parse(text)
    value = interpret(expression, operations=FLOAT_OPERATIONS, names=names)
    if not math.isfinite(value):
        raise ExpressionError("expected finite values of the names", text, 1)
    return value


NO_FUNCTIONS: Mapping[str, int] = MappingProxyType({})


def parse(
    text: str,
    *,
    of_paths: bool = False,
    functions: Mapping[str, int] | None = NO_FUNCTIONS,
) -> Expression:
    """Return a checked text as a tree; only exponents are computed.

    Args:
        text: At most `MAX_CHARACTERS` long.
        of_paths: Whether `REDUCTIONS`, `ENDS`, and min and max of one path are allowed.
        functions: More functions, name -> number of arguments; None allows any name as
            a function, for a first parse before the functions are known.

    Returns:
        The tree; its names are not looked up yet.

    Raises:
        ExpressionError: If it has a part that is not allowed.
    """
    if len(text) > MAX_CHARACTERS:
        what = f"expected at most {MAX_CHARACTERS} characters, found {len(text)}"
        raise ExpressionError(what, text, MAX_CHARACTERS + 1)
    body = text.strip(" \t\r\n")
    offset = text.find(body)
    token = _TOKEN_OF_PATHS if of_paths else _TOKEN
    _check_tokens(text, offset, offset + len(body), token)
    try:
        root = ast.parse(body, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column = getattr(error, "offset", 1) or len(body) + 1  # 0: at the end
        reason = getattr(error, "msg", None) or type(error).__name__
        reason = reason.partition(";")[0]  # what follows advises 0o, refused here
        what = f"expected a complete expression, found: {reason}"
        raise ExpressionError(what, text, min(offset + column, len(text) + 1)) from None
    count = sum(isinstance(node, ast.expr) for node in ast.walk(root))
    if count > MAX_NODES:
        what = f"expected at most {MAX_NODES} numbers, names and operations"
        raise ExpressionError(f"{what}, found {count}", text, 1)
    return Expression(text, _Converter(text, offset, of_paths, functions).tree(root, 0))


def interpret(
    expression: Expression,
    *,
    operations: Mapping[str, Callable[..., T]],
    names: Mapping[str, T],
) -> T | float:
    """Return the value of an expression in any arithmetic, floats or symbols.

    Args:
        expression: From `parse`.
        operations: One callable for each key of `FLOAT_OPERATIONS`, with as many
            arguments as the callable there; it must accept values of type T and floats,
            also mixed.
        names: The value of each name allowed besides the constants; a name that is also
            a constant, such as pi, has the value given here.

    Returns:
        The value; a float if no name of type T takes part.

    Raises:
        ExpressionError: If a name is unknown, or an operation on floats is undefined
            or overflows.
    """

    def value(tree: Tree) -> T | float:
        if isinstance(tree, Number):
            return tree.value
        if isinstance(tree, Name):
            if tree.name in names:
                return names[tree.name]
            if tree.name in CONSTANTS:
                return CONSTANTS[tree.name]
            known = sorted({*names, *CONSTANTS})
            what = f"unknown name {tree.name!r}{_suggested(tree.name, known)}"
            raise ExpressionError(what, expression.text, tree.column)
        arguments = [value(argument) for argument in tree.arguments]
        try:
            result: T | float = operations[tree.name](*arguments)
        except (ArithmeticError, ValueError):
            result = math.nan
        if isinstance(result, float) and not math.isfinite(result):
            shown = ", ".join(map(str, arguments))
            what = f"expected a finite real value, found {tree.name!r} of {shown}"
            raise ExpressionError(what, expression.text, tree.column)
        return result

    return value(expression.tree)


class _Converter:
    """Converter of Python's ast to a Tree; refuses all that is not listed here."""

    def __init__(
        self,
        text: str,
        offset: int,
        of_paths: bool,
        functions: Mapping[str, int] | None,
    ) -> None:
        self._text = text
        self._offset = offset  # of the ast's columns in the text
        self._of_paths = of_paths
        known = {**FUNCTIONS, **(REDUCTIONS if of_paths else {})}
        self._functions = {**known, **(functions or {})}
        self._any = functions is None

    def tree(self, node: ast.expr, depth: int) -> Tree:
        """Return the tree of one node and those below it."""
        if depth > MAX_DEPTH:
            self._refuse(node, f"expected at most {MAX_DEPTH} levels, found more")
        match node:
            case ast.Constant():
                return self._number(node)
            case ast.Name():
                return Name(node.id, self._column(node))
            case ast.UnaryOp(op=ast.UAdd() | ast.USub()):
                if isinstance(node.op, ast.UAdd):
                    return self.tree(node.operand, depth + 1)
                return self._operation("neg", [node.operand], node, depth)
            case ast.BinOp() if type(node.op) in _SYMBOLS:
                symbol = _SYMBOLS[type(node.op)]
                return self._operation(symbol, [node.left, node.right], node, depth)
            case ast.Call() | ast.Attribute():
                return self._call(node, depth)
        found = self._source(node)
        point = re.sub(r"(\d),(\d)", r"\1.\2", found)
        hint = f"write {point}" if point != found else f"allowed are {_ALLOWED}"
        self._refuse(node, f"found {found!r}; {hint}")

    def _number(self, node: ast.Constant) -> Number:
        if type(node.value) not in (int, float):
            self._refuse(node, f"found {node.value!r}; allowed are {_ALLOWED}")
        value = float(self._source(node))
        if not math.isfinite(value):
            self._refuse(node, "expected a finite number")
        return Number(value)

    def _operation(
        self, name: str, operands: list[ast.expr], node: ast.expr, depth: int
    ) -> Operation:
        column = self._column(node)
        arguments = [self.tree(operand, depth + 1) for operand in operands]
        if name == "**":
            arguments[1] = self._exponent(arguments[1], operands[1])
        together = 2 if name in ("min", "max") else len(arguments)
        result = Operation(name, tuple(arguments[:together]), column)
        for argument in arguments[together:]:
            result = Operation(name, (result, argument), column)
        return result

    def _exponent(self, tree: Tree, node: ast.expr) -> Tree:
        what = f"expected a constant from -{MAX_EXPONENT} to {MAX_EXPONENT} as exponent"
        if any(name.name not in CONSTANTS for name in _names(tree)):
            return tree
        expression = Expression(self._text, tree)
        value = interpret(expression, operations=FLOAT_OPERATIONS, names={})
        if abs(value) > MAX_EXPONENT:
            self._refuse(node, f"{what}, found {value}")
        return Number(value)

    def _call(self, node: ast.Call | ast.Attribute, depth: int) -> Operation | Name:
        if isinstance(node, ast.Attribute):
            if self._of_paths and node.attr in ENDS:
                return self._operation(node.attr, [node.value], node, depth)
            self._refuse(node, f"found {self._source(node)!r}; allowed are {_ALLOWED}")
        if not isinstance(node.func, ast.Name):
            self._refuse(node, f"found {self._source(node)!r}; allowed are {_ALLOWED}")
        name = node.func.id
        if name == PREVIOUS:
            return self._previous(node)
        if name not in self._functions and not self._any:
            known = [*self._functions, PREVIOUS]
            what = f"unknown function {name!r}{_suggested(name, known)}"
            self._refuse(node, what)
        given = len(node.args)
        wanted = self._functions.get(name, given)
        more = name in ("min", "max") and (
            given > wanted or (self._of_paths and given == 1)
        )
        starred = node.keywords or any(isinstance(a, ast.Starred) for a in node.args)
        if starred or (given != wanted and not more):
            what = f"expected {name} with {wanted} plain argument(s)"
            self._refuse(node, f"{what}, found {given + len(node.keywords)}")
        return self._operation(name, node.args, node, depth)

    def _previous(self, node: ast.Call) -> Name:
        """Return the name that stands for a control's value in the interval before."""
        match node:
            case ast.Call(args=[ast.Name(id=control)], keywords=[]):
                return Name(previous_of(control), self._column(node))
        self._refuse(node, f"expected {PREVIOUS} of the name of one control")

    def _column(self, node: ast.expr) -> int:
        return self._offset + node.col_offset + 1

    def _source(self, node: ast.expr) -> str:
        end = node.end_col_offset or node.col_offset
        return self._text[self._offset + node.col_offset : self._offset + end]

    def _refuse(self, node: ast.expr, what: str) -> NoReturn:
        raise ExpressionError(what, self._text, self._column(node))


def _check_tokens(text: str, start: int, end: int, allowed: re.Pattern[str]) -> None:
    """Refuse every character and number that no allowed expression can have."""
    while start < end:
        token = allowed.match(text, start, end)
        if token is None and text[start] == "^":
            raise ExpressionError("expected ** for a power, found '^'", text, start + 1)
        if token is None:
            found = ascii(text[start : min(end, start + 12)])
            what = f"expected an expression, found {found}; allowed are {_ALLOWED}"
            raise ExpressionError(what, text, start + 1)
        start = token.end()
    if not text.strip():
        raise ExpressionError("expected an expression, found nothing", text, 1)


def _names(tree: Tree) -> Iterable[Name]:
    if isinstance(tree, Name):
        yield tree
    elif isinstance(tree, Operation):
        for argument in tree.arguments:
            yield from _names(argument)


def _suggested(name: str, known: Collection[str]) -> str:
    """Return the most similar known name as a question, or else the first names."""
    if close := difflib.get_close_matches(name, known, n=1):
        return f": did you mean {close[0]!r}?"
    first = ", ".join(list(known)[:MAX_NAMES])
    return f"; known: {first}{', ...' if len(known) > MAX_NAMES else ''}"
