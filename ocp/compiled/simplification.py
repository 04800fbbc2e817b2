"""Multiples of one value in a sum, added once.

CasADi adds what it is told to: the classical Runge-Kutta step of a constant rate k is
h/6 (((k + 2 k) + 2 k) + k). Here it becomes h k, which is then the same value as the
h k of the last stage, so that one sine serves both. What changes is rounding, in favour
of fewer: multiples are put together only where they have one sign, so nothing cancels,
and only where nothing else uses the sum between.
"""

from swarmstart.tape import Node, Tape, TapeBuilder


def simplified(tape: Tape) -> Tape:
    """Return a tape with the multiples of one value in each sum put together.

    Args:
        tape: The tape.
    """
    users = tape.users()
    sums = _Sums()
    numbers: list[int] = []
    for node in tape.nodes:
        if node.operation in ("input", "constant"):
            numbers.append(sums.number(node))
            continue
        arguments = tuple(numbers[a] for a in node.arguments)
        inner = tuple(
            number
            for number, a in zip(arguments, node.arguments, strict=True)
            if users[a] == 1
        )
        numbers.append(sums.value(node.operation, arguments, inner))
    outputs = [[numbers[number] for number in output] for output in tape.outputs]
    return sums.tape(outputs, tape.inputs)


_SMALLEST = 1e-100


class _Sums(TapeBuilder):
    """Builds values; knows sums and constant multiples of what it has built."""

    def value(
        self, operation: str, arguments: tuple[int, ...], inner: tuple[int, ...]
    ) -> int:
        """Return the number of an operation's result.

        Args:
            operation: Its name.
            arguments: Numbers of its arguments.
            inner: Those that nothing else uses.
        """
        if operation == "add":
            first, second = arguments
            return self._sum(first, second, inner)
        if operation == "mul":
            for factor, other in (arguments, arguments[::-1]):
                if self.nodes[factor].operation == "constant" and other in inner:
                    known, base = self._multiple(other)
                    product = self.nodes[factor].value * known
                    if known != 1.0 and _is_ordinary(product):
                        return self._times(product, base)
        return self.apply(operation, arguments)

    def _sum(self, a: int, b: int, inner: tuple[int, ...]) -> int:
        merged = self._merged(a, b, inner)
        if merged is not None:
            return merged
        for total, term in ((a, b), (b, a)):
            if total in inner and self.nodes[total].operation == "add":
                first, second = self.nodes[total].arguments
                for kept, other in ((first, second), (second, first)):
                    merged = self._merged(other, term, (*inner, other))
                    if merged is not None:
                        return self.apply("add", (kept, merged))
        return self.apply("add", (a, b))

    def _merged(self, a: int, b: int, inner: tuple[int, ...]) -> int | None:
        """Return a + b as one multiple; None where they are not of one value."""
        (p, u), (q, v) = (self._multiple(n) if n in inner else (1.0, n) for n in (a, b))
        if u != v or not p * q > 0 or not _is_ordinary(p + q):
            return None
        return self._times(p + q, u)

    def _multiple(self, number: int) -> tuple[float, int]:
        """Return c and u of a value c u."""
        node = self.nodes[number]
        if node.operation == "twice":
            return 2.0, node.arguments[0]
        if node.operation == "mul":
            for factor, other in (node.arguments, node.arguments[::-1]):
                if self.nodes[factor].operation == "constant":
                    return self.nodes[factor].value, other
        return 1.0, number

    def _times(self, factor: float, number: int) -> int:
        if factor == 1.0:
            return number
        if factor == 2.0:  # noqa: PLR2004
            return self.apply("twice", (number,))
        constant = self.number(Node("constant", (), factor))
        return self.apply("mul", (constant, number))


def _is_ordinary(factor: float) -> bool:
    """Return whether multiplying by a factor comes near no end of the exponents."""
    return _SMALLEST < abs(factor) < 1 / _SMALLEST


COSTLY = frozenset(
    "sin cos tan exp log sqrt asin acos atan sinh cosh tanh asinh acosh atanh "
    "log1p expm1 erf".split()
)


def repeated_functions(stage: Tape) -> list[tuple[int, int, int]]:
    """Return the functions of a state that the next stage would compute once more.

    A Runge-Kutta step ends with the rate at x + h k, which for a constant rate is the
    state after it: its sine is the one that the next step begins with.

    Args:
        stage: (x, ...) -> (x after, ...).

    Returns:
        (entry of the state, number of a function of it, number of that function of the
        same entry after the stage).
    """
    places = {
        (node.operation, node.arguments[0]): number
        for number, node in enumerate(stage.nodes)
        if node.operation in COSTLY
    }
    before = {
        node.arguments[1]: number
        for number, node in enumerate(stage.nodes)
        if node.operation == "input" and node.arguments[0] == 0
    }
    return [
        (entry, now, places[operation, stage.outputs[0][entry]])
        for (operation, argument), now in places.items()
        for entry, number in before.items()
        if argument == number and (operation, stage.outputs[0][entry]) in places
    ]
