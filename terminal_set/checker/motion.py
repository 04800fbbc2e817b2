"""Motion relative to the reference, in balls: the field and its Runge-Kutta map.

With e = x - x_ref and u = u_ref - K e(0):
  continuous   R(e) = f(x_ref + e, u) - f(x_ref, u_ref)
  held         R(e) = F(x_ref + e, u) - F(x_ref, u_ref)
F is the classic Runge-Kutta map over a time t in `substeps` equal steps, u held. The
difference is formed in every stage, so that the motion of the reference (15 m/s, for
example) cancels before it can widen the enclosure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from flint import arb

from swarmstart.terminal_set.checker.certificate_file import Certificate, Instruction
from swarmstart.terminal_set.checker.deadline import NEVER, Deadline
from swarmstart.terminal_set.checker.jets import (
    OPERATIONS,
    VALUES,
    Algebra,
    Jet,
    combination,
)

Stages = list[tuple[list[Jet], list[Jet]]]  # the reference's state and rate
Balls = list[arb]
_STEPS_A_LOOK = 256  # instructions between looks at the clock; well below 1 ms


def live_instructions(certificate: Certificate) -> frozenset[int]:
    """The instructions that reach the state's rate.

    Args:
        certificate: What the file states.

    Returns:
        Their numbers.
    """
    live: set[int] = set()
    waiting = list(certificate.xdot)
    while waiting:
        index = waiting.pop()
        if index in live:
            continue
        live.add(index)
        operation, operands, _ = certificate.tape[index]
        if operation not in ("x", "u"):
            waiting.extend(operands)
    return frozenset(live)


@dataclass(frozen=True, slots=True)
class Program:
    """The live part of a tape.

    Attributes:
        steps: (number, instruction), in order.
        outputs: Numbers of the state's rates.
        deadline: Time limit, checked in every evaluation.
    """

    steps: tuple[tuple[int, Instruction], ...]
    outputs: tuple[int, ...]
    deadline: Deadline

    @classmethod
    def of(cls, certificate: Certificate, deadline: Deadline = NEVER) -> Program:
        """Return the program of a certificate's dynamics."""
        live = live_instructions(certificate)
        steps = tuple((i, certificate.tape[i]) for i in sorted(live))
        return cls(steps, certificate.xdot, deadline)

    def timed_steps(self) -> Iterator[tuple[int, Instruction]]:
        """Iterate over the steps, and check the deadline now and then.

        Raises:
            TimeIsUpError: If the deadline has passed.
        """
        for first in range(0, len(self.steps), _STEPS_A_LOOK):
            self.deadline.check()
            yield from self.steps[first : first + _STEPS_A_LOOK]


def rate(program: Program, x: Sequence[Jet], u: Sequence[Jet]) -> list[Jet]:
    """f(x, u) in jets.

    Args:
        program: The dynamics.
        x: State, shape (nx,).
        u: Input, shape (nu,).

    Returns:
        The state's rate, shape (nx,).

    Raises:
        TimeIsUpError: If the program's deadline has passed.
    """
    algebra = x[0].algebra
    results: dict[int, Jet] = {}
    for number, (operation, operands, constant) in program.timed_steps():
        if operation == "x":
            results[number] = x[operands[0]]
        elif operation == "u":
            results[number] = u[operands[0]]
        elif operation == "const":
            results[number] = algebra.constant(constant)
        else:
            arguments = [results[i] for i in operands]
            results[number] = OPERATIONS[operation](*arguments)
    return [results[i] for i in program.outputs]


class RelativeMotion:
    """The motion relative to the reference, for one certificate.

    Attributes:
        certificate: What the file states.
        program: Its dynamics.
        held: Whether inputs are held.
    """

    def __init__(self, certificate: Certificate, deadline: Deadline = NEVER) -> None:
        """Convert the numbers to balls."""
        self.certificate = certificate
        self.program = Program.of(certificate, deadline)
        self.held = certificate.dt is not None
        self._x_ref = [arb(value) for value in certificate.x_ref]
        self._u_ref = [arb(value) for value in certificate.u_ref]
        self._law = [[-arb(entry) for entry in row] for row in certificate.K]

    def reference_stages(self, algebra: Algebra, time: Jet | None) -> Stages:
        """Return the reference's own motion, stage by stage.

        Args:
            algebra: Algebra of the jets.
            time: Time for which the input is held [s]; None for the field alone.

        Returns:
            Its state and rate at each stage.
        """
        x = [algebra.constant(value) for value in self._x_ref]
        u = [algebra.constant(value) for value in self._u_ref]
        if time is None:
            return [(x, rate(self.program, x, u))]
        substeps = self.certificate.substeps or 1
        step = time.scaled(1 / arb(substeps))
        stages: Stages = []
        for _ in range(substeps):
            rates: list[list[Jet]] = []
            for fraction in (None, 0.5, 0.5, 1.0):
                state = _stage(x, rates, step, fraction)
                rates.append(rate(self.program, state, u))
                stages.append((state, rates[-1]))
            x = _step(x, rates, step)
        return stages

    def relative(
        self, e: Sequence[Jet], time: Jet | None, reference: Stages
    ) -> list[Jet]:
        """Return the relative field or map R at e.

        Args:
            e: State relative to the reference, shape (nx,).
            time: Time for which the input is held [s]; None for the field alone.
            reference: Result of `reference_stages` for the same time.

        Returns:
            R(e), shape (nx,).
        """
        algebra = e[0].algebra
        u = [
            algebra.constant(value) + change
            for value, change in zip(
                self._u_ref, combination(self._law, e), strict=True
            )
        ]
        if time is None:
            return self._relative_rate(e, u, reference[0])
        substeps = self.certificate.substeps or 1
        step = time.scaled(1 / arb(substeps))
        state = list(e)
        for number in range(substeps):
            rates: list[list[Jet]] = []
            for i, fraction in enumerate((None, 0.5, 0.5, 1.0)):
                moved = _stage(state, rates, step, fraction)
                rates.append(self._relative_rate(moved, u, reference[4 * number + i]))
            state = _step(state, rates, step)
        return state

    def at(self, e: Sequence[arb], time: arb | None) -> Balls:
        """Return R at one point, in balls.

        Args:
            e: State relative to the reference, shape (nx,).
            time: Time for which the input is held [s]; None for the field alone.

        Returns:
            R(e), shape (nx,).
        """
        duration = None if time is None else VALUES.constant(time)
        reference = self.reference_stages(VALUES, duration)
        point = [VALUES.constant(entry) for entry in e]
        return [jet.value for jet in self.relative(point, duration, reference)]

    def _relative_rate(
        self, e: Sequence[Jet], u: list[Jet], reference: tuple[list[Jet], list[Jet]]
    ) -> list[Jet]:
        x = [r + moved for r, moved in zip(reference[0], e, strict=True)]
        ours = rate(self.program, x, u)
        return [a - b for a, b in zip(ours, reference[1], strict=True)]


def _stage(
    x: Sequence[Jet], rates: list[list[Jet]], step: Jet, fraction: float | None
) -> list[Jet]:
    if fraction is None:
        return list(x)
    reach = step.scaled(fraction)
    return [entry + reach * slope for entry, slope in zip(x, rates[-1], strict=True)]


def _step(x: Sequence[Jet], rates: list[list[Jet]], step: Jet) -> list[Jet]:
    sixth = step.scaled(1 / arb(6))
    return [
        entry + sixth * (a + (b + c).scaled(2) + d)
        for entry, a, b, c, d in zip(x, *rates, strict=True)
    ]
