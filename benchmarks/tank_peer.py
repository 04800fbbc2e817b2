"""do-mpc on the stirred tank, as a controller of ours; it need not be installed.

Source: Lucia et al. (2017), Rapid development of modular and sustainable nonlinear
model predictive control solutions.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.tank import (
    BEFORE,
    CONTROL_LIMITS,
    CONTROLS,
    HOTTEST,
    HOUR,
    INTERVAL,
    INTERVALS,
    START,
    STATE_LIMITS,
    STATES,
    UNITS,
    WANTED,
    WEIGHTS,
    rates,
)
from swarmstart.ocp import Decision


@dataclass(frozen=True, slots=True, eq=False)
class PeerController:
    """do-mpc as a controller of ours.

    Attributes:
        mpc: Its controller, set up.
        dt: Length of a control interval [s].
    """

    mpc: Any
    dt: float = INTERVAL * HOUR

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return what do-mpc decides; see Controller."""
        del time, previous, rng
        control = self.mpc.make_step(state[:, None])
        return Decision(control=np.array(control).ravel(), plans=())


def has_peer() -> bool:
    """Return whether do-mpc is installed."""
    return find_spec("do_mpc") is not None


def peer(plants: Sequence[tuple[float, float]]) -> PeerController:
    """Return do-mpc with the settings of its documentation.

    Args:
        plants: The values of (alpha, beta) that it knows: one, or all combinations, of
            which it makes a tree of scenarios that branches once.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # About extras of it that are not installed.
        import do_mpc  # noqa: PLC0415 - it need not be installed
    model = do_mpc.model.Model("continuous", "SX")
    x, u, p = (
        [model.set_variable(kind, name) for name in names]
        for kind, names in (
            ("_x", STATES), ("_u", CONTROLS), ("_p", ("alpha", "beta")),
        )
    )  # fmt: skip
    for name, rate in zip(STATES, rates(x, u, p), strict=True):
        model.set_rhs(name, rate)
    model.setup()
    mpc = do_mpc.controller.MPC(model)
    mpc.set_param(
        n_horizon=INTERVALS,
        n_robust=int(len(plants) > 1),
        t_step=INTERVAL,
        state_discretization="collocation",
        collocation_type="radau",
        collocation_deg=2,
        collocation_ni=1,
        store_full_solution=True,
        nlpsol_opts={"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0},
    )
    mpc.scaling["_x", "T_R"] = mpc.scaling["_x", "T_K"] = 100
    for name, unit in zip(CONTROLS, UNITS, strict=True):
        mpc.scaling["_u", name] = unit
    off = (model.x["C_b"] - WANTED) ** 2
    mpc.set_objective(mterm=off, lterm=off)
    mpc.set_rterm(**dict(zip(CONTROLS, WEIGHTS, strict=True)))
    for kind, names, limits in (
        ("_x", STATES, STATE_LIMITS),
        ("_u", CONTROLS, CONTROL_LIMITS),
    ):
        for side, numbers in zip(("lower", "upper"), limits, strict=True):
            for name, number in zip(names, numbers, strict=True):
                if (side, name) != ("upper", "T_R"):
                    mpc.bounds[side, kind, name] = number
    mpc.set_nl_cons(
        "T_R", model.x["T_R"], ub=HOTTEST, soft_constraint=True, penalty_term_cons=1e2
    )
    alpha, beta = (np.array(list(dict.fromkeys(v))) for v in zip(*plants, strict=True))
    mpc.set_uncertainty_values(alpha=alpha, beta=beta)
    mpc.setup()
    mpc.x0, mpc.u0 = START, BEFORE
    mpc.set_initial_guess()
    return PeerController(mpc)
