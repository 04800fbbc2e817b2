"""Faults of one token each, found in the syntax tree of a module.

    sign        + and -, * and / exchanged; a minus in front dropped
    comparison  turned round (< and >=, == and !=, is, in, and, or; `not` dropped), or
                its edge moved (< and <=)
    constant    twice or half; 0 and 1 exchanged
    extreme     min and max, any and all, fmin and fmax, argmin and argmax exchanged

Text is not changed: strings, raised errors, `__repr__`; nor are annotations, imports
and the numbers of type parameters.
"""

import ast
import re
from typing import NamedTuple

_SIGNS = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", (">=", "<=")),
    ast.LtE: ("<=", (">", "<")),
    ast.Gt: (">", ("<=", ">=")),
    ast.GtE: (">=", ("<", ">")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
_PAIRS = (
    ("min", "max"),
    ("fmin", "fmax"),
    ("minimum", "maximum"),
    ("argmin", "argmax"),
    ("any", "all"),
)
_EXTREMES = dict(_PAIRS) | {b: a for a, b in _PAIRS}
_TEXT = (ast.JoinedStr, ast.Raise, ast.Import, ast.ImportFrom)


class Fault(NamedTuple):
    """A piece of a module's text and its replacement.

    Attributes:
        start: First byte that is replaced.
        end: First byte after it.
        instead: New text.
        kind: "sign", "comparison", "constant" or "extreme".
    """

    start: int
    end: int
    instead: str
    kind: str


def faults(source: str) -> list[tuple[Fault, ...]]:
    """Return the faults of a module: at each place one or two, in the text's order.

    Args:
        source: Text of the module.
    """
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(finder.found)


def applied(source: str, fault: Fault) -> str:
    """Return a module's text with a fault.

    Args:
        source: Text of the module.
        fault: One of its faults.
    """
    text = source.encode()
    return (text[: fault.start] + fault.instead.encode() + text[fault.end :]).decode()


def line_of(source: str, fault: Fault) -> int:
    """Return the number of the line where a fault begins, counted from 1."""
    return source.encode().count(b"\n", 0, fault.start) + 1


class _Finder(ast.NodeVisitor):
    """Visitor of all computations, which collects the faults of each place."""

    def __init__(self, source: str) -> None:
        self.found: list[tuple[Fault, ...]] = []
        self._text = source.encode()
        lengths = [len(line) for line in self._text.splitlines(keepends=True)]
        self._lines = [sum(lengths[:k]) for k in range(len(lengths) + 1)]

    def visit(self, node: ast.AST) -> None:
        """Visit a node unless it is text."""
        if not isinstance(node, _TEXT):
            super().visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Visit defaults and body, but no annotation, and not `__repr__`."""
        if node.name == "__repr__":
            return
        for part in (*node.decorator_list, *node.args.defaults, *node.body):
            self.visit(part)
        for default in node.args.kw_defaults:
            if default is not None:
                self.visit(default)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Visit the value alone."""
        if node.value is not None:
            self.visit(node.value)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Exchange + and -, * and /, unless text or a list is put together."""
        pair = _SIGNS.get(type(node.op))
        if pair and not any(map(_is_sequence, (node.left, node.right))):
            self._between(node.left, node.right, pair[0], pair[1:], "sign")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """Exchange += and -=, *= and /=."""
        pair = _SIGNS.get(type(node.op))
        if pair and not _is_sequence(node.value):
            self._between(node.target, node.value, pair[0], pair[1:], "sign")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """Drop a minus or a `not`."""
        kind = {ast.USub: "sign", ast.Not: "comparison"}.get(type(node.op))
        if kind:
            start, end = self._start(node), self._start(node.operand)
            word = re.match(rb"-|not\b", self._text[start:end])
            if word:
                self.found.append((Fault(start, start + word.end(), "", kind),))
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        """Turn each comparison round, or move its edge."""
        sides = (node.left, *node.comparators)
        for op, left, right in zip(node.ops, sides, sides[1:], strict=False):
            sign, instead = _COMPARISONS[type(op)]
            self._between(left, right, sign, instead, "comparison")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """Exchange `and` and `or`."""
        words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._between(left, right, words[0], words[1:], "comparison")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Double or halve a number; exchange 0 and 1."""
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            return
        start, end = self._start(node), self._end(node)
        new = [0 * value, 2 * value] if value == 1 else [2 * value, _half(value)]
        if value == 0:
            new = [value + 1]
        self.found.append(
            tuple(Fault(start, end, repr(other), "constant") for other in new)
        )

    def visit_Name(self, node: ast.Name) -> None:
        """Exchange min and max, any and all."""
        self._extreme(node, node.id)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """Exchange them as attributes too."""
        self._extreme(node, node.attr)
        self.generic_visit(node)

    def _extreme(self, node: ast.expr, name: str) -> None:
        if name in _EXTREMES:
            end = self._end(node)
            fault = Fault(end - len(name), end, _EXTREMES[name], "extreme")
            self.found.append((fault,))

    def _between(
        self,
        left: ast.expr,
        right: ast.expr,
        old: str,
        new: tuple[str, ...],
        kind: str,
    ) -> None:
        """Replace the operator that stands between two operands."""
        start, end = self._end(left), self._start(right)
        gap = re.sub(rb"#[^\n]*", lambda m: b" " * len(m[0]), self._text[start:end])
        pattern = re.escape(old.encode()).replace(rb"\ ", rb"\s+")
        word = re.search(rb"(?<!\w)" + pattern, gap)
        if word is None:
            raise ValueError(f"expected {old!r} between operands, found {gap!r}")
        at = (start + word.start(), start + word.end())
        self.found.append(tuple(Fault(*at, other, kind) for other in new))

    def _start(self, node: ast.expr) -> int:
        return self._lines[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.expr) -> int:
        last, offset = node.end_lineno, node.end_col_offset
        return self._lines[(last or node.lineno) - 1] + (offset or node.col_offset)


def _half(value: float) -> float:
    return value // 2 if isinstance(value, int) else value / 2


def _is_sequence(node: ast.expr) -> bool:
    """Return whether an operand is text or a list as it stands, so that + joins."""
    joined = (ast.JoinedStr, ast.List, ast.ListComp, ast.Tuple, ast.Dict)
    return isinstance(node, joined) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
