"""Systems whose terminal sets are certified and measured, published and others.

Three of them (the F-8, the jet engine and the magnet) were not used before the proof
was finished. They were measured once, and nothing was changed afterwards.

From `pole` to `centre`, the set is limited by a feature that a search for
counterexamples misses: a pole, the edge of the domain, or a thin region.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.optimize import fsolve

from swarmstart.arrays import Array
from swarmstart.cases.kinds.models.close_formation import Wingman, close_formation
from swarmstart.ocp import right_hand_side
from swarmstart.terminal_set import Reference, TerminalSet, Weights

FREE = 1e3
"""Bounds that no proven set reaches, so that the decrease limits the level."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class System:
    """A system and the design that is certified.

    Attributes:
        dynamics: f(x, u).
        reference: Reference and bounds.
        weights: Of the law.
        dt: Time for which the input is held [s]; None for a continuous input.
        substeps: Number of Runge-Kutta steps in a hold.
        of_cost_to_go: Whether the margin is Q + K'RK, for a bound of the cost to go.
        given: A law and a P in place of a design.
        is_new: Whether it was first looked at after the proof was finished.
    """

    dynamics: ca.Function
    reference: Reference
    weights: Weights
    dt: float | None = None
    substeps: int = 1
    of_cost_to_go: bool = False
    given: TerminalSet | None = None
    is_new: bool = False


def bounded(x_ref: list[float], u_ref: list[float], u_max: list[float]) -> Reference:
    """Return a reference with bounds of the input around it."""
    room = np.array(u_max, dtype=float)
    return Reference(
        x_ref=np.array(x_ref, dtype=float),
        u_ref=np.array(u_ref, dtype=float),
        u_lower=np.array(u_ref) - room,
        u_upper=np.array(u_ref) + room,
    )


def plain(nx: int, nu: int) -> Weights:
    """Return Q = I, R = I."""
    return Weights(Q=np.eye(nx), R=np.eye(nu))


def free(
    xdot: ca.SX, x: ca.SX, u: ca.SX, *, at: Sequence[float] = (), is_new: bool = False
) -> System:
    """Return x' = f(x, u) with Q = I, R = I, and an input whose bounds are far out.

    Args:
        xdot: f(x, u).
        x: The states.
        u: The input.
        at: Reference of states and input; empty: zeros.
        is_new: Whether it was first looked at after the proof was finished.
    """
    nx = x.numel()
    centre = list(at) or [0.0] * (nx + 1)
    return System(
        dynamics=ca.Function("dynamics", [x, u], [xdot]),
        reference=bounded(centre[:nx], centre[nx:], [FREE]),
        weights=plain(nx, 1),
        is_new=is_new,
    )


def chen() -> System:
    """Chen and Allgoewer (1998): kappa 0.95, the paper's margin."""
    x, u, mu = ca.SX.sym("x", 2), ca.SX.sym("u"), 0.5
    xdot = ca.vertcat(
        x[1] + u * (mu + (1 - mu) * x[0]), x[0] + u * (mu - 4 * (1 - mu) * x[1])
    )
    return System(
        dynamics=ca.Function("chen", [x, u], [xdot]),
        reference=bounded([0, 0], [0], [2]),
        weights=Weights(Q=0.5 * np.eye(2), R=np.eye(1), kappa=0.95),
        of_cost_to_go=True,
    )


def van_der_pol() -> System:
    """Reversed in time, no input: the region of attraction's usual test."""
    x = ca.SX.sym("x", 2)
    xdot = ca.vertcat(-x[1], x[0] - (1 - x[0] ** 2) * x[1])
    P = np.array([[1.5, -0.5], [-0.5, 1.0]])
    return autonomous(xdot, x, room=FREE, P=P)


def pendulum(dt: float | None = None) -> System:
    """Upright, g / l = 9.81."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)
    return replace(free(xdot, x, u), dt=dt)


def reactor() -> System:
    """Stirred tank at its unstable point, 350 K: Henson and Seborg (1997)."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rate = 7.2e10 * ca.exp(-8750 / x[1]) * x[0]
    heat = 5e4 / (1000 * 0.239)
    xdot = ca.vertcat(
        (1 - x[0]) - rate,
        (350 - x[1]) + heat * rate + 5e4 / (100 * 1000 * 0.239) * (u - x[1]),
    )
    f = ca.Function("reactor", [x, u], [xdot])
    c, coolant = fsolve(
        lambda v: np.array(f([v[0], 350.0], v[1])).ravel(), [0.5, 300.0], xtol=1e-12
    )
    return System(
        dynamics=f,
        reference=bounded([c, 350.0], [coolant], [FREE]),
        weights=Weights(Q=np.diag([1.0, 1e-4]), R=1e-4 * np.eye(1)),
    )


def unicycle(weight: float, *, speed: float, dt: float | None, tight: bool) -> System:
    """A wingman behind a leader on a straight course: the chapter's formation."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    xdot = ca.vertcat(u, x[0] * ca.cos(x[1]), x[0] * ca.sin(x[1]))
    u_max = [5.0, np.pi / 18] if tight else [FREE, FREE]
    return System(
        dynamics=ca.Function("unicycle", [x, u], [xdot]),
        reference=replace(
            bounded([speed, 0, 0, 0], [0, 0], u_max),
            velocity=np.array([0, 0, speed, 0], dtype=float),
        ),
        weights=Weights(Q=np.eye(4), R=np.diag([1.0, weight])),
        dt=dt,
        substeps=1 if tight else 4,
    )


def wingman(*, height_of_first_order: bool) -> System:
    """Close formation (5.20) with exact kinematics, 200 ft/s; 5 or 6 states."""
    model = close_formation(Wingman(), kinematics="exact", heading_from="leader")
    nx = 5 if height_of_first_order else 6
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", 3)
    whole = ca.vertcat(x, 0) if height_of_first_order else x
    xdot = right_hand_side(model)(whole, u, ca.DM([200, 0, 0]))
    if height_of_first_order:
        xdot = ca.vertcat(xdot[:4], (u[2] - x[4]) / Wingman().height_lag_b_s)
    slot = Wingman().slot_ft
    return System(
        dynamics=ca.Function("wingman", [x, u], [xdot]),
        reference=bounded(
            [slot[0], slot[1], 0, 200, 0, 0][:nx], [200, 0, 0], [FREE] * 3
        ),
        weights=Weights(
            Q=np.diag([0.01, 0.01, 10, 0.01, 0.01, 0.01][:nx]),
            R=np.diag([0.01, 10, 0.01]),
        ),
    )


def cart_and_pole() -> System:
    """A pole of 1 m and 0.1 kg on a cart of 1 kg: Barto, Sutton and Anderson (1983)."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    _, angle, speed, turning = ca.vertsplit(x)
    cart, pole, half, g = 1.0, 0.1, 0.5, 9.81
    sine, cosine, total = ca.sin(angle), ca.cos(angle), cart + pole
    pushed = (u + pole * half * turning**2 * sine) / total
    turned = (g * sine - cosine * pushed) / (half * (4 / 3 - pole * cosine**2 / total))
    moved = pushed - pole * half * turned * cosine / total
    return free(ca.vertcat(speed, turning, moved, turned), x, u)


def rotating_actuator() -> System:
    """Translation damped by a rotating actuator: Bupp, Bernstein and Coppola (1998)."""
    x, u, coupling = ca.SX.sym("x", 4), ca.SX.sym("u"), 0.1
    sine, cosine = ca.sin(x[2]), ca.cos(x[2])
    swing = x[0] - coupling * x[3] ** 2 * sine
    total = 1 - coupling**2 * cosine**2
    xdot = ca.vertcat(
        x[1],
        (-swing - coupling * cosine * u) / total,
        x[3],
        (coupling * cosine * swing + u) / total,
    )
    return free(xdot, x, u)


def ball_on_beam() -> System:
    """Hauser, Sastry and Kokotovic (1992); the beam's acceleration is the input."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    rolled = 0.7143 * (x[0] * x[3] ** 2 - 9.81 * ca.sin(x[2]))
    return free(ca.vertcat(x[1], rolled, x[3], u), x, u)


def crusader() -> System:
    """Longitudinal motion of an F-8: Garrard and Jordan (1977)."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    a, _, q = ca.vertsplit(x)
    xdot = ca.vertcat(
        -0.877 * a + q - 0.088 * a * q + 0.47 * a**2 - 0.019 * x[1] ** 2
        - a**2 * q + 3.846 * a**3
        - 0.215 * u + 0.28 * a**2 * u + 0.47 * a * u**2 + 0.63 * u**3,
        q,
        -4.208 * a - 0.396 * q - 0.47 * a**2 - 3.564 * a**3
        - 20.967 * u + 6.265 * a**2 * u + 46 * a * u**2 + 61.4 * u**3,
    )  # fmt: skip
    return free(xdot, x, u, is_new=True)


def jet_engine() -> System:
    """Moore and Greitzer's compressor without stall: Krstic and Kokotovic (1995)."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(-x[1] - 1.5 * x[0] ** 2 - 0.5 * x[0] ** 3, u)
    return free(xdot, x, u, is_new=True)


def magnet() -> System:
    """A ball held by a magnet, without units: gap, speed, current; input: voltage."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    xdot = ca.vertcat(x[1], 1 - (x[2] / x[0]) ** 2, u - x[2])
    return free(xdot, x, u, at=(1, 0, 1, 1), is_new=True)


def autonomous(xdot: ca.SX, x: ca.SX, *, room: float, P: Array | None = None) -> System:
    """Return x' = f(x), bounds far out: it is f that ends the set; P None: I."""
    nx, u = x.numel(), ca.SX.sym("u")
    x_ref = np.zeros(nx)
    own = TerminalSet(
        K=np.zeros((1, nx)), P=np.eye(nx) if P is None else P, alpha=1.0, x_ref=x_ref,
        u_ref=np.zeros(1), dt=None, design="given",
    )  # fmt: skip
    return System(
        dynamics=ca.Function("autonomous", [x, u], [xdot + 0 * u]),
        reference=Reference(
            x_ref=x_ref,
            u_ref=np.zeros(1),
            u_lower=-np.ones(1),
            u_upper=np.ones(1),
            x_lower=np.full(nx, -room),
            x_upper=np.full(nx, room),
        ),
        weights=plain(nx, 1),
        given=own,
    )


def spiral(rate: Callable[[ca.SX], ca.SX], *, room: float = 8.0) -> System:
    """Return a spiral whose radius r grows by rate(r^2) r a second."""
    x = ca.SX.sym("x", 2)
    g = rate(ca.sumsqr(x))
    return autonomous(ca.vertcat(g * x[0] - x[1], g * x[1] + x[0]), x, room=room)


def pole() -> System:
    """A system with a division by 1 + x0: at x0 = -1 the sign of the damping jumps."""
    x = ca.SX.sym("x", 2)
    xdot = ca.vertcat(x[1] - x[0], -x[0] - x[1] / (1 + x[0]))
    return autonomous(xdot, x, room=30.0)


def tank() -> System:
    """A tank that runs empty at x = -1: the root of less is not defined."""
    x = ca.SX.sym("x")
    return autonomous(0.5 - 0.5 * ca.sqrt(x + 1) - 0.3 * x, x, room=5.5)


def jump() -> System:
    """Within 1e-6 of r = 1 the decay turns into growth."""
    return spiral(lambda square: ca.tanh((square - 1) / 1e-6))


def bump() -> System:
    """Decay everywhere but within 1e-3 of r = 1."""
    return spiral(lambda square: 1.5 * ca.exp(-(((square - 1) / 1e-3) ** 2)) - 1)


def centre() -> System:
    """Nearly a centre: damped by 1e-6 within r = 1, undamped outside."""
    return spiral(lambda square: -1e-6 * (1 - square))


SYSTEMS: dict[str, Callable[[], System]] = {
    "Chen and Allgoewer, Q_m = Q*": chen,
    "van der Pol, reversed": van_der_pol,
    "pendulum": pendulum,
    "pendulum, held 0.1 s": lambda: pendulum(0.1),
    "stirred tank, 350 K": reactor,
    "unicycle, 15 m/s": lambda: unicycle(1, speed=15, dt=None, tight=False),
    "formation, R = I, bounds": lambda: unicycle(1, speed=15, dt=1.0, tight=True),
    "formation, R = diag(1, 100), bounds": lambda: unicycle(
        100, speed=15, dt=1.0, tight=True
    ),
    "formation, R = diag(1, 1000), bounds": lambda: unicycle(
        1000, speed=15, dt=1.0, tight=True
    ),
    "formation, R = I, no bounds": lambda: unicycle(1, speed=15, dt=1.0, tight=False),
    "cart and pole": cart_and_pole,
    "rotating actuator": rotating_actuator,
    "ball on a beam": ball_on_beam,
    "F-8": crusader,
    "jet engine": jet_engine,
    "ball and magnet": magnet,
    "pole of the damping": pole,
    "tank": tank,
    "thin jump": jump,
    "thin bump": bump,
    "nearly a centre": centre,
    "close formation, 5 states": lambda: wingman(height_of_first_order=True),
    "close formation, 6 states": lambda: wingman(height_of_first_order=False),
}
