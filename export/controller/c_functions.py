"""Functions of a problem as C functions that work on the memory of a controller.

A kernel (ocp/lanes/kernels.py) is machine code that works on several problems, the
lanes, at once. Here it becomes a function for one problem: each name that it reads or
writes is an array in the memory, or a constant table of the file.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca

from swarmstart.export.controller.c_writer import CFunction, CWriter
from swarmstart.ocp.compiled.emitter import simplified, with_inverses
from swarmstart.ocp.compiled.scan import PER_INTERVAL
from swarmstart.ocp.compiled.vectors.operations import emit_tape
from swarmstart.ocp.compiled.vectors.vector_ir import Format
from swarmstart.ocp.interpolation.interpolants import without_interpolants
from swarmstart.ocp.lanes.kernels import Written
from swarmstart.tape import Tape, read_tape


@dataclass(frozen=True, slots=True, eq=False)
class CFile:
    """The functions of one C file so far.

    Attributes:
        form: Floating-point format of its numbers.
        places: Name of an array of the problem -> C expression for it.
        common: Name of an elementary function that the file uses -> the function.
        functions: Name of a function -> its text.
        operations: Name of a function -> its number of operations.
    """

    form: Format
    places: Mapping[str, str]
    common: dict[str, CFunction] = field(default_factory=dict)
    functions: dict[str, str] = field(default_factory=dict)
    operations: dict[str, int] = field(default_factory=dict)

    def add_kernel(self, name: str, kernel: Written) -> None:
        """Add a kernel as `static void NAME(memory_t *m)`.

        Raises:
            UnknownOperationError: If it has an operation that cannot be written in C.
        """
        if kernel.turns:
            self._add_scan(name, kernel)
        else:
            self._add_flat(name, kernel)

    def _add_scan(self, name: str, kernel: Written) -> None:
        """Add a loop over the intervals."""
        function = without_interpolants(kernel.function)
        tape = simplified(with_inverses(read_tape(function)))
        count = kernel.roles.count("carried")
        starts = {
            f"c{a}_{e}": self._entry(kernel.reads[a], str(e))
            for a, role in enumerate(kernel.roles)
            if role == "carried"
            for e in range(tape.inputs[a])
        }
        writer = CWriter(self.form, common=self.common)
        found = emit_tape(writer, tape, _loaded(writer, self._reader(kernel, tape)))
        for output, numbers in enumerate(tape.outputs[count:], start=count):
            for entry, number in enumerate(numbers):
                place = f"k * {len(numbers)} + {entry}"
                written = self._entry(kernel.writes[output], place)
                writer.line(f"{written} = {found[number]};")
        # All are read before: the values are constants of the loop's body.
        after = [found[n] for numbers in tape.outputs[:count] for n in numbers]
        for variable, value in zip(starts, after, strict=True):
            writer.line(f"{variable} = {value};")
        ends = [
            self._entry(kernel.writes[output], str(entry))
            for output, numbers in enumerate(tape.outputs[:count])
            for entry in range(len(numbers))
        ]
        turns = kernel.turns
        order = f"k = {turns - 1}; k >= 0; --k"
        lines = [
            *(f"  real {variable} = {first};" for variable, first in starts.items()),
            "  int k;",
            f"  for ({order if kernel.backward else f'k = 0; k < {turns}; ++k'}) {{",
            *(f"  {line}" for line in writer.body.lines),
            "  }",
            *(f"  {end} = {value};" for end, value in zip(ends, starts, strict=True)),
        ]
        self._add(name, "memory_t *m", lines, turns * writer.operations)

    def _reader(self, kernel: Written, tape: Tape) -> Callable[[int, int], str]:
        """Return a function: argument, entry -> its C expression in interval k."""

        def read(argument: int, entry: int) -> str:
            role, own = kernel.roles[argument], kernel.reads[argument]
            if role == "carried":
                return f"c{argument}_{entry}"
            if role in PER_INTERVAL:
                return self._entry(own, f"k * {tape.inputs[argument]} + {entry}")
            return self._entry(own, str(entry))

        return read

    def _add_flat(self, name: str, kernel: Written) -> None:
        tape = simplified(read_tape(without_interpolants(kernel.function)))
        writer = CWriter(self.form, common=self.common)

        def read(argument: int, entry: int) -> str:
            return self._entry(kernel.reads[argument], str(entry))

        def write(output: int, entry: int) -> str:
            return self._entry(kernel.writes[output], str(entry))

        self._written(writer, tape, read, write)
        self._add(name, "memory_t *m", writer.body.lines, writer.operations)

    def add_function(self, function: ca.Function, name: str) -> None:
        """Add a function as `static void NAME(const real a0[], ..., real r0[], ...)`.

        Args:
            function: An SX function.
            name: Name of the C function.

        Raises:
            UnknownOperationError: If it has an operation that cannot be written in C.
        """
        tape = simplified(read_tape(without_interpolants(function)))
        writer = CWriter(self.form, common=self.common)
        self._written(
            writer, tape, lambda a, e: f"a{a}[{e}]", lambda o, e: f"r{o}[{e}]"
        )
        used = {node.arguments[0] for node in tape.nodes if node.operation == "input"}
        unused = [f"  (void)a{i};" for i in range(len(tape.inputs)) if i not in used]
        given = [f"const real a{i}[]" for i in range(len(tape.inputs))]
        given += [f"real r{i}[]" for i in range(len(tape.outputs))]
        lines = [*writer.body.lines, *unused]
        self._add(name, ", ".join(given), lines, writer.operations)

    def _written(
        self,
        writer: CWriter,
        tape: Tape,
        read: Callable[[int, int], str],
        write: Callable[[int, int], str],
    ) -> None:
        found = emit_tape(writer, tape, _loaded(writer, read))
        for output, numbers in enumerate(tape.outputs):
            for entry, number in enumerate(numbers):
                writer.line(f"{write(output, entry)} = {found[number]};")

    def _entry(self, name: str, index: str) -> str:
        return f"{self.places[name]}[{index}]"

    def _add(self, name: str, given: str, lines: list[str], operations: int) -> None:
        unused = (
            ["  (void)m;"]
            if "memory_t" in given and not any("m->" in line for line in lines)
            else []
        )
        head = f"static void {name}({given})"
        self.functions[name] = "\n".join([head, "{", *lines, *unused, "}", ""])
        self.operations[name] = operations


def _loaded(
    writer: CWriter, read: Callable[[int, int], str]
) -> Callable[[int, int], str]:
    """Return a reader that loads each input once, before its memory is overwritten."""

    def loaded(argument: int, entry: int) -> str:
        name = writer.name("x")
        writer.line(f"const real {name} = {read(argument, entry)};")
        return name

    return loaded
