"""A loop in LLVM IR."""

from collections.abc import Sequence

from swarmstart.ocp.compiled.vectors.vector_ir import VectorIR


class Loop:
    """A loop that carries values from the end of a turn to the next one.

    Attributes:
        k: Register of the turn's number, from 0.
        carried: Registers of the carried values in a turn.
    """

    def __init__(self, ir: VectorIR, initial: Sequence[str], turns: int) -> None:
        """Begin the loop's body.

        Args:
            ir: The body to emit into.
            initial: The carried values before the first turn.
            turns: Number of turns, at least 1.
        """
        self._ir, self._initial, self._turns = ir, initial, turns
        self._before, self._body = ir.body.block, ir.name("interval")
        ir.line(f"br label {self._body}")
        ir.label(self._body)
        self.k = ir.name("k")
        self.carried = [ir.name("carried") for _ in initial]
        self._head = len(ir.body.lines)

    def close(self, updated: Sequence[str], *, while_: str | None = None) -> None:
        """End the loop's body.

        Args:
            updated: The carried values at the end of a turn.
            while_: A bit that must be set for another turn; None for no such condition.
        """
        ir, done = self._ir, self._ir.name("done")
        following = ir.emit(f"add i64 {self.k}, 1")
        more = ir.emit(f"icmp ult i64 {following}, {self._turns}")
        if while_ is not None:
            more = ir.emit(f"and i1 {more}, {while_}")
        latch = ir.body.block
        ir.line(f"br i1 {more}, label {self._body}, label {done}")
        ir.body.lines[self._head : self._head] = [
            f"  {self.k} = phi i64 [ 0, {self._before} ], [ {following}, {latch} ]",
            *(
                f"  {name} = phi {ir.vector} "
                f"[ {first}, {self._before} ], [ {value}, {latch} ]"
                for name, first, value in zip(
                    self.carried, self._initial, updated, strict=True
                )
            ),
        ]
        ir.label(done)
