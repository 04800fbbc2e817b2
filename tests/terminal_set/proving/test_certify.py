"""Certification by parts: questions to kept sets, and the report of a failure."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set import (
    Proof,
    ProofOptions,
    ProvenLevel,
    Reference,
    Refutation,
    TerminalSet,
    UnprovenSetError,
    certify,
)
from swarmstart.terminal_set.proving import certification


def posed(rate: float) -> tuple[ca.Function, Reference, TerminalSet]:
    """x' = -rate x, with P = 1 and a law that the input's bounds limit."""
    x, u, one = ca.SX.sym("x"), ca.SX.sym("u"), np.ones(1)
    reference = Reference(x_ref=0 * one, u_ref=0 * one, u_lower=-one, u_upper=one)
    law = TerminalSet(
        K=np.ones((1, 1)), P=np.eye(1), alpha=1.0, x_ref=0 * one, u_ref=0 * one,
        dt=None, design="own",
    )  # fmt: skip
    return ca.Function("f", [x, u], [-rate * x + 0 * u]), reference, law


def test_kept_set_is_asked_for_with_the_margin_that_is_to_be_proven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """None is 0; any other margin is that of another set."""
    asked: list[tuple[object, list[list[float]]]] = []

    def load(key: object, *_: object, Q_m: Array, **__: object) -> None:
        asked.append((key, Q_m.tolist()))

    monkeypatch.setattr(certification, "load_set", load)
    monkeypatch.setattr(certification, "keep", lambda *_: None)
    for margin in (None, 0.0, 0.25, 0.5):
        options = ProofOptions(Q_m=None if margin is None else [[margin]])
        rng = np.random.default_rng(0)
        found = certify(*posed(1.0), dt=None, rng=rng, options=options)
        assert found.certificate is not None
        assert found.certificate.Q_m.tolist() == [[margin or 0.0]]
    keys, margins = zip(*asked, strict=True)
    assert margins == ([[0.0]], [[0.0]], [[0.25]], [[0.5]])
    assert keys[0] == keys[1] and len({*keys}) == 3


@pytest.mark.parametrize("refuted", [None, 0.25])
def test_set_without_any_proven_level_tells_what_was_tried_and_refuted(
    refuted: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = None
    if refuted is not None:
        found = Refutation(alpha=refuted, e=np.array([0.5]), change=0.0)
    proof = Proof(proven=False, alpha=0.01, boxes=1, seconds=0.0)
    level = ProvenLevel(proof=proof, refutation=found)
    monkeypatch.setattr(certification, "proven_level", lambda *_, **__: level)
    options, rng = ProofOptions(work=7.0), np.random.default_rng(0)
    with pytest.raises(UnprovenSetError) as caught:
        certify(*posed(3.0), dt=None, rng=rng, options=options)
    error = caught.value
    assert (error.smallest, error.refuted, error.work) == (0.01, refuted, 7.0)
