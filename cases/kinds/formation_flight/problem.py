"""The planning problem of one UAV of a formation flight, and its terminal set.

With e = x - x_L - slot for the states x = (v, psi, x, y) of the UAV and x_L of the
leader, in axes that do not turn (5.4), the controls u, and steps k of the length dt,

    minimise  J = sum_k dt (e_k'Q e_k + u_k'R u_k) + e_N'P e_N            (5.5)-(5.7)

with the distances to obstacles and to the UAVs that planned before as constraints
(5.15), (5.16). The sampled-data P belongs to this sum over the steps. Numbers such as
(5.4) are equations of the chapter (docs/chapter).

A terminal set with which the linear law of the dual mode takes over is certified first:
its level is the largest one within the bounds for which the decrease is proven, for
inputs held over a control step.

The set as the chapter prints it has errata, and is kept for measurements:

    (5.12)  FP + PF' = -Q
    (5.14)  alpha K'PK <= u_max^2

with the gain K and the loop e' = F e. The first is the Lyapunov equation of the
transposed loop: the ellipsoid of its solution need not be invariant for the loop
itself. The two sides of the second have different shapes. If the left one is read as
alpha K P K', the shapes agree, but P stands in the place of its inverse, and no input
is bounded. `terminal_set.input_excess` returns the excess over the bounds. The correct
formulas are in the docstrings of the modules `matrix_equations.py` and `ellipsoid.py`
in `terminal_set/linear`.
"""

from dataclasses import fields
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.format.parts import bounds_of
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import METRE, POSITION, speed_bounds, unicycle
from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    Separation,
    disc,
    right_hand_side,
)
from swarmstart.terminal_set import (
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
    continuous_lqr,
    continuous_lyapunov,
    hold,
    linearise,
    sampled_lqr,
    sampled_terminal_set,
)
from swarmstart.terminal_set.linear import bound_array, finite_array, positive_definite

SEED = 0
"""Seed of the samples for a certificate's margins: a set is the same in every run."""


def planning_problem(
    scenario: FormationScenario, model: Model, terminal_cost: Array, *, others: int
) -> OptimalControlProblem:
    """Return the planning problem of a UAV.

    Its signals are the states of the UAV's slot, then the position of each of the
    `others`, the UAVs that have planned before.
    """
    signals = ca.vertcat(ca.SX.sym("slot", 4), ca.SX.sym("others", 2 * others))
    # Its own slot, then two rows for each UAV that has planned before it.
    error = model.states - signals[:4]
    position = model.states[list(POSITION)]
    avoid = scenario.avoidance
    separations = [
        Separation(
            relative=position - signals[4 + 2 * j : 6 + 2 * j],
            distance=avoid.safe_distance_m,
            margin=avoid.distance_margin_m,
            smooth_margin=avoid.polish_distance_margin_m,
            along=avoid.along,
            measure=avoid.measure,
            scale=METRE,
        )
        for j in range(others)
    ]
    obstacles = [
        disc(
            position,
            centre=[obstacle.x_m, obstacle.y_m],
            radius=obstacle.radius_m,
            margin=avoid.obstacle_margin_m,
            smooth_margin=avoid.polish_obstacle_margin_m,
            along=avoid.along,
            measure=avoid.measure,
            scale=METRE,
        )
        for obstacle in scenario.obstacles
    ]
    Q, R = ca.diag(scenario.weights.Q), ca.diag(scenario.weights.R)
    return OptimalControlProblem(
        model,
        stage_cost=ca.bilin(Q, error, error)
        + ca.bilin(R, model.controls, model.controls),
        terminal_cost=ca.bilin(ca.DM(terminal_cost), error, error),
        bounds=Bounds(
            controls=_control_limits(scenario),
            states=speed_bounds(scenario.vehicle.speed_m_s),
            state_scale=METRE,
        ),
        constraints=[*obstacles, *separations],
        signals=signals,
        quadrature="left",  # e_k at the beginnings of the steps, as in (5.5).
        **scenario.prediction.grid(),
    )


def slot_states(scenario: FormationScenario, number: int, times: Array) -> Array:
    """Return the states of a UAV's slot, which moves with the leader, shape (4, n).

    Args:
        scenario: The scenario; its leader keeps speed and heading.
        number: The UAV's index from 0.
        times: Times since the start, shape (n,) [s].
    """
    leader, slot = scenario.leader, scenario.uavs[number].slot
    along, across = leader.velocity()
    return np.stack(
        [
            np.full_like(times, leader.speed_m_s),
            np.full_like(times, leader.heading_rad),
            leader.x_m + slot.x_m + along * times,
            leader.y_m + slot.y_m + across * times,
        ]
    )


def dynamics_of(model: Model) -> ca.Function:
    """Return f(x, u) without parameters, as terminal_set needs it."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    return ca.Function("dynamics", [x, u], [right_hand_side(model)(x, u, ca.SX(0, 1))])


def reference_of(scenario: FormationScenario) -> Reference:
    """Return the leader's motion as the reference of a terminal set."""
    lower, upper = _control_limits(scenario)
    # Without limits of the speed the set is bounded by the inputs alone.
    x_lower, x_upper = speed_bounds(scenario.vehicle.speed_m_s) or (None, None)
    return Reference(
        x_ref=np.array(scenario.leader.vector()),
        u_ref=np.zeros(len(lower)),
        u_lower=lower,
        u_upper=upper,
        x_lower=x_lower,
        x_upper=x_upper,
        velocity=np.array([0.0, 0.0, *scenario.leader.velocity()]),
    )


def terminal_cost_of(
    scenario: FormationScenario, dynamics: ca.Function, reference: Reference
) -> Array:
    """Return P of the terminal cost, shape (4, 4)."""
    if scenario.terminal_cost.design == "given":
        return np.array(scenario.terminal_cost.P)
    dt, weights = scenario.prediction.dt, scenario.weights
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    # Times dt, as in J: P then is the cost-to-go of the same sum.
    Q, R = np.diag(weights.Q) * dt, np.diag(weights.R) * dt
    return sampled_lqr(*hold(A, B, dt), Q, R).P


def _control_limits(scenario: FormationScenario) -> tuple[Array, Array]:
    vehicle = scenario.vehicle
    return bounds_of((vehicle.acceleration_m_s2, vehicle.turn_rate_rad_s))


def terminal_set_of(scenario: FormationScenario, reference: Reference) -> TerminalSet:
    """Return the terminal set of the dual mode, certified if the scenario says so.

    Args:
        scenario: The scenario.
        reference: The leader's motion and the bounds.

    Raises:
        SwarmstartError: If the law cannot be designed, or its set cannot be proven.
    """
    dual = scenario.dual_mode
    dt = scenario.prediction.dt
    if dual.is_certified:
        # Tuples, since a cache needs keys that can be hashed.
        return _certified(_entries(reference), tuple(dual.Q), tuple(dual.R), dt)
    dynamics, Q, R = dynamics_of(unicycle()), np.diag(dual.Q), np.diag(dual.R)
    if dual.design == "literal":
        P = np.array(dual.P)
        return terminal_set_as_printed(dynamics, reference, Q=Q, R=R, P=P)
    return sampled_terminal_set(dynamics, reference, dt=dt, Q=Q, R=R)


@cache
def _certified(
    entries: tuple[tuple[str, tuple[float, ...]], ...],
    Q: tuple[float, ...],
    R: tuple[float, ...],
    dt: float,
) -> TerminalSet:
    """Return the certified set, computed once for all flights of a process.

    Args:
        entries: Entries of the reference: name -> numbers.
        Q: Diagonal of the state weight.
        R: Diagonal of the input weight.
        dt: Time for which inputs are held [s].
    """
    reference = Reference(**{name: np.array(values) for name, values in entries})
    return certified_terminal_set(
        dynamics_of(unicycle()),
        reference,
        Weights(Q=np.diag(Q), R=np.diag(R)),
        dt=dt,
        rng=np.random.default_rng(SEED),
    )


def _entries(reference: Reference) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Return a reference in a form that can be a key."""
    values = ((each.name, getattr(reference, each.name)) for each in fields(reference))
    return tuple((name, tuple(v.tolist())) for name, v in values if v is not None)


def lyapunov_as_printed(F: ArrayLike, Q: ArrayLike) -> Array:
    """Solve FP + PF' = -Q, the chapter's (5.12) as printed.

    Args:
        F: Stable loop e' = F e, shape (nx, nx), 1/s.
        Q: The chapter's Q*, shape (nx, nx), symmetric positive semidefinite.

    Returns:
        P, shape (nx, nx), symmetric positive definite, read-only.

    Raises:
        SwarmstartError: As in `continuous_lyapunov`.
    """
    # That solves F'P + PF = -Q; with F transposed it is (5.12) as printed.
    return continuous_lyapunov(np.transpose(F), Q)


def level_as_printed(K: ArrayLike, P: ArrayLike, u_max: ArrayLike) -> float:
    """Compute the level of the chapter's (5.14) as printed.

    Args:
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        u_max: Largest deviation of each input from its reference, shape (nu,), > 0.

    Returns:
        alpha = min_i u_max_i^2 / (K_i P K_i').

    Raises:
        SwarmstartError: If sizes do not agree, a number is not finite, or P is not
            positive definite.
    """
    P = positive_definite("P", P)
    K = finite_array("K", K, (None, len(P)))
    room = bound_array("u_max", u_max, (len(K),))
    # P where the correct level has its inverse.
    return float(np.min(room**2 / np.einsum("ij,jk,ik->i", K, P, K)))


def terminal_set_as_printed(
    dynamics: ca.Function,
    reference: Reference,
    *,
    Q: ArrayLike,
    R: ArrayLike,
    P: ArrayLike,
) -> TerminalSet:
    """Design the terminal set as the chapter prints it.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        reference: Reference and bounds; (5.14) uses those of the input only.
        Q: State weight, shape (nx, nx), symmetric positive semidefinite.
        R: Input weight, shape (nu, nu), symmetric positive definite.
        P: The matrix printed in section 5.2.4, or that of `lyapunov_as_printed`, shape
            (nx, nx), symmetric positive definite.

    Returns:
        K of the continuous Riccati equation, P as given, alpha of (5.14) as printed.
        In this set the linear law can exceed the input bounds. It can also be unstable
        if the control is held over a step (`held_spectral_radius`).

    Raises:
        SwarmstartError: As in `linearise`, `continuous_lqr` and `level_as_printed`.
    """
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    K = continuous_lqr(A, B, Q, R).K
    return TerminalSet(
        K=K,
        P=finite_array("P", P, A.shape),
        alpha=level_as_printed(K, P, reference.u_max),
        x_ref=reference.x_ref,
        u_ref=reference.u_ref,
        dt=None,  # Designed in continuous time.
        design="literal",
    )
