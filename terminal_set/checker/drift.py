"""Drift of a reference that is an equilibrium only up to rounding, and its margin.

Let r = f(x_ref, u_ref) in the states that should rest (those on which f depends, and
those with bounds; the others may move), d the motion by it over a hold, D = |r|_P or
|d|_P, |e|_P^2 = e'Pe and a >= D / sqrt(core). Then for V(e) >= core

  continuous   the drift adds 2 e'Pr <= 2 a V(e) to V'
  held         |R(e) + d|_P <= |R(e)|_P + a |e|_P
so the decrease is proven with this amount in reserve, and then no trajectory crosses
V = core from within either. A file states core and a; the core must be negligible
compared with the set.
"""

from __future__ import annotations

from collections.abc import Sequence

from flint import arb, arb_mat

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.coordinates import symmetric
from swarmstart.terminal_set.checker.deadline import NEVER, Deadline
from swarmstart.terminal_set.checker.findings import Finding, Verdict
from swarmstart.terminal_set.checker.jets import VALUES, absolute
from swarmstart.terminal_set.checker.motion import Program, live_instructions, rate

MOST_CORE = 1e-6  # of alpha: a thousandth of the set's radius
_ROUNDS = 60  # of widening a box until the motion stays in it

Balls = list[arb]


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
    resting = _resting(certificate)
    moved = _fastest(certificate, program, resting, [arb(0)] * certificate.nx)
    moving = [j for j in sorted(resting) if not moved[j] == 0]
    if not moving:
        text = "the reference is an equilibrium, but for states that may move along"
        return Finding(Verdict.PROVED, text)
    listed = ", ".join(f"x[{j}] by {_shown(moved[j])} a second" for j in moving)
    if certificate.dt is not None:
        moved = _over_hold(certificate, program, resting)
    core = arb(certificate.core)
    is_small = core <= MOST_CORE * arb(certificate.alpha)
    if not (is_small and _norm(certificate, moved) <= certificate.drift * core.sqrt()):
        text = f"the reference is no equilibrium, beyond what its core bears: {listed}"
        return Finding(Verdict.REFUSED, text)
    return Finding(
        Verdict.PROVED,
        f"the reference moves {listed} at most, which the decrease has in reserve "
        f"outside the core, V(e) <= {certificate.core:.3g}",
    )


def _resting(certificate: Certificate) -> frozenset[int]:
    """Return the states that should rest: f depends on them, or they have bounds."""
    bounds = certificate.bounds
    bounded = {
        j
        for name in ("x_lower", "x_upper")
        for j, bound in enumerate(bounds[name])
        if bound is not None
    }
    felt = {
        certificate.tape[index][1][0]
        for index in live_instructions(certificate)
        if certificate.tape[index][0] == "x"
    }
    return frozenset(bounded | felt)


def _fastest(
    certificate: Certificate,
    program: Program,
    resting: frozenset[int],
    around: Sequence[arb],
) -> Balls:
    """Return upper bounds of |f| near x_ref; 0 for states that may move."""
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
