"""Proven and refuted levels: their distance, the time they take, samples between them.

    python benchmarks/terminal_sets.py --write docs/measured/terminal_set_proofs.md

Each system is certified; then states are drawn from the certified set, half of them
from its edge, and simulated by another integrator. The exit code is 3 if one of them
leaves the set, violates an input's bound or does not come nearer.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.benchmarks.terminal_set_systems import SYSTEMS, System
from swarmstart.terminal_set import (
    ProofOptions,
    TerminalSet,
    UnprovenSetError,
    certified_terminal_set,
    certify,
    continuous_terminal_set,
)
from swarmstart.terminal_set.interval_arithmetic.tape import tape_of

TOLERANCE = 1e-10
BLOCK = 50_000
_HEAD = """# Proven and refuted levels

Made by `python benchmarks/terminal_sets.py --samples {number}`. Refuted: the lowest
level e'Pe found at which a deviation e exists whose e'Pe does not decrease (found by a
local solver, so that a lower one may exist; for held inputs the integrator's margin is
included). Gap: refuted over proven, minus 1. If nothing is refuted, the level is that
of the bounds or, for the tank, the largest within the model's domain. Seconds: the last
proof alone. Violations: of {samples} random states of the set, half of them on its
edge, simulated for one hold (or 1 s) by another integrator (DOP853, 1e-10), the number
that broke an input's bound, left the set at the end, or did not decrease. New: the
system was not tried before the method of proof was finished, and nothing was changed
afterwards.

e is the deviation from the reference. Q_m = Q* means that e'Pe must decrease by at
least e'Q* e a second, with Q* = Q + K'RK of the linear law. "Formation" is a UAV of the
[formation flight](../chapter/formation.md) with inputs held for 1 s, with and without
the bounds of its inputs; "close formation" is the wingman of the [close
formation](../chapter/close_formation.md), whose height follows its command with a lag
of first order (5 states) or of second order (6 states). "Pole of the damping", "tank",
"thin jump", "thin bump" and "nearly a centre" are made to mislead a proof: a division
by zero, a root of a negative number, growth that sets in within 1e-6 of a radius or
only within 1e-3 of it, and a damping of 1e-6 that ends at a radius.

"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Measured:
    """Results for one system."""

    terminal_set: TerminalSet
    violations: int


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all systems, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each proof")
    parser.add_argument("--only", help="systems whose name has this in it")
    options = parser.parse_args(arguments)
    lines = head(
        "system", "states", "refuted", "proven", "gap", "boxes", "seconds",
        "violations",
    )  # fmt: skip
    violations = 0
    for name, make in SYSTEMS.items():
        if options.only and options.only not in name:
            continue
        system = make()
        try:
            measured = measure(system, samples=options.samples, seconds=options.seconds)
        except UnprovenSetError as error:
            lines.append(_unproven_row(name, system, error))
        else:
            violations += measured.violations
            lines.append(_row(name, system, measured))
        print(lines[-1], file=sys.stderr)
    above = _HEAD.format(number=options.samples, samples=f"{options.samples:,}")
    publish(lines, options, above)
    return 3 if violations else 0


def measure(system: System, *, samples: int, seconds: float) -> Measured:
    """Certify a system and simulate samples of its set.

    Args:
        system: The system.
        samples: Number of states drawn.
        seconds: Time for each proof [s].
    """
    found = certified(system, seconds)
    return Measured(
        terminal_set=found,
        violations=violations_of(system, found, samples, np.random.default_rng(1)),
    )


def certified(system: System, seconds: float) -> TerminalSet:
    """Return the certified set of a system."""
    rng, weights = np.random.default_rng(0), system.weights
    options = ProofOptions(
        substeps=system.substeps,
        growth=False,
        work=seconds,
    )
    f, reference = system.dynamics, system.reference
    if system.given is not None:
        return certify(
            f, reference, system.given, dt=system.dt, options=options, rng=rng
        )
    if system.of_cost_to_go:
        design = continuous_terminal_set(
            f, reference, Q=weights.Q, R=weights.R, kappa=weights.kappa
        )
        Q_star = weights.Q + design.K.T @ weights.R @ design.K
        options = replace(options, Q_m=Q_star)
    return certified_terminal_set(
        f, reference, weights, dt=system.dt, options=options, rng=rng
    )


def violations_of(
    system: System, found: TerminalSet, samples: int, rng: np.random.Generator
) -> int:
    """Return the number of states of a set that violate its statements."""
    return sum(
        _violations(system, found, min(BLOCK, samples - done), rng)
        for done in range(0, samples, BLOCK)
    )


def _violations(
    system: System, found: TerminalSet, count: int, rng: np.random.Generator
) -> int:
    """Simulate a block of states; see `violations_of`."""
    nx, reference = len(found.P), system.reference
    e = found.ellipsoid.boundary(rng.normal(size=(nx, count)))
    inner = np.arange(count) % 2 == 0
    e *= np.where(inner, rng.random(count) ** (1 / nx), 1.0)
    f = _numeric(system)
    # The reference is simulated too, as the last column.
    x0 = np.hstack([e, np.zeros((nx, 1))]) + found.x_ref[:, None]
    held = found.u_ref[:, None] + np.hstack(
        [found.feedback(e), 0 * found.u_ref[:, None]]
    )

    def rates(time: float, flat: Array) -> Array:
        del time
        x = flat.reshape(nx, count + 1)
        u = held
        if system.dt is None:
            u = found.u_ref[:, None] + found.feedback(x - x[:, -1:])
        return f(x, u).ravel()

    duration = 1.0 if system.dt is None else system.dt
    flown = solve_ivp(
        rates, (0.0, duration), x0.ravel(), method="DOP853",
        rtol=TOLERANCE, atol=TOLERANCE,
    )  # fmt: skip
    if not flown.success:
        raise ArithmeticError(f"the samples could not be simulated: {flown.message}")
    x = flown.y[:, -1].reshape(nx, count + 1)
    before, after = found.value(e), found.value(x[:, :-1] - x[:, -1:])
    du = found.feedback(e)
    outside = (np.abs(du) > reference.u_max[:, None] * (1 + 1e-9)).any(axis=0)
    return int(np.sum(outside | ~(after < before) | ~(after <= found.alpha)))


def _numeric(system: System) -> "RightHandSide":
    """Return f of many columns in NumPy, from its tape."""
    tape, results = tape_of(system.dynamics)
    return RightHandSide(tape, results)


_FORMS: dict[str, Callable[..., Array]] = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide,
    "pow": np.power, "neg": np.negative, "sq": np.square, "twice": lambda a: 2 * a,
    "inv": np.reciprocal, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos,
    "tan": np.tan, "exp": np.exp, "log": np.log, "atan": np.arctan,
    "tanh": np.tanh, "fabs": np.abs, "fmin": np.minimum, "fmax": np.maximum,
}  # fmt: skip


class RightHandSide:
    """f(x, u) of many columns."""

    def __init__(self, tape: list[list[str | int | float]], results: list[int]) -> None:
        """Keep the tape."""
        self._tape, self._results = tape, results

    def __call__(self, x: Array, u: Array) -> Array:
        """Return the rates, shape (nx, m)."""
        values: list[Array] = []
        for operation, *operands in self._tape:
            if operation == "const":
                values.append(np.full(x.shape[1], float(operands[0])))
            elif operation in ("x", "u"):
                values.append((x if operation == "x" else u)[int(operands[0])])
            else:
                form = _FORMS[str(operation)]
                values.append(form(*[values[int(k)] for k in operands]))
        return np.stack([values[k] for k in self._results])


def _row(name: str, system: System, measured: Measured) -> str:
    """Return a system's row."""
    found, certificate = measured.terminal_set, measured.terminal_set.certificate
    if certificate is None:
        raise TypeError("expected a certified set")
    refutation, proof = certificate.refutation, certificate.proof
    return row(
        f"{name} (new)" if system.is_new else name,
        str(len(found.P)),
        "-" if refutation is None else f"{refutation.alpha:.5g}",
        f"{found.alpha:.5g}",
        _share(certificate.gap),
        f"{proof.boxes:,}",
        f"{proof.seconds:.2f}",
        str(measured.violations),
    )


def _unproven_row(name: str, system: System, error: UnprovenSetError) -> str:
    """Return the row of a system of which no level was proven in time."""
    size, refuted = len(system.reference.x_ref), error.refuted
    known = "-" if refuted is None else f"{refuted:.5g}"
    return row(name, str(size), known, "none in time", *["-"] * 3, "-")


def _share(gap: float | None) -> str:
    return "0" if gap is None else f"{100 * gap:.1f} %"


if __name__ == "__main__":
    sys.exit(main())
