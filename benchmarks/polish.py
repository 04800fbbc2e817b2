"""Iterations of the polish on machine code, against CasADi's own functions.

    python benchmarks/polish.py [--write docs/measured/polish.md] [--rounds 9]
        [--only NAME]

Seconds are CPU time of the process, both in turns, from the same start.
"""

import time
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.kept_values import PROBLEMS
from swarmstart.benchmarks.lanes import Posed, shipped
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.ocp import Bounds, IpoptOptions, Model, OptimalControlProblem, Planner
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.statement.guesses import cold_controls

BACKENDS = ("casadi", "llvm")
TEXT = """# An iteration of the polish

Made by `python benchmarks/polish.py --write docs/measured/polish.md`. IPOPT asks for
the values, slopes and second derivatives of all intervals. By default they are machine
code, which evaluates all intervals in one call (`backend="llvm"`); with
`backend="casadi"` CasADi interprets them. CPU time of one thread, both in turns from
the same start; medians and, of the ratio, quartiles over the rounds. A time is that of
the whole polish divided by its iterations, so it includes the natural sizes of the
variables, the rollouts and the test of the answer. "Outside" is the part of the time
with machine code that is not spent in these functions: above all in IPOPT's own linear
algebra.

"""


class Measured(NamedTuple):
    """Times of a problem's polish.

    Attributes:
        variables: Number of the NLP's variables.
        iterations: Iterations with machine code.
        casadi: Time of an iteration on CasADi's functions [s], in each round.
        llvm: The same on machine code.
        outside: Part of it that is spent outside of the functions.
        change: Difference of both costs, relative to their size.
    """

    variables: int
    iterations: int
    casadi: Array
    llvm: Array
    outside: float
    change: float

    @property
    def ratios(self) -> Array:
        """Time on machine code relative to that on CasADi's functions."""
        return self.llvm / self.casadi


def arm() -> Posed:
    """Return a two-link arm that swings to another pose; 4 states."""
    q, v, u = (ca.SX.sym(name, 2) for name in "qvu")
    c, s = ca.cos(q[1]), ca.sin(q[1])
    mass = ca.blockcat([[3 + 2 * c, 1 + c], [1 + c, 1]])
    pull = ca.vertcat(-s * (2 * v[0] * v[1] + v[1] ** 2), s * v[0] ** 2)
    rate = ca.vertcat(v, ca.solve(mass, u - pull))
    model = Model(states=ca.vertcat(q, v), controls=u, ode=rate)
    problem = OptimalControlProblem(
        model, horizon=2.0, intervals=60, stage_cost=ca.sumsqr(u),
        terminal=[(ca.vertcat(q, v), [1.0, -0.5, 0, 0])],
        bounds=Bounds(controls=(-20, 20)),
    )  # fmt: skip
    return Posed("two-link arm", problem, np.zeros(4), NOTHING)


def planar_quadrotor() -> Posed:
    """Return a planar quadrotor that moves aside below a ceiling; 6 states."""
    x, u = ca.SX.sym("x", 6), ca.SX.sym("u", 2)
    total, turn = u[0] + u[1], u[0] - u[1]
    rate = ca.vertcat(
        x[3:], -total * ca.sin(x[2]), total * ca.cos(x[2]) - 9.81, 10 * turn
    )
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=rate), horizon=2.0, intervals=40,
        stage_cost=ca.sumsqr(u - 4.905) + ca.sumsqr(x[2:]),
        terminal_cost=100 * ca.sumsqr(x - ca.DM([2, 0, 0, 0, 0, 0])),
        constraints=[x[1] <= 0.2], bounds=Bounds(controls=(0, 10)),
    )  # fmt: skip
    return Posed("planar quadrotor", problem, np.zeros(6), NOTHING)


def crane() -> Posed:
    """Return an overhead crane with a rope that is wound; 6 states."""
    x, u = ca.SX.sym("x", 6), ca.SX.sym("u", 2)
    _, length, angle, speed, winding, swing = ca.vertsplit(x)
    pull = -9.81 * ca.sin(angle) - u[0] * ca.cos(angle) - 2 * winding * swing
    rate = ca.vertcat(speed, winding, swing, u[0], u[1], pull / length)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=rate), horizon=4.0, intervals=50,
        stage_cost=ca.sumsqr(u),
        terminal=[(x, [3, 1, 0, 0, 0, 0])],
        bounds=Bounds(controls=(-3, 3)),
    )  # fmt: skip
    return Posed("crane", problem, np.array([0, 2.0, 0, 0, 0, 0]), NOTHING)


def masses() -> Posed:
    """Return a chain of four masses on hardening springs; 8 states."""
    x, v, u = ca.SX.sym("x", 4), ca.SX.sym("v", 4), ca.SX.sym("u", 2)
    ends = ca.vertcat(0, x, 0)
    stretch = ends[1:] - ends[:-1]
    force = stretch + stretch**3
    push = ca.vertcat(u[0], 0, 0, u[1])
    rate = ca.vertcat(v, force[1:] - force[:-1] - 0.1 * v + push)
    problem = OptimalControlProblem(
        Model(states=ca.vertcat(x, v), controls=u, ode=rate), horizon=6.0, intervals=40,
        stage_cost=ca.sumsqr(x) + 0.1 * ca.sumsqr(v) + 0.1 * ca.sumsqr(u),
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    return Posed(
        "chain of masses", problem, np.r_[1.0, -1, 1, 0.5, 0, 0, 0, 0], NOTHING
    )


def quadrotor() -> Posed:
    """Return a quadrotor with Euler angles, under a ceiling; 12 states."""
    p, v, a, w, u = (
        ca.SX.sym(n, k) for n, k in zip("pvawu", (3, 3, 3, 3, 4), strict=True)
    )
    roll, pitch, yaw = ca.vertsplit(a)
    cr, sr, cp, sp = ca.cos(roll), ca.sin(roll), ca.cos(pitch), ca.sin(pitch)
    cy, sy = ca.cos(yaw), ca.sin(yaw)
    thrust = ca.sum1(u)
    lift = thrust * ca.vertcat(cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr)
    angles = ca.vertcat(
        w[0] + (sr * w[1] + cr * w[2]) * sp / cp,
        cr * w[1] - sr * w[2],
        (sr * w[1] + cr * w[2]) / cp,
    )
    inertia = ca.DM([0.01, 0.01, 0.02])
    torque = ca.vertcat(
        0.2 * (u[1] - u[3]), 0.2 * (u[2] - u[0]), 0.02 * (u[0] - u[1] + u[2] - u[3])
    )
    turning = (torque - ca.cross(w, inertia * w)) / inertia
    rate = ca.vertcat(v, lift - ca.vertcat(0, 0, 9.81), angles, turning)
    x = ca.vertcat(p, v, a, w)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=rate), horizon=1.0, intervals=20,
        stage_cost=ca.sumsqr(p - 1) + 0.1 * ca.sumsqr(x[3:])
        + 0.05 * ca.sumsqr(u - 9.81 / 4),
        constraints=[x[2] <= 1.05], bounds=Bounds(controls=(0, 6)),
    )  # fmt: skip
    return Posed("quadrotor", problem, np.zeros(12), NOTHING)


OWN = (arm, planar_quadrotor, crane, masses, quadrotor)


def measured(posed: Posed, rounds: int) -> Measured:
    """Return the times of a problem's polish on both backends, in turns."""
    polishers = list[Polisher]()
    for backend in BACKENDS:
        planner = Planner(
            posed.problem, search=None, polish=IpoptOptions(), backend=backend
        )
        if planner.polisher is None:
            raise TypeError("expected a planner with a polish")
        polishers.append(planner.polisher)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    controls = cold_controls(planner.problem)[0]
    found = [polisher(controls, x0, known) for polisher in polishers]
    seconds = np.empty((2, rounds))
    for i in range(rounds):
        for which, polisher in enumerate(polishers):
            begin = time.process_time()
            polisher(controls, x0, known)
            seconds[which, i] = time.process_time() - begin
    each = seconds / [[max(one.iterations, 1)] for one in found]
    solvers = polishers[1].solvers.built
    stats = next(iter(solvers.values())).far(False).stats()
    inside = sum(s for name, s in stats.items() if name.startswith("t_proc_nlp_"))
    costs = [one.cost for one in found]
    return Measured(
        variables=next(iter(solvers.values())).program.nlp["x"].numel(),
        iterations=found[1].iterations,
        casadi=each[0],
        llvm=each[1],
        outside=1 - inside / float(seconds[1, -1]),
        change=abs(costs[1] - costs[0]) / max(abs(costs[0]), 1e-12),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all problems, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", action="append", help="one problem")
    options = parser.parse_args(arguments)
    lines = head("problem", "states", "variables", "iterations", "CasADi [ms]",
                 "machine code [ms]", "ratio", "quartiles", "outside",
                 "costs differ")  # fmt: skip
    problems = [*map(shipped, PROBLEMS), *[own() for own in OWN]]
    middles = list[float]()
    for posed in problems:
        if options.only and posed.name not in options.only:
            continue
        one = measured(posed, options.rounds)
        lower, middle, upper = np.quantile(one.ratios, [0.25, 0.5, 0.75])
        middles.append(float(middle))
        lines.append(
            row(
                posed.name,
                f"{posed.problem.model.nx}",
                f"{one.variables}",
                f"{one.iterations}",
                f"{1e3 * np.median(one.casadi):.2f}",
                f"{1e3 * np.median(one.llvm):.2f}",
                f"{middle:.2f}",
                f"{lower:.2f} to {upper:.2f}",
                f"{one.outside:.0%}",
                f"{one.change:.0e}",
            )
        )
        print(lines[-1], flush=True)
    lines += ["", f"Median of the ratios: {np.median(middles):.2f}."]
    publish(lines, options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
