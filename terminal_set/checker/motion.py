"""Motion relative to the reference, and the drift of the reference itself.

Let (x_ref, u_ref) be a reference of x' = f(x, u), e = x - x_ref the deviation from it,
and u = u_ref - K e the law. The motion of e is

  continuous   R(e) = f(x_ref + e, u) - f(x_ref, u_ref)
  held         R(e) = F(x_ref + e, u) - F(x_ref, u_ref)
where R(e) is the rate of e for a continuous input, and e after a time t for a held one.
F is the classic Runge-Kutta map over the time t in `substeps` equal steps, with u held.
R is computed in Taylor models, in which the motion of the reference (15 m/s, for
example) cancels but for rounding.

The reference may move in states for which the file states a velocity: f must not depend
on these states, they must have no bounds, and their rates in f must be that velocity.
In all other states the reference rests, up to rounding. Let r be the rates f(x_ref,
u_ref) of these other states (0 in the states with a velocity), d the motion of the
reference in them over a hold, |e|_P the root of V(e) = e'Pe, D = |r|_P (continuous) or
|d|_P (held), and a >= D / sqrt(core) for a small level `core`. Then for V(e) >= core

  continuous   the drift adds 2 e'Pr <= 2 a V(e) to V'
  held         |R(e) + d|_P <= |R(e)|_P + a |e|_P
so the decrease is proven with this amount in reserve. No trajectory crosses V = core
from within either. A file states `core` and a; `core` must be negligible compared with
the level of the set. The drift is computed in the balls of Arb (Johansson (2017), IEEE
Trans. Computers 66(8)), with so many bits that a reference at rest moves by 0 exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat, ctx

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.coordinates import absolute, square, symmetric
from swarmstart.terminal_set.checker.evaluation import (
    Enclosure,
    Node,
    Program,
    Value,
    as_model,
    times,
)
from swarmstart.terminal_set.checker.findings import NEVER, Deadline, Finding, Verdict
from swarmstart.terminal_set.checker.models import Model, algebra_of

Balls = list[arb]

MOST_CORE = 1e-6  # of alpha: a thousandth of the set's radius
EXACT = 2048  # bits for the rates at the reference: sums of products are exact
SAME_VELOCITY = 1e-9  # difference from the stated velocity, relative to it
_ROUNDS = 60  # of widening a box until the motion stays in it
_WHOLE = 1023  # largest whole exponent raised by multiplication


def program_of(certificate: Certificate, deadline: Deadline = NEVER) -> Program:
    """Return the program of a certificate's dynamics; its variables are x, then u."""
    first = {"x": 0, "u": certificate.nx}
    nodes = [
        Node("point", (first[operation] + operands[0],))
        if operation in first
        else Node(operation, operands, Fraction(constant))
        for operation, operands, constant in certificate.tape
    ]
    return Program(nodes, certificate.xdot, deadline)


class RelativeMotion:
    """The motion relative to the reference, for one certificate.

    Attributes:
        certificate: The statements of the file.
        held: Whether inputs are held.
    """

    def __init__(self, certificate: Certificate, deadline: Deadline = NEVER) -> None:
        """Keep those instructions of the tape that the rates of the states need."""
        self.certificate = certificate
        self.held = certificate.dt is not None
        self._program = program_of(certificate, deadline)
        self._own: dict[tuple[Fraction | None, int | None], list[Model]] = {}

    def run(
        self, e: Sequence[Enclosure], time: Value | None, steps: int | None = None
    ) -> list[Enclosure]:
        """Return the rate at x_ref + e, or the state after a hold from there.

        Unlike in `relative`, the motion of the reference itself is not subtracted.

        Args:
            e: State relative to the reference, shape (nx,).
            time: Time for which the input is held [s]; None for the rate.
            steps: Number of Runge-Kutta steps; None means the file's.

        Raises:
            TimeIsUpError: If the deadline has passed.
        """
        c, like = self.certificate, e[0]
        x = [entry.shifted(r) for entry, r in zip(e, c.x_ref, strict=True)]
        u = []
        for row, reference in zip(c.K, c.u_ref, strict=True):
            total = like.number(reference)
            for gain, entry in zip(row, e, strict=True):
                if gain:
                    total = total + entry.scaled(-gain)
            u.append(total)
        if time is None:
            return self._rate(x, u)
        substeps = steps or c.substeps or 1
        step = times(time, Fraction(1, substeps))
        for _ in range(substeps):
            rates: list[list[Enclosure]] = []
            for part in (None, Fraction(1, 2), Fraction(1, 2), Fraction(1)):
                state = x if part is None else _moved(x, rates[-1], times(step, part))
                rates.append(self._rate(state, u))
            slopes = [
                a + (b + c).scaled(2.0) + d for a, b, c, d in zip(*rates, strict=True)
            ]
            x = _moved(x, slopes, times(step, Fraction(1, 6)))
        return x

    def _rate(self, x: Sequence[Enclosure], u: Sequence[Enclosure]) -> list[Enclosure]:
        found = self._program([*x, *u])
        return [as_model(found[number], x[0]) for number in self.certificate.xdot]

    def relative(
        self,
        e: Sequence[Model],
        time: Model | Fraction | None,
        steps: int | None = None,
    ) -> list[Model]:
        """Return the rate of e, or e after a hold, relative to the reference's motion.

        Args:
            e: State relative to the reference, shape (nx,).
            time: Time for which the input is held [s]; None for the rate.
            steps: Number of Runge-Kutta steps; None means the file's.

        Raises:
            TimeIsUpError: If the deadline has passed.
        """
        moved = self.run(e, time, steps)
        if isinstance(time, Model):
            own = self.run([time.number(0.0) for _ in e], time)
            return [a - b for a, b in zip(moved, own, strict=True)]
        key = time, steps
        if key not in self._own:  # It is one number for all boxes.
            zero = algebra_of(0).constant(np.zeros(1))
            self._own[key] = self.run([zero for _ in e], time, steps)
        return [
            a.shifted(-b.middle, b.spread)
            for a, b in zip(moved, self._own[key], strict=True)
        ]


def _moved(
    x: Sequence[Enclosure], rates: Sequence[Enclosure], time: Value
) -> list[Enclosure]:
    return [
        entry + as_model(times(rate, time), entry)
        for entry, rate in zip(x, rates, strict=True)
    ]


def _whole_power(a: arb, n: int) -> arb:
    """The n-th power by its ends, for whole n of either sign."""
    if n < 0:
        return 1 / _whole_power(a, -n)
    if n % 2:
        return (a.lower() ** n).union(a.upper() ** n)
    return (a.abs_lower() ** n).union(a.abs_upper() ** n) if n else arb(1)


def _power(a: arb, b: arb) -> arb:
    if b.is_exact() and b.is_integer() and abs(b) < _WHOLE:
        return _whole_power(a, int(float(b)))
    return (b * a.log()).exp()


BALLS: dict[str, Callable[..., arb]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": _power,
    "fmin": lambda a, b: a.min(b),
    "fmax": lambda a, b: a.max(b),
    "neg": lambda a: -a,
    "sq": square,
    "twice": lambda a: 2 * a,
    "inv": lambda a: 1 / a,
    "fabs": absolute,
    "sqrt": lambda a: a.sqrt(),
    "sin": lambda a: a.sin(),
    "cos": lambda a: a.cos(),
    "tan": lambda a: a.tan(),
    "exp": lambda a: a.exp(),
    "log": lambda a: a.log(),
    "atan": lambda a: a.atan(),
    "tanh": lambda a: a.tanh(),
}
"""Name of an operation on a tape -> the function of balls."""


def rate_in_balls(program: Program, x: Sequence[arb], u: Sequence[arb]) -> Balls:
    """Return f(x, u) in balls.

    Args:
        program: Program of the dynamics f.
        x: State, shape (nx,).
        u: Input, shape (nu,).

    Raises:
        TimeIsUpError: If the program's deadline has passed.
    """

    def applied(operation: str, operands: Sequence[Fraction | arb]) -> arb:
        return BALLS[operation](*(_ball(operand) for operand in operands))

    found = program([*x, *u], applied)
    return [_ball(found[number]) for number in program.outputs]


def _ball(value: Fraction | arb) -> arb:
    # All fractions are numbers of the file, which are floats.
    return arb(float(value)) if isinstance(value, Fraction) else value


def check_drift(certificate: Certificate, deadline: Deadline = NEVER) -> Finding:
    """Check that the reference moves no more than the stated drift and core allow.

    The core is the small set V(e) <= core in which no decrease is claimed, since the
    drift of the rounded reference may cancel it there.

    Args:
        certificate: The statements of the file; P positive definite.
        deadline: Time at which to stop.

    Returns:
        The finding.

    Raises:
        TimeIsUpError: If the deadline has passed.
    """
    program = program_of(certificate, deadline)
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
    x, u = ([arb(r) for r in part] for part in (certificate.x_ref, certificate.u_ref))
    rates = rate_in_balls(program, x, u)
    for j, velocity in enumerate(certificate.velocity):
        if velocity == 0:
            continue
        said = f"the reference is said to move x[{j}] by {velocity:.6g} a second"
        if j in program.points:
            return f"{said}, but the dynamics depend on it"
        if any(bounds[name][j] is not None for name in ("x_lower", "x_upper")):
            return f"{said}, but it has bounds"
        off = absolute(rates[j] - arb(velocity)).upper()
        if not off <= SAME_VELOCITY * abs(arb(velocity)):
            return f"{said}, but it moves by {_shown(rates[j])}"
    return ""


def _fastest(
    certificate: Certificate,
    program: Program,
    resting: frozenset[int],
    around: Sequence[arb],
) -> Balls:
    """Return upper bounds of |f| near x_ref; 0 for states that are stated to move."""
    x = [
        arb(value) + arb(-1).union(arb(1)) * reach
        for value, reach in zip(certificate.x_ref, around, strict=True)
    ]
    rates = rate_in_balls(program, x, [arb(value) for value in certificate.u_ref])
    return [
        absolute(moved).upper() if j in resting else arb(0)
        for j, moved in enumerate(rates)
    ]


def _over_hold(
    certificate: Certificate, program: Program, resting: frozenset[int]
) -> Balls:
    """Return upper bounds of the reference's motion over a hold, by map and flow.

    On every step, of the length h, a box is widened until h sup |f| over the box is at
    most the width that was added: then the flow and every stage of the map stay in the
    box.
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
