"""Terminal sets: a linear law and the region in which it takes over (the dual mode).

Numbers such as (5.12) are equations of the book chapter (docs/chapter), two of which
have errors that are corrected here. The law and its region are

    u = u_ref - K e   for e = x - x_ref in Omega = {e : e'Pe <= alpha}

Two designs, side by side:

    sampled     for a controller that holds its input for dt: gain and P of the
                discrete Riccati equation, level by the corrected (5.14)
    continuous  for a continuous input: gain of the continuous Riccati equation, P by
                the corrected (5.12), level by the corrected (5.14)

A continuous design may be unstable if its input is held: the chapter's formation, held
1 s, has the spectral radius 10.8 (`held_spectral_radius`), whatever P and alpha are.

All levels here come from bounds on inputs and states alone. They do not show that e'Pe
decreases under the nonlinear dynamics, nor do they cover states between two samples. A
certificate shows both, and may lower alpha for this (`certification.py`).

Source: the chapter (docs/chapter), eq. (5.8)-(5.14); H. Chen and F. Allgoewer, A
quasi-infinite horizon nonlinear model predictive control scheme with guaranteed
stability, Automatica 34 (1998): the P of this paper is that of
`continuous_terminal_set` with a reserve kappa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    NAMES,
    a_number,
    checked,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.errors import InvalidArgumentError, SwarmstartError
from swarmstart.terminal_set.certificates.certificate import Certificate
from swarmstart.terminal_set.linear.arrays import (
    Mask,
    NotPositiveError,
    columns_of,
    finite_array,
)
from swarmstart.terminal_set.linear.ellipsoid import (
    Ellipsoid,
    Reference,
    level_from_inputs,
    level_from_states,
)
from swarmstart.terminal_set.linear.linearisation import hold, linearise
from swarmstart.terminal_set.linear.matrix_equations import (
    continuous_lqr,
    continuous_lyapunov,
    sampled_lqr,
    sampled_lyapunov,
)
from swarmstart.terminal_set.linear.stability import CONTINUOUS, SAMPLED, growth

if TYPE_CHECKING:
    import control


@dataclass(eq=False)
class InvalidReserveError(SwarmstartError, ValueError):
    """The decay kept in reserve is negative, or not below that of the slowest mode.

    Attributes:
        kappa: The requested reserve, in 1/s, or a fraction of e'Pe per step.
        decay: Decay of the slowest mode of the closed loop, likewise.
    """

    kappa: float
    decay: float

    def __str__(self) -> str:
        """Return a message with the available decay."""
        return (
            f"kappa must be at least 0 and less than {self.decay:.6g}, the decay of "
            f"the slowest mode, got {self.kappa:.6g}"
        )


@dataclass(eq=False)
class ForeignCertificateError(SwarmstartError, ValueError):
    """A set was given the certificate of another set.

    Attributes:
        name: Name of the attribute that differs; "alpha" if the set is larger than the
            certified one.
    """

    name: str

    def __str__(self) -> str:
        """Return a message with the difference."""
        if self.name == "alpha":
            return "alpha is larger than the level that the certificate proves"
        return f"the certificate is of a set with another {self.name}"


@checked(
    alpha=a_number(finite=False, nan=True),
    dt=optional(a_number()),
    design=text(),
    certificate=optional(of_kind(Certificate, "a Certificate")),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TerminalSet:
    """A linear law and the ellipsoid it is meant for; arrays copied and read-only.

    Attributes:
        K: Gain of u = u_ref - K e with e = x - x_ref, shape (nu, nx). The gain of the
            chapter (docs/chapter) is -K.
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        alpha: Level of the ellipsoid, > 0.
        x_ref: Reference state of the design, shape (nx,), SI units.
        u_ref: Reference input, shape (nu,).
        dt: Time for which the input is held [s]; None for a continuous input.
        design: Name of the design: "sampled", "continuous", "literal" or one of the
            user.
        certificate: Proof of the set; None if there is only its design.
        ellipsoid: {e : e'Pe <= alpha}; made from P and alpha.

    Raises:
        InvalidShapeError: If sizes do not agree.
        NotFiniteError: If an array holds NaN or infinity.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        NotPositiveError: If alpha or dt is not positive and finite.
        ForeignCertificateError: If the certificate is of another set or a smaller one.
    """

    K: Array
    P: Array
    alpha: float
    x_ref: Array
    u_ref: Array
    dt: float | None
    design: str
    certificate: Certificate | None = field(default=None, repr=False)
    ellipsoid: Ellipsoid = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check and copy."""
        ellipsoid = Ellipsoid(P=self.P, alpha=self.alpha)
        if self.dt is not None and not 0 < self.dt < np.inf:
            raise NotPositiveError("dt", self.dt)
        nx = len(ellipsoid.P)
        u_ref = finite_array("u_ref", self.u_ref, (None,))
        checked = {
            "K": finite_array("K", self.K, (u_ref.size, nx)),
            "P": ellipsoid.P,
            "x_ref": finite_array("x_ref", self.x_ref, (nx,)),
            "u_ref": u_ref,
            "ellipsoid": ellipsoid,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if self.certificate is not None:
            self._require_own(self.certificate)

    def _require_own(self, certificate: Certificate) -> None:
        """Validate that a certificate is of this set."""
        reference = certificate.reference
        for name, value in (
            ("K", certificate.K),
            ("P", certificate.P),
            ("x_ref", reference.x_ref),
            ("u_ref", reference.u_ref),
        ):
            if not np.array_equal(getattr(self, name), value):
                raise ForeignCertificateError(name)
        if self.dt != certificate.dt:
            raise ForeignCertificateError("dt")
        if self.alpha > certificate.alpha:
            raise ForeignCertificateError("alpha")

    @checked(e=reals())
    def feedback(self, e: ArrayLike) -> Array:
        """Compute the law's input relative to u_ref, du = -K e.

        Args:
            e: Deviation x - x_ref, shape (nx,), or many, shape (nx, n).

        Returns:
            u - u_ref, shape (nu,) or (nu, n).

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        return np.asarray(-self.K @ columns_of("e", e, len(self.P)))

    @checked(e=reals())
    def value(self, e: ArrayLike) -> Array:
        """Compute e'Pe.

        Args:
            e: Deviation x - x_ref, shape (nx,), or many, shape (nx, n).

        Returns:
            The value, shape () or (n,).

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        return self.ellipsoid.value(e)

    @checked(e=reals())
    def contains(self, e: ArrayLike) -> Mask:
        """Return whether e'Pe <= alpha, so that the linear law may take over.

        Args:
            e: Deviation x - x_ref, shape (nx,), or many, shape (nx, n).

        Returns:
            True for deviations inside, shape () or (n,).

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        return self.ellipsoid.contains(e)

    @checked(states=NAMES, controls=NAMES)
    def linear_law(
        self, *, states: Sequence[str] = (), controls: Sequence[str] = ()
    ) -> control.StateSpace:
        """Return the law du = -K e as a system of python-control without states.

        For a plant in deviations from the reference, the closed loop is
        `control.feedback(plant, law, sign=1)`: the law contains its minus sign.
        `control.margin` assumes negative feedback: call it with -law * plant.

        Args:
            states: Names of the states, which are the inputs of the law; if empty, they
                are numbered.
            controls: Names of the controls, which are the outputs of the law; if empty,
                they are numbered.

        Returns:
            The law, sampled with dt if its input is held.

        Example:
            >>> import control, numpy as np
            >>> import swarmstart as ss
            >>> near = ss.TerminalSet(
            ...     K=[[1.0, 2.0]], P=np.eye(2), alpha=1.0, x_ref=[0, 0], u_ref=[0],
            ...     dt=None, design="my own",
            ... )
            >>> law = near.linear_law(states=["x", "v"], controls=["u"])
            >>> cart = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0)
            >>> control.feedback(cart, law, sign=1).poles().real.tolist()
            [-1.0, -1.0]
        """
        import control  # Takes about a second.

        nu, nx = self.K.shape
        for role, given, size in (("states", states, nx), ("controls", controls, nu)):
            if len(given) not in (0, size):
                raise InvalidArgumentError(role, given, f"{size} names, or empty")
        # Its time step 0 means continuous.
        return control.StateSpace(
            [], [], [], -self.K, 0 if self.dt is None else self.dt,
            inputs=list(states) or None, outputs=list(controls) or None,
            name="linear_law",
        )  # fmt: skip


@checked(
    dynamics=of_kind(ca.Function, "a casadi.Function"),
    reference=of_kind(Reference, "a Reference"),
    dt=a_number(),
    kappa=a_number(),
)
def sampled_terminal_set(
    dynamics: ca.Function,
    reference: Reference,
    *,
    dt: float,
    Q: ArrayLike,
    R: ArrayLike,
    kappa: float = 0.0,
) -> TerminalSet:
    """Design the set for an input held over dt, as a receding horizon holds it.

    P solves F'PF = (1 - kappa)(P - Q*) with F = Ad - Bd K and Q* = Q + K'RK, where
    e+ = Ad e + Bd du is the linear system sampled with dt. With kappa = 0, P is the
    Riccati matrix.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        reference: Reference and bounds.
        dt: Time for which the input is held, > 0, s.
        Q: State weight per step, shape (nx, nx), symmetric positive semidefinite.
        R: Input weight per step, shape (nu, nu), symmetric positive definite.
        kappa: Fraction of e'Pe kept in reserve for the nonlinear part, at least 0 and
            below the decrease of the slowest mode in a step.

    Returns:
        K of the discrete Riccati equation, P as above, alpha from the bounds. State
        bounds hold at the samples, not necessarily between them.

    Raises:
        InvalidReserveError: If kappa is negative or too large.
        SwarmstartError: As `linearise`, `hold`, `sampled_lqr` say; NotPositiveError
            also if no bound limits alpha.

    Example:
        A double integrator, |u| <= 1 held for 0.1 s:

        >>> import casadi as ca
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> cart = ca.Function("cart", [x, u], [ca.vertcat(x[1], u)])
        >>> rest = ss.Reference(x_ref=[0, 0], u_ref=[0], u_lower=[-1], u_upper=[1])
        >>> terminal = ss.sampled_terminal_set(
        ...     cart, rest, dt=0.1, Q=np.eye(2), R=np.eye(1)
        ... )
        >>> terminal.K.round(3).tolist(), round(terminal.alpha, 2)
        ([[0.917, 1.636]], 6.67)
    """
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    Ad, Bd = hold(A, B, dt)
    gain = sampled_lqr(Ad, Bd, Q, R)
    K, P, F = gain.K, gain.P, Ad - Bd @ gain.K
    lost = 1 - growth(F, SAMPLED) ** 2
    if not 0 <= kappa < lost:
        raise InvalidReserveError(kappa, lost)
    if kappa:
        Q_star = np.asarray(Q) + K.T @ np.asarray(R) @ K
        # G'PG - P = -Q* with G = F / sqrt(1 - kappa).
        P = sampled_lyapunov(F / np.sqrt(1 - kappa), Q_star)
    return _set_up_to_bounds(K, P, reference, dt)


@checked(
    dynamics=of_kind(ca.Function, "a casadi.Function"),
    reference=of_kind(Reference, "a Reference"),
    kappa=a_number(finite=False, nan=True),
)
def continuous_terminal_set(
    dynamics: ca.Function,
    reference: Reference,
    *,
    Q: ArrayLike,
    R: ArrayLike,
    kappa: float = 0.0,
) -> TerminalSet:
    """Design the set for a continuous input: the chapter's (5.9)-(5.14), corrected.

    P solves (F + kappa I)'P + P(F + kappa I) = -Q* with F = A - B K and
    Q* = Q + K'RK; with kappa = 0 it is the Riccati matrix.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        reference: Reference and bounds.
        Q: State weight, shape (nx, nx), symmetric positive semidefinite.
        R: Input weight, shape (nu, nu), symmetric positive definite.
        kappa: Decay [1/s] kept in reserve for the nonlinear part, at least 0 and below
            the decay of the slowest mode of F. It must be positive if e'Pe is to bound
            the cost to go of the nonlinear system: with 0 the linear part has no
            margin.

    Returns:
        K of the continuous Riccati equation, P as above, alpha from the bounds.

    Raises:
        InvalidReserveError: If kappa is negative or not below the slowest mode's decay.
        SwarmstartError: As `linearise`, `continuous_lqr`, `continuous_lyapunov` say;
            NotPositiveError also if no bound limits alpha.
    """
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    K = continuous_lqr(A, B, Q, R).K
    F = A - B @ K
    decay = -growth(F, CONTINUOUS)
    if not 0 <= kappa < decay:
        raise InvalidReserveError(kappa, decay)
    P = continuous_lyapunov(
        F + kappa * np.eye(len(F)), np.asarray(Q) + K.T @ np.asarray(R) @ K
    )
    return _set_up_to_bounds(K, P, reference, None)


def _set_up_to_bounds(
    K: Array, P: Array, reference: Reference, dt: float | None
) -> TerminalSet:
    """Return the set whose level is the smaller one of input and state bounds."""
    return TerminalSet(
        K=K,
        P=P,
        alpha=min(
            level_from_inputs(K, P, reference.u_max),
            level_from_states(P, reference.e_max),
        ),
        x_ref=reference.x_ref,
        u_ref=reference.u_ref,
        dt=dt,
        design="continuous" if dt is None else "sampled",
    )
