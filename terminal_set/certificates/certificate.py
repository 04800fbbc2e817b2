"""Certificates: the evidence of a terminal set, as a file to be checked.

The evidence for a level is a proof; the evidence against a level, a counterexample.

The file is JSON with all that the statements need: the model as data (`tape.py`), the
law, P, alpha, the margins. `python -m swarmstart.terminal_set.check FILE` checks the
statements again, with another arithmetic and without the code that proved them first.
The digest detects careless edits; a file with a new digest must still pass the proof.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from swarmstart.arguments import a_number, checked, of_kind
from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.interval_arithmetic.tape import tape_of
from swarmstart.terminal_set.linear.arrays import finite_array
from swarmstart.terminal_set.linear.ellipsoid import (
    Reference,
    level_from_inputs,
    level_from_states,
)

FORMAT = "swarmstart terminal set certificate"
VERSION = 2
BY_LIBRARY = "proven by the library"
"""Grounds of statements that the checker samples but does not prove again."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Proof:
    """The outcome of a proof that e'Pe decreases; e is the deviation x - x_ref.

    Attributes:
        proven: Whether the change c(e) of e'Pe is negative everywhere in the ellipsoid
            except at its centre.
        alpha: Level of the ellipsoid, e'Pe <= alpha.
        boxes: Number of boxes examined.
        seconds: Wall time [s].
        counterexample: A deviation e at which c(e) >= 0, or c(e) is not a number, shape
            (nx,); None if none was met.
        was_late: Whether a limit of seconds was met before the budget of work was
            spent: a faster machine may prove more.
    """

    proven: bool
    alpha: float
    boxes: int
    seconds: float
    counterexample: Array | None = None
    was_late: bool = False


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Refutation:
    """A deviation at which e'Pe does not decrease.

    Attributes:
        alpha: e'Pe there: no level at or above it can be proven.
        e: The deviation, shape (nx,), read-only.
        change: The change c(e) of e'Pe there, with the required margin added; at least
            0.
    """

    alpha: float
    e: Array
    change: float

    def __post_init__(self) -> None:
        """Copy e and make the copy read-only."""
        object.__setattr__(self, "e", finite_array("e", self.e, (None,)))


@dataclass(eq=False)
class UnprovenSetError(SwarmstartError, ArithmeticError):
    """No level of a design could be proven.

    Attributes:
        smallest: The smallest level that was tried.
        refuted: Lowest level with a known counterexample; None if none is known.
        work: The budget of work, in units of about a second.
    """

    smallest: float
    refuted: float | None
    work: float

    def __str__(self) -> str:
        """Return a message with the levels that were tried."""
        refuted = "none" if self.refuted is None else f"{self.refuted:.6g}"
        return (
            f"no level could be proven within {self.work:g} units of work: the "
            f"smallest tried was {self.smallest:.6g}, the refuted one is {refuted}"
        )


@dataclass(eq=False)
class CoarseHoldError(UnprovenSetError):
    """The integrator's error cancels the decrease at all levels that were tried.

    A hold is the time for which the input is held.

    Attributes:
        substeps: Number of Runge-Kutta steps in a hold.
    """

    substeps: int

    def __str__(self) -> str:
        """Return a message with a remedy."""
        return (
            f"{super().__str__()}; the error of {self.substeps} Runge-Kutta steps a "
            "hold, or the bound that could be proven of it, leaves too little of the "
            "decrease: more substeps may help, or a shorter hold"
        )


@checked(kappa=a_number())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Weights:
    """The weights of a design; arrays copied and read-only.

    Attributes:
        Q: State weight, (nx, nx), per second; per step for a held input.
        R: Input weight, (nu, nu), likewise.
        kappa: Decay kept in reserve for the nonlinear part of the model: in 1/s, below
            the decay of the slowest mode, in a continuous design; a fraction of e'Pe
            per step in a sampled one.

    Raises:
        NotFiniteError: If Q or R holds NaN or infinity.
        InvalidShapeError: If Q or R is no matrix.

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> ss.Weights(Q=np.diag([10, 1]), R=[[0.1]]).Q.tolist()
        [[10.0, 0.0], [0.0, 1.0]]
    """

    Q: Array
    R: Array
    kappa: float = 0.0

    def __post_init__(self) -> None:
        """Copy; the designs check the rest."""
        for name in ("Q", "R"):
            copied = finite_array(name, getattr(self, name), (None, None))
            object.__setattr__(self, name, copied)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HeldMargins:
    """Margins for a held input, for which the proof is about a map and not the flow.

    The flow leads from the deviation e at a sample to the exact deviation later; the
    map is the Runge-Kutta integrator's approximation of it. |v|_P is the root of v'Pv.

    Attributes:
        substeps: Number of Runge-Kutta steps in a hold.
        integrator_error: c with |flow - map|_P <= c |e|_P at all times of a hold, for
            every e of the set; proven.
        boxes: Number of boxes in the proof of that error.
        growth: g such that, by the map, e'Pe is at all times at most g times e'Pe at
            the last sample; for the flow the factor is (sqrt(g) + c)^2, with c =
            `integrator_error`.
        growth_is_proven: Whether `growth` is proven; if not, it is measured, with a
            margin.
    """

    substeps: int
    integrator_error: float
    boxes: int
    growth: float
    growth_is_proven: bool


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Certificate:
    """The facts shown for a law and an ellipsoid; arrays copied and read-only.

    The law is u = u_ref - K e with the deviation e = x - x_ref.

    Attributes:
        dynamics: f(x, u) -> xdot.
        reference: Reference and bounds.
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx).
        alpha: The proven level: e'Pe decreases up to it, and all bounds hold.
        core: Level of the small set e'Pe <= core, which no trajectory leaves. Within
            it the decrease is not claimed: the reference is rounded to floats, so that
            it may drift and cancel the decrease.
        drift: Upper bound of that drift, divided by sqrt(core); in 1/s, or a fraction
            per hold for a held input.
        dt: Time for which the input is held [s]; None for a continuous input.
        Q_m: Margin: e'Pe decreases by at least e'Q_m e, per second or per hold, shape
            (nx, nx).
        held: Margins of a held input; None for a continuous one.
        proof: Proof of the decrease.
        refutation: The nearest known counterexample; None if none was found.
        design: Name of the design.
        weights: Weights of the design; None if it has none.
        seal: Digest of the proven facts, from `sealed`; "" if nothing was proven.
    """

    dynamics: ca.Function
    reference: Reference
    K: Array
    P: Array
    alpha: float
    core: float
    drift: float
    dt: float | None
    Q_m: Array
    held: HeldMargins | None
    proof: Proof
    refutation: Refutation | None
    design: str
    weights: Weights | None
    seal: str = ""

    def __post_init__(self) -> None:
        """Copy the arrays."""
        for name in ("K", "P", "Q_m"):
            copied = finite_array(name, getattr(self, name), (None, None))
            object.__setattr__(self, name, copied)

    @property
    def gap(self) -> float | None:
        """Ratio of refuted to proven level, less 1; None if no level is refuted."""
        if self.refutation is None:
            return None
        return self.refutation.alpha / self.alpha - 1

    @property
    def growth(self) -> float:
        """Factor g with e'Pe <= g (e'Pe at the last sample) at all times.

        The factor contains the errors of the integrator. It is 1 for a continuous
        input.
        """
        if self.held is None:
            return 1.0
        # V(flow) <= (sqrt(g) + c)^2 V, as in `certification.py`.
        c = self.held.integrator_error + self.drift
        return float((self.held.growth**0.5 + c) ** 2)

    def unproven(self) -> list[str]:
        """Return the statements that the library has not proven; empty if all are.

        Certificates made by `certify` are proven, except for the growth between samples
        if its proof was not requested or failed. Any other entry means that a number
        was changed after the proof: the numbers no longer match the digest `seal`, or
        `alpha` is above the level of the proof or a level that the bounds allow.
        """
        found = []
        if not (self.proof.proven and self.alpha <= self.proof.alpha):
            found.append("that e'Pe falls on all of the set")
        if self.held is not None and not self.held.growth_is_proven:
            found.append("its growth between samples, which is measured")
        inputs = level_from_inputs(self.K, self.P, self.reference.u_max)
        states = level_from_states(self.P, self.reference.e_max) / self.growth
        if not self.alpha <= inputs:
            found.append("that the inputs stay within their bounds")
        if not self.alpha <= states:
            found.append("that the states stay within their bounds")
        if self.seal != seal_of(self):
            found.append("what was changed after it was certified")
        return found

    def statements(self) -> list[dict[str, str]]:
        """Return the statements about the set, each with its grounds.

        Grounds are "proven", "closed form" (computed by a formula) or "measured", for
        example; keys of each dictionary are "statement" and "grounds".
        """
        falls = "e'Pe falls by more than e'Q_m e"
        outside = " outside the stated core, which is not left"
        inputs = ("the inputs stay within their bounds on the set", "closed form")
        states = "the states stay within their bounds on the set"
        if self.held is None:
            said = [
                inputs,
                (states, "closed form"),
                (f"{falls} a second{outside}", "proven"),
            ]
        else:
            grown = "proven" if self.held.growth_is_proven else "measured"
            said = [
                inputs,
                (
                    f"{states}, between samples too",
                    BY_LIBRARY if self.held.growth_is_proven else "measured",
                ),
                (
                    f"{falls} a hold{outside}, for the Runge-Kutta map and any motion "
                    "that differs from it by the stated error",
                    "proven",
                ),
                ("the integrator's error is at most the stated one", BY_LIBRARY),
                ("e'Pe stays below the stated growth between samples", grown),
            ]
        return [{"statement": text, "grounds": grounds} for text, grounds in said]


def sealed(certificate: Certificate) -> Certificate:
    """Return a certificate with a digest of its numbers, by which changes are noticed.

    The digest protects against mistakes only: any program can compute one.
    """
    return replace(certificate, seal=seal_of(certificate))


def seal_of(certificate: Certificate) -> str:
    """Return the digest of a certificate's statements.

    Its design, weights and seal are left out.
    """
    reference, held = certificate.reference, certificate.held
    numbers = [
        certificate.K, certificate.P, certificate.Q_m, reference.x_ref, reference.u_ref,
        reference.u_max, reference.e_max, reference.rates,
    ]  # fmt: skip
    stated = [
        certificate.alpha, certificate.core, certificate.drift, certificate.dt,
        certificate.proof.proven, certificate.proof.alpha, held,
        certificate.dynamics.serialize(), [entry.tolist() for entry in numbers],
    ]  # fmt: skip
    # repr writes floats to the last bit.
    return hashlib.sha256(repr(stated).encode()).hexdigest()


@checked(certificate=of_kind(Certificate, "a Certificate"))
def certificate_text(certificate: Certificate) -> str:
    """Write a certificate as JSON.

    Args:
        certificate: The certificate.

    Returns:
        The file's text; floats are read back to the last bit.

    Raises:
        UnknownIntervalOperationError: If the file format lacks an operation of the
            dynamics.

    Example:
        >>> import casadi as ca, json, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        ...     intervals=4, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> found = ss.terminal_set_of(
        ...     problem, at=[0, 0], weights=ss.Weights(Q=np.eye(2), R=np.eye(1)),
        ...     rng=np.random.default_rng(0),
        ... )
        >>> json.loads(ss.certificate_text(found.certificate))["format"]
        'swarmstart terminal set certificate'
    """
    content = _content(certificate)
    content["sha256"] = digest(content)
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def digest(content: dict[str, object]) -> str:
    """Return the SHA-256 of a certificate without its digest, as hexadecimal digits.

    Args:
        content: The file's content; "sha256" is left out.
    """
    rest = {key: value for key, value in content.items() if key != "sha256"}
    # As the checker computes it, which has its own code for that.
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _content(certificate: Certificate) -> dict[str, object]:
    """Return the file's content without the digest."""
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
        "reference": {
            "x": reference.x_ref.tolist(),
            "u": reference.u_ref.tolist(),
            "velocity": reference.rates.tolist(),
        },
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
    """Return the margins of a held input in the file's form."""
    if held is None:
        return {"integrator": None, "between_samples": None}
    return {
        "integrator": {
            "relative_error": held.integrator_error,
            "grounds": BY_LIBRARY,
            "boxes": held.boxes,
        },
        "between_samples": {
            "growth": held.growth,
            "grounds": "proven" if held.growth_is_proven else "measured",
        },
    }


def _or_null(bounds: Array) -> list[float | None]:
    """Return bounds with None in place of infinity, which JSON does not have."""
    return [float(bound) if np.isfinite(bound) else None for bound in bounds]
