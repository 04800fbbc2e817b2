"""A control step of receding horizon, against plain CasADi with IPOPT, fatrop, do-mpc.

    python benchmarks/mpc_step.py [--write docs/measured/mpc_step.md] [--steps 30]

Seconds are CPU time of the process. The controllers decide in turns at each step, each
on its own plant. do-mpc is left out if it is not installed.
"""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.lanes import Posed
from swarmstart.benchmarks.polish import crane, planar_quadrotor, quadrotor
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.ocp import (
    Decision,
    IpoptOptions,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
)

OURS, IPOPT, FATROP, DO_MPC = "swarmstart", "IPOPT", "fatrop", "do-mpc"
PLANTS = (planar_quadrotor, crane, quadrotor)
TEXT = """# A control step

Made by `python benchmarks/mpc_step.py --write docs/measured/mpc_step.md`: three plants
in closed loop, 30 steps. swarmstart is `RecedingHorizon` with its polish by IPOPT and
no search. The others are what a user writes with CasADi: the same direct multiple
shooting with the same Runge-Kutta steps, expanded to scalar operations; IPOPT started
from the shifted last answer with its multipliers (`warm_start_init_point`, `mu_init`
1e-4), and fatrop with the structure of the stages. do-mpc (5.1) has the same steps as a
discrete model, and the settings of its documentation. All controllers decide in turns,
each on its own plant. Times are CPU times; the first step, which is cold, is shown
apart. A step of swarmstart also integrates and judges its answer, and falls back on the
last plan if that is better. "Cost" is the integral of the stage cost.

"""
Controls = Callable[[Array], Array]


class PlainNlp:
    """Direct multiple shooting as a user writes it, stage after stage.

    Attributes:
        nlp: "x", "p" (the initial state), "f", "g", as nlpsol takes them.
        bounds: "lbx", "ubx", "lbg", "ubg".
        is_equal: For each row whether it is an equality.
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        """State the NLP of a problem with a fixed start and horizon."""
        step, model = _step(problem), problem.model
        path, path_limits = _rows(model.states, problem.stated)
        end, end_limits = _rows(model.states, problem.terminal_constraints)
        terminal = ca.Function("terminal", [model.states], [problem.terminal_cost])
        start, x = ca.MX.sym("start", model.nx), ca.MX.sym("x_0", model.nx)
        free, none = np.full(model.nx, np.inf), (np.zeros(1), np.zeros(1))
        w, cost, self._rows = [x], ca.MX(0), list[tuple[ca.MX, Array, Array]]()
        for k in range(problem.intervals):
            u = ca.MX.sym(f"u_{k}", model.nu)
            following = ca.MX.sym(f"x_{k + 1}", model.nx)
            after, spent = step(x, u)
            self._add(following - after, none)
            # The start is known, so its path constraints are no rows.
            self._add(*((x - start, none) if k == 0 else (path(x), path_limits)))
            w += [u, following]
            cost, x = cost + spent, following
        self._add(path(x), path_limits)
        self._add(end(x), end_limits)
        rows, lower, upper = zip(*self._rows, strict=True)
        self.nlp = {
            "x": ca.vertcat(*w), "p": start, "f": cost + terminal(x),
            "g": ca.vertcat(*rows),
        }  # fmt: skip
        lbx, ubx = (
            np.concatenate([sign * free, *[[*limit, *sign * free]] * problem.intervals])
            for sign, limit in zip((-1, 1), problem.control_limits, strict=True)
        )
        lbg, ubg = np.concatenate(lower), np.concatenate(upper)
        self.bounds = {"lbx": lbx, "ubx": ubx, "lbg": lbg, "ubg": ubg}
        self.is_equal = [bool(one) for one in lbg == ubg]

    def _add(self, values: ca.MX, limits: tuple[Array, Array]) -> None:
        both = (np.broadcast_to(one, values.numel()) for one in limits)
        self._rows.append((values, *both))  # type: ignore[arg-type]


def _rows(x: ca.SX, constraints: Sequence[Any]) -> tuple[ca.Function, tuple[Any, Any]]:
    """Return x -> rows of constraints, with their limits."""
    rows = [c.rows(c.expression) for c in constraints]
    values = ca.Function("rows", [x], [ca.vertcat(*[one.values for one in rows])])
    lower, upper = (
        np.concatenate([np.zeros(0), *[getattr(one, side) for one in rows]])
        for side in ("lower", "upper")
    )
    return values, (lower, upper)


# Expanded, CasADi's derivatives are two to three times as fast here.
QUIET: dict[str, Any] = {
    "print_time": False, "error_on_fail": False, "calc_lam_p": False,
    "expand": True, "show_eval_warnings": False,
}  # fmt: skip
QUIET_IPOPT: dict[str, Any] = {**QUIET, "ipopt.print_level": 0, "ipopt.sb": "yes"}


def cold_ipopt(plain: PlainNlp) -> ca.Function:
    """Return IPOPT with its defaults."""
    return ca.nlpsol("cold", "ipopt", plain.nlp, QUIET_IPOPT)


def warm_ipopt(plain: PlainNlp) -> ca.Function:
    """Return IPOPT that stays near its start."""
    warm: dict[str, Any] = {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-4}
    for name in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac",
                 "mult_bound_push"):  # fmt: skip
        warm[f"ipopt.warm_start_{name}"] = 1e-6
    return ca.nlpsol("warm", "ipopt", plain.nlp, {**QUIET_IPOPT, **warm})


def solvers(plain: PlainNlp, plugin: str) -> tuple[ca.Function, ca.Function]:
    """Return a solver for the first step, and one for later steps."""
    if plugin == FATROP:
        options: dict[str, Any] = {
            **QUIET, "fatrop.print_level": 0, "structure_detection": "auto",
            "equality": plain.is_equal,
        }  # fmt: skip
        one = ca.nlpsol("plain", "fatrop", plain.nlp, options)
        return one, one
    return cold_ipopt(plain), warm_ipopt(plain)


def by_casadi(problem: OptimalControlProblem, plugin: str) -> Controls:
    """Return state -> first controls, by CasADi alone."""
    nlp, (nx, nu) = PlainNlp(problem), (problem.model.nx, problem.model.nu)
    cold, warm = solvers(nlp, plugin)
    last: dict[str, ca.DM] = {}

    def decide(state: Array) -> Array:
        if last:
            before = np.array(last["x"]).ravel()
            start = np.concatenate([before[nx + nu :], before[-nx - nu :]])
            start[:nx] = state
            found = warm(
                x0=start, p=state, lam_g0=last["lam_g"], lam_x0=last["lam_x"],
                **nlp.bounds,
            )  # fmt: skip
        else:
            still = np.tile(np.r_[state, np.zeros(nu)], problem.intervals)
            found = cold(x0=np.r_[still, state], p=state, **nlp.bounds)
        last.update(x=found["x"], lam_g=found["lam_g"], lam_x=found["lam_x"])
        return np.array(found["x"]).ravel()[nx : nx + nu]

    return decide


def by_do_mpc(problem: OptimalControlProblem) -> Controls:
    """Return state -> controls, by do-mpc; a fixed end is a bound of its states."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # About extras of it that are not installed.
        import do_mpc  # noqa: PLC0415 - it need not be installed
    stated = problem.model
    model = do_mpc.model.Model("discrete", "SX")
    x = model.set_variable("_x", "x", shape=(stated.nx, 1))
    u = model.set_variable("_u", "u", shape=(stated.nu, 1))
    step = _step(problem)
    model.set_rhs("x", step(x, u)[0])
    model.setup()
    x, u = model.x["x"], model.u["u"]  # Others than before.
    mpc = do_mpc.controller.MPC(model)
    mpc.set_param(
        n_horizon=problem.intervals,
        t_step=problem.dt,
        store_full_solution=False,
        nlpsol_opts={"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0},
    )
    terminal = ca.Function("terminal", [stated.states], [problem.terminal_cost])
    mpc.set_objective(mterm=terminal(x), lterm=step(x, u)[1])
    mpc.set_rterm(u=0.0)
    for side, limit in zip(("lower", "upper"), problem.control_limits, strict=True):
        mpc.bounds[side, "_u", "u"] = limit
    path, (_, upper) = _rows(stated.states, problem.stated)
    if path.numel_out(0):  # All of them have upper limits only.
        mpc.set_nl_cons("path", path(x), ub=upper)
    end, limits = _rows(stated.states, problem.terminal_constraints)
    if end.numel_out(0):  # The states themselves, but for a constant.
        at_zero = np.array(end(np.zeros(stated.nx))).ravel()
        for side, limit in zip(("lower", "upper"), limits, strict=True):
            mpc.terminal_bounds[side, "x"] = limit - at_zero
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mpc.setup()

    def decide(state: Array) -> Array:
        if not mpc.t0:
            mpc.x0 = state
            mpc.set_initial_guess()
        return np.array(mpc.make_step(state[:, None])).ravel()

    return decide


def _step(problem: OptimalControlProblem) -> ca.Function:
    """Return (x, u) -> (x, cost) after an interval of classical Runge-Kutta steps."""
    model, h = problem.model, problem.dt / problem.substeps
    rate = ca.Function("rate", [model.states, model.controls],
                       [ca.vertcat(model.ode, problem.stage_cost)])  # fmt: skip
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    begin = ca.Function("begin", [model.states, model.controls], [problem.step_cost])
    y = ca.vertcat(x, begin(x, u))
    for _ in range(problem.substeps):
        k1 = rate(y[:-1], u)
        k2 = rate((y + h / 2 * k1)[:-1], u)
        k3 = rate((y + h / 2 * k2)[:-1], u)
        k4 = rate((y + h * k3)[:-1], u)
        y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [x, u], ca.cse([y[:-1], y[-1]]))


def ours(problem: OptimalControlProblem) -> Controls:
    """Return state -> first controls, by RecedingHorizon."""
    planner = Planner(problem, search=None, polish=IpoptOptions())
    planner.prepare()  # As the others are.
    controller, rng = RecedingHorizon(planner=planner), np.random.default_rng(0)
    so_far = list[Decision]()

    def decide(state: Array) -> Array:
        time_now = len(so_far) * controller.dt
        last = so_far[-1] if so_far else None
        so_far.append(controller.decide(time_now, state, last, rng=rng))
        return so_far[-1].control

    return decide


def flown(posed: Posed, steps: int) -> Mapping[str, tuple[Array, float]]:
    """Return the seconds of each step, and the cost, of each controller."""
    problem = posed.problem
    contestants = {OURS: ours(problem)}
    contestants |= {name: by_casadi(problem, name) for name in (IPOPT, FATROP)}
    if find_spec("do_mpc") is not None:
        contestants[DO_MPC] = by_do_mpc(problem)
    plant, spend = Plant(problem.model, dt=problem.dt, substeps=20), _step(problem)
    states = {name: np.asarray(posed.x0, dtype=np.float64) for name in contestants}
    seconds = {name: np.empty(steps) for name in contestants}
    costs = dict.fromkeys(contestants, 0.0)
    for k in range(steps):
        for name, decide in contestants.items():
            begin = time.process_time()
            u = decide(states[name])
            seconds[name][k] = time.process_time() - begin
            costs[name] += float(spend(states[name], u)[1])
            states[name] = plant(states[name], u, k * problem.dt)[:, -1]
    return {name: (seconds[name], costs[name]) for name in contestants}


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate all plants, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--steps", type=int, default=30)
    options = parser.parse_args(arguments)
    lines = head("plant", "controller", "first [ms]", "median [ms]", "quartiles",
                 "longest", "longest / median", "median / IPOPT's", "cost")  # fmt: skip
    for make in PLANTS:
        posed = make()
        found = flown(posed, options.steps)
        reference = float(np.median(found[IPOPT][0][1:]))
        for name, (seconds, cost) in found.items():
            later = 1e3 * seconds[1:]
            lower, middle, upper = np.quantile(later, [0.25, 0.5, 0.75])
            lines.append(
                row(
                    posed.name,
                    name,
                    f"{1e3 * seconds[0]:.0f}",
                    f"{middle:.1f}",
                    f"{lower:.1f} to {upper:.1f}",
                    f"{later.max():.1f}",
                    f"{later.max() / middle:.1f}",
                    f"{middle / 1e3 / reference:.2f}",
                    f"{cost:.4g}",
                )
            )
            print(lines[-1], flush=True)
    publish(lines, options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
