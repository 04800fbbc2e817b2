"""Terminal set of a problem, in which a linear law may replace planning."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.model import right_hand_side
from swarmstart.terminal_set import (
    ProofOptions,
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
)
from swarmstart.terminal_set.proving import resting


def terminal_set_of(
    problem: OptimalControlProblem,
    *,
    at: ArrayLike,
    weights: Weights,
    parameters: ArrayLike = (),
    options: ProofOptions | None = None,
    rng: np.random.Generator,
) -> TerminalSet:
    """Design a linear law for a problem at a reference, and certify its terminal set.

    Dynamics, bounds of controls and states, and dt are those of the problem. Inputs are
    held over its control intervals. They are integrated in as many steps as the problem
    takes, unless `options` says otherwise. The input at the reference is the one within
    the bounds that keeps the reference at rest; if there are several, one near the
    middle of the bounds. Costs and other constraints are ignored: the user must check
    any constraint that cuts the set.

    Args:
        problem: The problem.
        at: Reference state, shape (nx,), SI units.
        weights: Weights Q and R per step, and kappa.
        parameters: Values of the model's parameters, shape (np,).
        options: Options of the proof; None: any decrease.
        rng: Source of the samples and of the rays that look for counterexamples.

    Returns:
        K, P, the largest level that was proven, and the certificate.

    Raises:
        InvalidProblemError: If a shape is not the problem's.
        NotAnEquilibriumError: If no input keeps the reference at rest.
        SwarmstartError: As in `certified_terminal_set`.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        ...     intervals=4, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> weights = ss.Weights(Q=np.eye(2), R=np.eye(1))
        >>> found = ss.terminal_set_of(
        ...     problem, at=[0, 0], weights=weights, rng=np.random.default_rng(0)
        ... )
        >>> found.K.shape, found.alpha > 0
        ((1, 2), True)
    """
    model = problem.model
    x_ref = _vector("at", at, model.nx)
    p = _vector("parameters", parameters, model.np)
    rate = right_hand_side(model)
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    dynamics = ca.Function("dynamics", [x, u], [rate(x, u, p)], ["x", "u"], ["xdot"])
    lower, upper = problem.control_limits
    x_lower, x_upper = problem.state_limits
    is_bounded = np.isfinite(x_lower) | np.isfinite(x_upper)
    rows = resting(dynamics, is_bounded=is_bounded)
    reference = Reference(
        x_ref=x_ref,
        u_ref=_resting_input(dynamics, x_ref, rows, (lower, upper)),
        u_lower=lower,
        u_upper=upper,
        x_lower=x_lower,
        x_upper=x_upper,
    )
    steps = problem.checks * problem.substeps
    return certified_terminal_set(
        dynamics,
        reference,
        weights,
        dt=problem.dt,
        options=ProofOptions(substeps=steps) if options is None else options,
        rng=rng,
    )


def _vector(name: str, values: ArrayLike, size: int) -> Array:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise InvalidProblemError(
            f"{name} must be {size} finite numbers, got {np.asarray(values).tolist()}"
        )
    return vector


def _resting_input(
    dynamics: ca.Function,
    x_ref: Array,
    rows: NDArray[np.bool_],
    limits: tuple[Array, Array],
) -> Array:
    """Return the input that keeps the given states at rest, or nearly so."""
    lower, upper = limits
    middle = np.where(np.isfinite(lower + upper), (lower + upper) / 2, 0.0)
    start = np.clip(middle, lower, upper)
    slopes = dynamics.factory("slopes", ["x", "u"], ["jac:xdot:u"])

    def rates(u: Array) -> Array:
        return np.array(dynamics(x_ref, u)).ravel()[rows]

    found = least_squares(
        rates,
        start,
        jac=lambda u: np.array(slopes(x_ref, u))[rows],
        bounds=(lower, upper),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    return np.asarray(found.x, dtype=np.float64)
