"""Values of a tape as exact polynomials in the controls.

A value is a sum of terms c_p(t, x) p, each p a product of at most two controls; the
factors c_p are values of a new tape. Sums, products and divisions by values without
controls keep that form, so no derivative is needed to see that a problem is affine in
its controls. A control for which this fails, or whose square has a factor that is not a
number >= 0, is "boxed": it becomes a coordinate of the boxes of the search, as t and x
are. Constants are exact fractions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from swarmstart.terminal_set.checker.evaluation import Node, Program
from swarmstart.terminal_set.checker.file_content import Instruction
from swarmstart.terminal_set.checker.findings import NEVER, Deadline
from swarmstart.terminal_set.checker.lower_bound.certificate_file import Problem

Powers = tuple[int, ...]
Terms = dict[Powers, int]
"""Product of controls, as their indices in order -> index of its factor's value."""

_LONGEST_FRACTION = 4000  # bits; constants beyond are computed in models
_SECOND = 2


class _BoxedError(Exception):
    """A control must become a coordinate of the boxes."""

    def __init__(self, control: int) -> None:
        super().__init__()
        self.control = control


@dataclass(frozen=True, kw_only=True, slots=True)
class Split:
    """The rates f and the stage cost L of a problem as polynomials in the controls.

        f = drift + sum of columns[k] u_k,  L = stage + sum of linear[k] u_k + q_k u_k^2

    Attributes:
        nodes: The new tape.
        boxed: Indices of the controls that are coordinates of the boxes, as t and x
            are.
        free: Indices of the other controls, which are the u_k above.
        drift: Indices of the n values of the drift.
        columns: For each free control the indices of the n values of its column in f;
            None stands for 0.
        stage: Index of the value of the part of L without free controls.
        linear: For each free control the index of the value of its factor in L; None
            stands for 0.
        quadratic: q_k >= 0 for each free control.
        end: Index of the value of the terminal cost.
        path: Indices of the values of the path constraints.
        ends: Indices of the values of the end constraints.
        deadline: Time at which every evaluation of the tape stops.
    """

    nodes: tuple[Node, ...]
    boxed: tuple[int, ...]
    free: tuple[int, ...]
    drift: tuple[int, ...]
    columns: tuple[tuple[int | None, ...], ...]
    stage: int
    linear: tuple[int | None, ...]
    quadratic: tuple[Fraction, ...]
    end: int
    path: tuple[int, ...]
    ends: tuple[int, ...]
    deadline: Deadline = NEVER

    def program(self, wanted: Iterable[int]) -> Program:
        """Return the program of some values, which stops at the deadline."""
        return Program(self.nodes, wanted, self.deadline)


def split(problem: Problem, deadline: Deadline = NEVER) -> Split:
    """Write a problem as polynomials in the controls.

    A control for which this fails becomes a coordinate of the boxes (`Split.boxed`).

    Args:
        problem: Problem of the file; its end and constraints depend on no control.
        deadline: Time at which to stop, also within the tape.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    boxed: list[int] = []
    while True:
        try:
            # Each failure boxes one more control, so that this ends.
            return _Splitter(problem, boxed, deadline).split()
        except _BoxedError as error:
            boxed.append(error.control)


@dataclass(slots=True)
class _Writer:
    """Writer of values: equal ones once, and operations on constants done exactly."""

    nodes: list[Node] = field(default_factory=list)
    numbers: dict[Node, int] = field(default_factory=dict)

    def number(self, node: Node) -> int:
        if node not in self.numbers:
            self.numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return self.numbers[node]

    def constant(self, value: Fraction) -> int:
        return self.number(Node("const", (), value))

    def value(self, number: int) -> Fraction | None:
        node = self.nodes[number]
        return node.value if node.operation == "const" else None

    def apply(self, operation: str, *operands: int) -> int:
        values = [self.value(operand) for operand in operands]
        folded = _folded(operation, values)
        if folded is not None:
            return self.constant(folded)
        if operation == "mul" and 1 in values:
            return operands[1 - values.index(Fraction(1))]
        if operation in ("add", "sub") and values[1] == 0:
            return operands[0]
        if operation == "add" and values[0] == 0:
            return operands[1]
        return self.number(Node(operation, operands))


def _folded(operation: str, values: list[Fraction | None]) -> Fraction | None:
    """Return the exact result of constants; None if it is not a short fraction.

    A product with an exact 0 is 0: a tape is defined only if all its values are.
    """
    if operation == "mul" and Fraction(0) in values:
        return Fraction(0)
    known = [value for value in values if value is not None]
    if len(known) < len(values) or operation not in _EXACT:
        return None
    if operation in ("div", "inv") and known[-1] == 0:
        return None
    result = _EXACT[operation](*known)
    bits = result.numerator.bit_length() + result.denominator.bit_length()
    return result if bits <= _LONGEST_FRACTION else None


_EXACT: dict[str, Callable[..., Fraction]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "inv": lambda a: 1 / a,
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: 2 * a,
}


class _Splitter:
    """One pass over a problem's tape with some controls boxed."""

    def __init__(
        self, problem: Problem, boxed: Sequence[int], deadline: Deadline
    ) -> None:
        self.problem = problem
        self.deadline = deadline
        self.boxed = boxed
        self.write = _Writer()

    def split(self) -> Split:
        values: list[Terms] = []
        for instruction in self.problem.tape:
            # Products of sums of many controls take long.
            self.deadline.check()
            values.append(self._value(instruction, values))
        problem, free = self.problem, self._free()
        rates = [values[number] for number in problem.rate]
        stage = values[problem.stage]
        for terms in rates:
            for powers in terms:
                if len(powers) > 1:  # f must be affine in the free controls.
                    raise _BoxedError(powers[0])
        self._check_stage(stage)
        return Split(
            boxed=tuple(self.boxed),
            free=free,
            drift=tuple(self._factor(terms) for terms in rates),
            columns=tuple(tuple(terms.get((k,)) for terms in rates) for k in free),
            stage=self._factor(stage),
            linear=tuple(stage.get((k,)) for k in free),
            quadratic=tuple(self._number(stage.get((k, k))) for k in free),
            end=self._factor(values[problem.end]),
            path=tuple(self._factor(values[number]) for number in problem.path),
            ends=tuple(self._factor(values[number]) for number in problem.ends),
            nodes=tuple(self.write.nodes),  # the last, when all constants are written
            deadline=self.deadline,
        )

    def _free(self) -> tuple[int, ...]:
        return tuple(k for k in range(self.problem.m) if k not in self.boxed)

    def _check_stage(self, stage: Terms) -> None:
        for powers in stage:
            if len(powers) < _SECOND:
                continue
            number = self.write.value(stage[powers])
            if powers[0] != powers[1] or number is None or number < 0:
                raise _BoxedError(powers[0])

    def _factor(self, terms: Terms) -> int:
        found = terms.get(())
        return self.write.constant(Fraction(0)) if found is None else found

    def _number(self, number: int | None) -> Fraction:
        value = None if number is None else self.write.value(number)
        return Fraction(0) if value is None else value

    def _value(self, instruction: Instruction, values: list[Terms]) -> Terms:
        operation, operands, constant = instruction
        if operation == "const":
            return {(): self.write.constant(Fraction(constant))}
        if operation in ("t", "x"):
            axis = 0 if operation == "t" else 1 + operands[0]
            return {(): self.write.number(Node("point", (axis,)))}
        if operation == "u":
            return self._control(operands[0])
        terms = [values[operand] for operand in operands]
        if all(set(entry) <= {()} for entry in terms):
            factors = [self._factor(entry) for entry in terms]
            return {(): self.write.apply(operation, *factors)}
        return self._polynomial(operation, terms)

    def _control(self, k: int) -> Terms:
        if k in self.boxed:
            axis = 1 + self.problem.n + list(self.boxed).index(k)
            return {(): self.write.number(Node("point", (axis,)))}
        return {(k,): self.write.constant(Fraction(1))}

    def _polynomial(self, operation: str, terms: list[Terms]) -> Terms:
        first, last = terms[0], terms[-1]
        if operation in ("neg", "twice"):
            return self._mapped(operation, first)
        if operation in ("add", "sub"):
            return self._sum(operation, first, last)
        if operation == "mul":
            return self._product(first, last)
        if operation == "sq":
            return self._product(first, first)
        if operation in ("div", "pow") and set(last) <= {()}:
            factor = self._factor(last)
            if operation == "div":
                return self._mapped("div", first, factor)
            if self.write.value(factor) == _SECOND:
                return self._product(first, first)
        raise _BoxedError(
            next(k for entry in terms for powers in entry for k in powers)
        )

    def _mapped(self, operation: str, terms: Terms, *others: int) -> Terms:
        return self._kept(
            {p: self.write.apply(operation, c, *others) for p, c in terms.items()}
        )

    def _sum(self, operation: str, a: Terms, b: Terms) -> Terms:
        total = dict(a)
        for powers, factor in b.items():
            if powers in total:
                total[powers] = self.write.apply(operation, total[powers], factor)
            elif operation == "sub":
                total[powers] = self.write.apply("neg", factor)
            else:
                total[powers] = factor
        return self._kept(total)

    def _product(self, a: Terms, b: Terms) -> Terms:
        total: Terms = {}
        for p, c in a.items():
            for q, d in b.items():
                powers = tuple(sorted(p + q))
                if len(powers) > _SECOND:
                    raise _BoxedError(powers[0])
                factor = self.write.apply("mul", c, d)
                if powers in total:
                    factor = self.write.apply("add", total[powers], factor)
                total[powers] = factor
        return self._kept(total)

    def _kept(self, terms: Terms) -> Terms:
        return {p: c for p, c in terms.items() if not p or self.write.value(c) != 0}
