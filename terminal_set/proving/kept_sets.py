"""Proven levels, kept on disk, and the checks that an entry must pass to be used.

A proof takes seconds. Its outcome, a level and the margins of a held input, is kept in
the cache of machine code (`code_cache.py` says which files are trusted), under a key of
all that it follows from: the dynamics f, the reference and the bounds, K, P, dt,
options, the state of the random generator, the source code of this folder, and the
versions of the packages that are used.

When an entry is used, the proof is not done again. The entry is believed only if

    its file has the digest of its key and content, and is the user's own
    K and P solve their equations (`matrix_equations.py`)
    the reference rests, or moves as stated; the level is within all bounds
    e'Pe decreases, with the margins, at SAMPLES states of each of several levels
    the flow from these states stays within the stated growth and as near to the map as
        stated; it is computed with STEPS Runge-Kutta steps for each step of the map
    the nearest counterexample lies above the level, and still is one

These conditions are necessary, not sufficient. A program that can write the user's
files could store an entry that is false by little, and the checks would accept it; but
such a program could change the code as well. `python -m swarmstart.terminal_set.check`
proves a certificate again, from its file alone. Sets whose reference drifts by rounding
are not kept.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import cache
from importlib import metadata
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.machine_code import load_code, sources, store_code
from swarmstart.terminal_set.certificates.certificate import (
    Certificate,
    HeldMargins,
    Proof,
    Refutation,
    sealed,
)
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.linear.ellipsoid import Ellipsoid, Reference
from swarmstart.terminal_set.linear.kept import key_of
from swarmstart.terminal_set.proving.decrease import (
    ORDER,
    continuous_change,
    held_change,
    held_map,
)

SAMPLES = 500
RADII = (0.01, 0.3, 0.6, 0.8, 0.9, 0.97, 1.0)
"""Radii at which each direction is sampled, relative to the set's radius."""
STEPS = 8
SEED = 20_260_000
"""Seed of the directions, fixed, so that the caller's generator is not used."""
ROUNDED = 1e-9
"""Relative rounding of the numbers that are compared."""


def key_of_set(
    dynamics: ca.Function,
    reference: Reference,
    design: TerminalSet,
    stated: object,
    rng: np.random.Generator,
) -> str:
    """Return the key of all that a certificate follows from.

    Args:
        dynamics: f(x, u) -> xdot.
        reference: Reference and bounds.
        design: The law and P.
        stated: Time of a hold and the options, as values whose `repr` is exact.
        rng: Generator in the state before the proof.
    """
    numbers = [getattr(reference, one.name) for one in fields(reference)]
    arrays = [*numbers, design.K, design.P, design.x_ref, design.u_ref]
    return key_of(
        "terminal set",
        _code(),
        dynamics.serialize(),
        [None if one is None else np.asarray(one).tolist() for one in arrays],
        stated,
        repr(rng.bit_generator.state),
    )


@cache
def _code() -> tuple[str, ...]:
    """Return what identifies the code of a proof."""
    versions = tuple(metadata.version(name) for name in ("numba", "llvmlite"))
    return sources("swarmstart.terminal_set.proving.certification"), *versions


def keep(key: str, proven: TerminalSet, rng: np.random.Generator) -> None:
    """Store the outcome of a finished proof in the cache.

    Nothing is stored without a certificate, if a limit of seconds stopped the proof, if
    the rounded reference does not rest exactly (`Certificate.drift` is not 0), or if
    `rng` is not like that of `numpy.random.default_rng`.

    Args:
        key: From `key_of_set`, before the proof.
        proven: The set with its certificate.
        rng: Generator in the state after the proof.
    """
    certificate = proven.certificate
    if certificate is None or certificate.drift or not _is_plain(rng):
        return
    proof, held = certificate.proof, certificate.held
    if proof.was_late:
        return
    refutation = certificate.refutation
    content = {
        "alpha": certificate.alpha,
        "proof": [proof.boxes, proof.seconds],
        "held": held
        and [held.integrator_error, held.boxes, held.growth, held.growth_is_proven],
        "refutation": refutation
        and [refutation.alpha, refutation.e.tolist(), refutation.change],
        # The generator goes on as after the proof, so the caller draws the same.
        "rng": rng.bit_generator.state,
    }
    store_code(key, json.dumps(content).encode())


def _is_plain(rng: np.random.Generator) -> bool:
    """Return whether a generator's state can be kept: that of `default_rng`."""
    return isinstance(rng.bit_generator, np.random.PCG64)


def load_set(  # noqa: PLR0913 - what a certificate is about
    key: str,
    dynamics: ca.Function,
    reference: Reference,
    design: TerminalSet,
    *,
    dt: float | None,
    Q_m: Array,
    substeps: int,
    rng: np.random.Generator,
) -> TerminalSet | None:
    """Return the set kept under a key if it passes all checks; else None.

    If a set is returned, `rng` is left in the state that it had after the proof.
    """
    kept = load_code(key)
    if kept is None or not _is_plain(rng):
        return None
    before = rng.bit_generator.state
    try:
        content = json.loads(kept)
        certificate = _certificate(
            content, dynamics, reference, design, dt=dt, Q_m=Q_m, substeps=substeps
        )
        if not _is_credible(certificate, design):
            return None
        rng.bit_generator.state = content["rng"]
        return replace(design, alpha=certificate.alpha, dt=dt, certificate=certificate)
    # Whatever is in the file, a proof is the remedy.
    except (
        *(ArithmeticError, LookupError, RecursionError, TypeError, ValueError),
        SwarmstartError,
    ):
        rng.bit_generator.state = before
        return None


def _certificate(  # noqa: PLR0913 - what a certificate is about
    content: Mapping[str, Any],
    dynamics: ca.Function,
    reference: Reference,
    design: TerminalSet,
    *,
    dt: float | None,
    Q_m: Array,
    substeps: int,
) -> Certificate:
    """Return the certificate that a file's content states."""
    alpha = float(content["alpha"])
    boxes, seconds = content["proof"]
    held = None
    if dt is not None:
        error, of_error, growth, is_proven = content["held"]
        held = HeldMargins(
            substeps=substeps,
            integrator_error=float(error),
            boxes=int(of_error),
            growth=float(growth),
            growth_is_proven=is_proven is True,
        )
    refutation = None
    if content["refutation"] is not None:
        level, e, change = content["refutation"]
        refutation = Refutation(
            alpha=float(level), e=np.array(e, dtype=np.float64), change=float(change)
        )
    return sealed(
        Certificate(
            dynamics=dynamics,
            reference=reference,
            K=design.K,
            P=design.P,
            alpha=alpha,
            core=0.0,
            drift=0.0,
            dt=dt,
            Q_m=Q_m,
            held=held,
            proof=Proof(
                proven=True, alpha=alpha, boxes=int(boxes), seconds=float(seconds)
            ),
            refutation=refutation,
            design=design.design,
            weights=None,
        )
    )


def _is_credible(certificate: Certificate, design: TerminalSet) -> bool:
    """Return whether all that can be evaluated quickly agrees with a certificate."""
    reference, held = certificate.reference, certificate.held
    rates = np.array(certificate.dynamics(reference.x_ref, reference.u_ref)).ravel()
    if not np.array_equal(rates[reference.rates == 0], 0 * rates[reference.rates == 0]):
        return False
    spent = certificate.proof.seconds
    if not (0 <= spent < np.inf and certificate.proof.boxes >= 0):
        return False
    measured = "its growth between samples, which is measured"
    if not 0 < certificate.alpha or {*certificate.unproven()} - {measured}:
        return False
    boundary = Ellipsoid(P=design.P, alpha=certificate.alpha).boundary(
        np.random.default_rng(SEED).normal(size=(len(design.P), SAMPLES))
    )
    e = np.hstack([radius * boundary for radius in RADII])
    if held is None:
        change = continuous_change(certificate.dynamics, design, Q_m=certificate.Q_m)
    else:
        if not (0 <= held.integrator_error < 1 <= held.growth):
            return False
        step = held_map(certificate.dynamics, certificate.dt or 0.0, held.substeps)
        flows = _flow(certificate, e)
        # As in `hold_margins.py`.
        c = held.integrator_error
        Q_m = certificate.Q_m + (2 * c + c**2) * design.P
        change = held_change(step, design, Q_m=Q_m)
        if not _stays(certificate, design, step, e, flows):
            return False
    values = np.array(change.function.map(e.shape[1])(e)).ravel()
    return bool(np.all(values < 0)) and _is_refuted(certificate, change.function)


def _is_refuted(certificate: Certificate, change: ca.Function) -> bool:
    """Return whether the counterexample, if any, is valid and lies above the level."""
    refutation = certificate.refutation
    if refutation is None:
        return True
    e = refutation.e
    return bool(
        e.shape == (len(certificate.P),)
        and certificate.alpha < refutation.alpha
        and abs(e @ certificate.P @ e - refutation.alpha) <= ROUNDED * refutation.alpha
        and float(change(e)) >= 0
        and np.isfinite(refutation.change)
    )


def _flow(certificate: Certificate, e: Array) -> list[Array]:
    """Return deviations from the reference along the flow of a hold, finely stepped.

    Args:
        certificate: Of a held input.
        e: Deviations at the beginning of the hold, shape (nx, n).
    """
    reference, held, dt = certificate.reference, certificate.held, certificate.dt
    steps = STEPS * (held.substeps if held else 1)
    one = ca.simpleRK(certificate.dynamics, 1, ORDER).expand().map(e.shape[1] + 1)
    # The last column is the reference itself, which may move.
    e = np.hstack([e, np.zeros((len(e), 1))])
    x = reference.x_ref[:, None] + e
    u = reference.u_ref[:, None] - certificate.K @ e
    found = []
    for _ in range(steps):
        x = np.array(one(x, u, (dt or 0.0) / steps))
        found.append(x[:, :-1] - x[:, -1:])
    return found


def _stays(
    certificate: Certificate,
    design: TerminalSet,
    step: ca.Function,
    e: Array,
    flows: list[Array],
) -> bool:
    """Return whether the flow keeps to the margins of a held input at samples."""
    reference, held = certificate.reference, certificate.held
    if held is None:
        return True
    size = np.sqrt(design.value(e))
    u = reference.u_ref[:, None] - certificate.K @ e
    at_rest = np.array(step(reference.x_ref, reference.u_ref))
    after = np.array(step.map(e.shape[1])(reference.x_ref[:, None] + e, u)) - at_rest
    error = np.sqrt(design.value(after - flows[-1]))
    far = (held.growth**0.5 + held.integrator_error) * size * (1 + ROUNDED)
    # x_ref + e rounds by its spacing, which is not the integrator's error.
    rounding = 1e-12 * np.sqrt(design.value(np.abs(reference.x_ref) + 1.0))
    near = held.integrator_error * size * (1 + ROUNDED) + rounding
    return bool(np.all(error <= near)) and all(
        np.all(np.sqrt(design.value(flow)) <= far) for flow in flows
    )
