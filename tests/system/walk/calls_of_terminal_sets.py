"""Calls of the walk: terminal sets and their proofs."""

from __future__ import annotations

import numpy as np

import swarmstart as ss
from swarmstart import terminal_set
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import Call, Calls, record, with_defaults

A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
Q, R, K = np.eye(2), np.eye(1), np.ones((1, 2))
STABLE = np.array([[-1.0, 0.0], [0.0, -1.0]])


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    return {**_linear(), **_sets(), **_proofs(), **_certificates()}


def _linear() -> Calls:
    system = {"A": A, "B": B, "Q": Q, "R": R}
    sampled = {"Ad": np.eye(2) + 0.1 * A, "Bd": 0.1 * B, "Q": Q, "R": R}
    return {
        "continuous_lqr": Call(terminal_set.continuous_lqr, system),
        "sampled_lqr": Call(terminal_set.sampled_lqr, sampled),
        "continuous_lyapunov": Call(
            terminal_set.continuous_lyapunov, {"F": STABLE, "Q": Q}
        ),
        "sampled_lyapunov": Call(
            terminal_set.sampled_lyapunov, {"F": STABLE / 2, "Q": Q}
        ),
        "Gain": record(terminal_set.continuous_lqr(**system)),
        "hold": Call(terminal_set.hold, {"A": A, "B": B, "dt": 0.1}),
        "held_spectral_radius": Call(
            terminal_set.held_spectral_radius, {"A": A, "B": B, "K": K, "dt": 0.1}
        ),
        "linearise": Call(
            terminal_set.linearise,
            {"dynamics": made.dynamics(), "x_ref": made.START, "u_ref": np.zeros(1)},
        ),
    }


def _sets() -> Calls:
    ellipsoid = terminal_set.Ellipsoid(P=np.eye(2), alpha=1.0)
    design, e = made.design(), np.zeros(2)
    near = {"dynamics": made.dynamics(), "reference": made.reference()}
    return {
        "Ellipsoid": record(ellipsoid),
        "Ellipsoid.boundary": Call(ellipsoid.boundary, {"directions": np.eye(2)}),
        "Ellipsoid.contains": with_defaults(ellipsoid.contains, e=e),
        "Ellipsoid.shadow": with_defaults(ellipsoid.shadow, i=0, j=1),
        "Ellipsoid.value": Call(ellipsoid.value, {"e": e}),
        "log_volume": Call(terminal_set.log_volume, {"ellipsoid": ellipsoid}),
        "Reference": with_defaults(
            ss.Reference, x_ref=e, u_ref=np.zeros(1), u_lower=[-1], u_upper=[1]
        ),
        "Weights": with_defaults(ss.Weights, Q=Q, R=R),
        "TerminalSet": record(design),
        "TerminalSet.contains": Call(design.contains, {"e": e}),
        "TerminalSet.feedback": Call(design.feedback, {"e": e}),
        "TerminalSet.value": Call(design.value, {"e": e}),
        "TerminalSet.linear_law": with_defaults(design.linear_law),
        "sampled_terminal_set": with_defaults(
            ss.sampled_terminal_set, **near, dt=0.1, Q=Q, R=R
        ),
        "continuous_terminal_set": with_defaults(
            terminal_set.continuous_terminal_set, **near, Q=Q, R=R
        ),
        "level_from_inputs": Call(
            terminal_set.level_from_inputs, {"K": K, "P": Q, "u_max": [1.0]}
        ),
        "level_from_states": Call(
            terminal_set.level_from_states, {"P": Q, "e_max": [1.0, 1.0]}
        ),
        "input_excess": Call(
            terminal_set.input_excess,
            {"K": K, "P": Q, "alpha": 1.0, "u_max": [1.0]},
        ),
        "smaller_side": Call(
            terminal_set.smaller_side,
            {"name": "u", "reference": [0.0], "lower": [-1.0], "upper": [1.0]},
        ),
    }


def _proofs() -> Calls:
    change = made.change()
    near = {"dynamics": made.dynamics(), "reference": made.reference()}
    options = made.OPTIONS
    proven = terminal_set.proven_level(change, 1.0, rng=made.rng(), work=0.1)
    candidate, *_ = terminal_set.largest_proven_set(
        lambda scale: made.continuous(),
        lambda found: change,
        [1.0],
        rng=made.rng(),
        work=0.1,
    )
    return {
        "ProofOptions": with_defaults(ss.ProofOptions),
        "Change": record(change),
        "continuous_change": with_defaults(
            terminal_set.continuous_change,
            dynamics=made.dynamics(),
            terminal_set=made.continuous(),
        ),
        "held_change": with_defaults(
            terminal_set.held_change, step=made.step(), terminal_set=made.design()
        ),
        "prove_level": with_defaults(
            terminal_set.prove_level, change=change, alpha=0.5, work=0.1
        ),
        "refuted_level": Call(
            terminal_set.refuted_level,
            {"change": change, "alpha_max": 1.0, "rng": made.rng()},
        ),
        "proven_level": with_defaults(
            terminal_set.proven_level,
            change=change,
            alpha_max=1.0,
            rng=made.rng(),
            work=0.1,
        ),
        "largest_proven_set": with_defaults(
            terminal_set.largest_proven_set,
            design=lambda scale: made.continuous(),
            change=lambda found: change,
            scales=[1.0],
            rng=made.rng(),
            work=0.1,
        ),
        "certify": with_defaults(
            ss.certify,
            **near,
            design=made.design(),
            rng=made.rng(),
            dt=0.1,
            options=options,
        ),
        "certified_terminal_set": with_defaults(
            terminal_set.certified_terminal_set,
            **near,
            weights=made.weights(),
            rng=made.rng(),
            dt=0.1,
            options=options,
        ),
        "interval_function": with_defaults(
            terminal_set.interval_function, function=made.dynamics()
        ),
        "ProvenLevel": record(proven),
        "Candidate": record(candidate),
        "Proof": record(proven.proof),
    }


def _certificates() -> Calls:
    certificate = made.certified().certificate
    assert certificate is not None
    return {
        "Certificate": record(certificate),
        "certificate_text": Call(ss.certificate_text, {"certificate": certificate}),
        "HeldMargins": record(certificate.held),
        "Refutation": Call(
            terminal_set.Refutation, {"alpha": 1.0, "e": np.zeros(2), "change": 0.0}
        ),
    }
