"""Motion relative to the reference, in balls, and the drift of the reference itself.

With e = x - x_ref and u = u_ref - K e(0):
  continuous   R(e) = f(x_ref + e, u) - f(x_ref, u_ref)
  held         R(e) = F(x_ref + e, u) - F(x_ref, u_ref)
F is the classic Runge-Kutta map over a time t in `substeps` equal steps, u held. The
difference is formed in every stage, so that the motion of the reference (15 m/s, for
example) cancels before it can widen the enclosure.

The reference may move in states for which the file states a velocity: f must not depend
on them, they must have no bounds, and f must have that velocity there. In all others it
rests, up to rounding. Let r = f(x_ref, u_ref) there, d the motion by it over a hold,
D = |r|_P or |d|_P, |e|_P^2 = e'Pe and a >= D / sqrt(core). Then for V(e) >= core

  continuous   the drift adds 2 e'Pr <= 2 a V(e) to V'
  held         |R(e) + d|_P <= |R(e)|_P + a |e|_P
so the decrease is proven with this amount in reserve, and then no trajectory crosses
V = core from within either. A file states core and a; the core must be negligible
compared with the set.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from flint import arb, arb_mat, ctx

from swarmstart.terminal_set.checker.certificate_file import Certificate, Instruction
from swarmstart.terminal_set.checker.coordinates import symmetric
from swarmstart.terminal_set.checker.findings import NEVER, Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.jets import (
    OPERATIONS,
    VALUES,
    Algebra,
    Jet,
    absolute,
    combination,
)

Stages = list[tuple[list[Jet], list[Jet]]]  # the reference's state and rate
Balls = list[arb]
_STEPS_A_LOOK = 256  # instructions between looks at the clock; well below 1 ms

MOST_CORE = 1e-6  # of alpha: a thousandth of the set's radius
EXACT = 2048  # bits for the rates at the reference: sums of products are exact
SAME_VELOCITY = 1e-9  # difference from the stated velocity, relative to it
_ROUNDS = 60  # of widening a box until the motion stays in it


def live_instructions(certificate: Certificate) -> frozenset[int]:
    """The instructions that reach the state's rate.

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
        if operation not in ("x", "u"):  # Their operand is an entry of x or u.
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
        step = time.scaled(1 / arb(substeps))  # 1/3, for example, is no float.
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


def check_drift(certificate: Certificate, deadline: Deadline = NEVER) -> Finding:
    """Check that the stated drift and core cover the motion of the reference.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    program = Program.of(certificate, deadline)
    refused = _refused_motion(certificate, program)
    if refused:
        return Finding(Verdict.REFUSED, refused)
    resting = frozenset(j for j, v in enumerate(certificate.velocity) if v == 0)
    with ctx.workprec(EXACT):  # Else products of 53 bits seem to move what rests.
        moved = _fastest(certificate, program, resting, [arb(0)] * certificate.nx)
    moving = [j for j in sorted(resting) if not moved[j] == 0]
    stated = ", ".join(
        f"x[{j}] by {velocity:.6g} a second"
        for j, velocity in enumerate(certificate.velocity)
        if velocity != 0
    )
    rests = f"the reference moves {stated}, as the file states" if stated else ""
    if not moving:
        text = f"{rests}, and else it rests" if rests else "the reference rests"
        return Finding(Verdict.PROVED, text)
    listed = ", ".join(f"x[{j}] by {_shown(moved[j])} a second" for j in moving)
    if certificate.dt is not None:
        moved = _over_hold(certificate, program, resting)
    core = arb(certificate.core)
    is_small = core <= MOST_CORE * arb(certificate.alpha)
    if not (is_small and _norm(certificate, moved) <= certificate.drift * core.sqrt()):
        text = (
            "the reference is no equilibrium, beyond what its core bears: without a "
            f"velocity in the file it moves {listed}"
        )
        return Finding(Verdict.REFUSED, text)
    return Finding(
        Verdict.PROVED,
        f"{rests}{'; ' if rests else ''}by rounding the reference moves {listed} at "
        "most, which the decrease has in reserve outside the core, "
        f"V(e) <= {certificate.core:.3g}",
    )


def _refused_motion(certificate: Certificate, program: Program) -> str:
    """Return why the reference cannot move as the file states; empty if it can."""
    bounds = certificate.bounds
    felt = {
        certificate.tape[index][1][0]
        for index in live_instructions(certificate)
        if certificate.tape[index][0] == "x"
    }
    x = [VALUES.constant(value) for value in certificate.x_ref]
    u = [VALUES.constant(value) for value in certificate.u_ref]
    rates = rate(program, x, u)
    for j, velocity in enumerate(certificate.velocity):
        if velocity == 0:
            continue
        said = f"the reference is said to move x[{j}] by {velocity:.6g} a second"
        if j in felt:
            return f"{said}, but the dynamics depend on it"
        if any(bounds[name][j] is not None for name in ("x_lower", "x_upper")):
            return f"{said}, but it has bounds"
        off = absolute(rates[j].value - arb(velocity)).upper()
        if not off <= SAME_VELOCITY * abs(arb(velocity)):
            return f"{said}, but it moves by {_shown(rates[j].value)}"
    return ""


def _fastest(
    certificate: Certificate,
    program: Program,
    resting: frozenset[int],
    around: Sequence[arb],
) -> Balls:
    """Return upper bounds of |f| near x_ref; 0 for states that are stated to move."""
    x = [
        VALUES.constant(arb(value) + arb(-1).union(arb(1)) * reach)
        for value, reach in zip(certificate.x_ref, around, strict=True)
    ]
    u = [VALUES.constant(value) for value in certificate.u_ref]
    return [
        absolute(jet.value).upper() if j in resting else arb(0)
        for j, jet in enumerate(rate(program, x, u))
    ]


def _over_hold(
    certificate: Certificate, program: Program, resting: frozenset[int]
) -> Balls:
    """Return upper bounds of the reference's motion over a hold, by map and flow.

    On every step a box is widened until h sup |f| over it is at most its growth: then
    the flow and every stage of the map stay in it.
    """
    substeps = certificate.substeps or 1
    h = arb(certificate.dt or 0.0) / substeps
    moved = [arb(0)] * certificate.nx
    for _ in range(substeps):
        growth = [h * entry for entry in _fastest(certificate, program, resting, moved)]
        for _ in range(_ROUNDS):
            around = [a + b for a, b in zip(moved, growth, strict=True)]
            fastest = _fastest(certificate, program, resting, around)
            needed = [h * entry for entry in fastest]
            if all(a <= b for a, b in zip(needed, growth, strict=True)):
                break
            # A wider box may need more again.
            growth = [1.5 * entry.upper() for entry in needed]
        else:
            return [arb("inf")] * certificate.nx
        moved = [(a + b).upper() for a, b in zip(moved, growth, strict=True)]
    return moved


def _norm(certificate: Certificate, moved: Balls) -> arb:
    """An upper bound of |.|_P over the box of vectors that are no larger."""
    box = [arb(-1).union(arb(1)) * entry for entry in moved]
    column = arb_mat([[entry] for entry in box])
    form = (column.transpose() * symmetric(certificate.P) * column)[0, 0]
    return form.abs_upper().sqrt().upper()


def _shown(value: arb) -> str:
    return f"{float(value.mid()):.3g}"
