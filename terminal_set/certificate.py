"""Certificates: on what grounds a terminal set stands, as a file anybody can check.

The file is JSON with all that the statements need: the model as data (`tape.py`), the
law, P, alpha, the margins. `python -m swarmstart.terminal_set.check FILE` proves it
again with another arithmetic and shares no code with what is here. The digest in it
finds careless edits; who makes a new digest still has to get past the proof.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.terminal_set.arrays import FloatArray, finite_array
from swarmstart.terminal_set.evidence import Proof, Refutation
from swarmstart.terminal_set.reference import Reference
from swarmstart.terminal_set.tape import tape_of

FORMAT = "swarmstart terminal set certificate"
VERSION = 1


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Weights:
    """What a law is designed from; arrays copied and read-only.

    Attributes:
        Q: State weight, (nx, nx), per second or, of a held input, per step.
        R: Input weight, (nu, nu), likewise.
        kappa: Decay of e'Pe kept in reserve: 1/s if continuous, a share if sampled.

    Raises:
        NotFiniteError: Q or R holds NaN or infinity.
        InvalidShapeError: Q or R is no matrix.
    """

    Q: FloatArray
    R: FloatArray
    kappa: float = 0.0

    def __post_init__(self) -> None:
        """Copy; the designs check the rest."""
        for name in ("Q", "R"):
            copied = finite_array(name, getattr(self, name), (None, None))
            object.__setattr__(self, name, copied)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HeldMargins:
    """What is added to the proof of a held input, which is of the integrator's map.

    Attributes:
        substeps: Runge-Kutta steps a hold.
        integrator_error: c with |flow - map|_P <= c |e|_P, measured, with a reserve.
        samples: Number of deviations it was measured at.
        growth: g with e'Pe <= g (e'Pe at the last sample) at all times.
        growth_is_proven: Whether that is proven, for the map; else it is measured.
    """

    substeps: int
    integrator_error: float
    samples: int
    growth: float
    growth_is_proven: bool

    @property
    def is_usable(self) -> bool:
        """Whether the margins are numbers, and less than all of e'Pe."""
        return bool(self.integrator_error < 0.4 and np.isfinite(self.growth))  # noqa: PLR2004


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Certificate:
    """What was shown of a law and an ellipsoid; arrays copied and read-only.

    Attributes:
        dynamics: f(x, u) -> xdot.
        reference: Reference and bounds.
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx).
        alpha: The proven level: of the decrease and within all bounds.
        core: Level within which a drift of the reference, which is rounded, may undo
            the decrease; the set V <= core is not left (`drift.py`).
        drift: That drift, relative to the core's radius; 1/s or, held, a share.
        dt: How long the input is held [s]; None for an input that moves all the time.
        Q_m: Margin: e'Pe falls by e'Q_m e, per second or per hold, shape (nx, nx).
        held: Margins of a held input; None for one that moves all the time.
        proof: Of the decrease.
        refutation: The nearest counterexample known; None where none was found.
        design: What the design is called.
        weights: Of the design; None where it has none.
    """

    dynamics: ca.Function
    reference: Reference
    K: FloatArray
    P: FloatArray
    alpha: float
    core: float
    drift: float
    dt: float | None
    Q_m: FloatArray
    held: HeldMargins | None
    proof: Proof
    refutation: Refutation | None
    design: str
    weights: Weights | None

    def __post_init__(self) -> None:
        """Copy the arrays."""
        for name in ("K", "P", "Q_m"):
            copied = finite_array(name, getattr(self, name), (None, None))
            object.__setattr__(self, name, copied)

    @property
    def gap(self) -> float | None:
        """Refuted level over proven level, less 1; None where none is refuted."""
        if self.refutation is None:
            return None
        return self.refutation.alpha / self.alpha - 1

    def statements(self) -> list[dict[str, str]]:
        """Return what is stated of the set, and on which grounds."""
        falls = "e'Pe falls by more than e'Q_m e"
        outside = " outside the stated core, which is not left"
        said = [
            ("the inputs stay within their bounds on the set", "closed form"),
            (
                "the states stay within their bounds on the set"
                + ("" if self.held is None else ", between samples too"),
                "closed form" if self.held is None else "measured",
            ),
        ]
        if self.held is None:
            said.append((f"{falls} a second{outside}", "proven"))
        else:
            said += [
                (
                    f"{falls} a hold{outside}, for the Runge-Kutta map and any motion "
                    "that differs from it by the stated error",
                    "proven",
                ),
                ("the integrator's error is at most the stated one", "measured"),
                (
                    "e'Pe stays below the stated growth between samples",
                    "proven" if self.held.growth_is_proven else "measured",
                ),
            ]
        return [{"statement": text, "grounds": grounds} for text, grounds in said]


def certificate_text(certificate: Certificate) -> str:
    """Write a certificate as JSON.

    Args:
        certificate: What was shown.

    Returns:
        The file's text; floats so that they are read back to the last bit.

    Raises:
        UnknownIntervalOperationError: The dynamics have an operation a file has not.
    """
    content = _content(certificate)
    content["sha256"] = digest(content)
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def digest(content: dict[str, object]) -> str:
    """Return the SHA-256 of a certificate without its digest, as hexadecimal digits.

    Args:
        content: The file's content; "sha256" does not count.
    """
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _content(certificate: Certificate) -> dict[str, object]:
    """Return the file's content but for the digest."""
    tape, xdot = tape_of(certificate.dynamics)
    reference, refutation = certificate.reference, certificate.refutation
    held, weights = certificate.held, certificate.weights
    free = np.full(reference.x_ref.shape, np.inf)
    x_lower = -free if reference.x_lower is None else reference.x_lower
    x_upper = free if reference.x_upper is None else reference.x_upper
    return {
        "format": FORMAT,
        "version": VERSION,
        "dynamics": {
            "nx": reference.x_ref.size,
            "nu": reference.u_ref.size,
            "tape": tape,
            "xdot": xdot,
        },
        "reference": {"x": reference.x_ref.tolist(), "u": reference.u_ref.tolist()},
        "bounds": {
            "u_lower": _or_null(reference.u_lower),
            "u_upper": _or_null(reference.u_upper),
            "x_lower": _or_null(x_lower),
            "x_upper": _or_null(x_upper),
        },
        "K": certificate.K.tolist(),
        "P": certificate.P.tolist(),
        "alpha": certificate.alpha,
        "core": {"level": certificate.core, "drift": certificate.drift},
        "dt": certificate.dt,
        "substeps": None if held is None else held.substeps,
        "Q_m": certificate.Q_m.tolist(),
        "margins": _margins(certificate.held),
        "refuted": None
        if refutation is None
        else {
            "alpha": refutation.alpha,
            "e": refutation.e.tolist(),
            "change": refutation.change,
        },
        "design": {
            "name": certificate.design,
            "Q": None if weights is None else weights.Q.tolist(),
            "R": None if weights is None else weights.R.tolist(),
            "kappa": None if weights is None else weights.kappa,
        },
        "proof": {
            "boxes": certificate.proof.boxes,
            "seconds": round(certificate.proof.seconds, 3),
        },
        "statements": certificate.statements(),
    }


def _margins(held: HeldMargins | None) -> dict[str, object]:
    """Return the margins of a held input as the file has them."""
    if held is None:
        return {"integrator": None, "between_samples": None}
    return {
        "integrator": {
            "relative_error": held.integrator_error,
            "grounds": "measured",
            "samples": held.samples,
        },
        "between_samples": {
            "growth": held.growth,
            "grounds": "proven" if held.growth_is_proven else "measured",
        },
    }


def _or_null(bounds: NDArray[np.float64]) -> list[float | None]:
    """Return bounds with None in place of infinity, which JSON has not."""
    return [float(bound) if np.isfinite(bound) else None for bound in bounds]
