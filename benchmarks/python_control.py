"""control.optimal.solve_ocp beside swarmstart: examples of its documentation, and ours.

    python benchmarks/python_control.py [--repeats 3]
        [--write docs/measured/python_control.md]

Every contestant states the problem from the same system of python-control, on the same
time points, with inputs that are linear between them where the system is continuous.
What an answer costs is integrated independently (DOP853, rtol 1e-10).
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import casadi as ca
import control
import control.optimal
import numpy as np
from scipy.integrate import solve_ivp

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.campaign.trials.building import Trial
from swarmstart.cases.campaign.trials.solver_names import solver_of
from swarmstart.cases.campaign.trials.trial import answered
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp import right_hand_side

SHIPPED = ("double_integrator", "van_der_pol", "pendulum")
SOLVERS = ("python-control", "python-control[maxiter=1000]", "ipopt", "solve")
BUDGET_S = 120.0
TEXT = """# python-control's solver of optimal-control problems

Made by `python benchmarks/python_control.py --write
docs/measured/python_control.md`. Seconds are CPU seconds, the building of the problem
included: those of the first call and, in brackets, the median of later calls in the
same process. All were measured on one machine in one run, with machine code in the
cache. "Own verdict" is `success` of python-control and the status of swarmstart. Costs
and end errors are those of an independent integration of the controls that each
returned (DOP853, rtol 1e-10). An end error is the largest difference, at the end,
between a state and its wanted value, in the state's unit; 0 if no value is wanted.

By default python-control applies the trapezoidal rule between the time points to a
continuous system, so the states that it returns are those of this approximation and
not of the system itself. SLSQP, its default optimiser, stops if the cost changes by
less than 1e-6. The options of python-control are those of its examples; another
`minimize_method` and more time points may give better results. swarmstart runs with its
own defaults.

"""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Example:
    """A problem as python-control states one; quadratic costs about x_end and u_end.

    Attributes:
        title: Name and origin.
        system: The system.
        times: Time points [s].
        x0: Initial state.
        x_end: Wanted state.
        u_end: Wanted input.
        Q: Weight of the states along the way, or None.
        R: Weight of the inputs.
        P: Weight of the states at the end, or None.
        limits: Lower and upper limits of the inputs.
    """

    title: str
    system: Any
    times: Array
    x0: Array
    x_end: Array
    u_end: Array
    Q: Array | None
    R: Array
    P: Array | None
    limits: tuple[Sequence[float], Sequence[float]]


def car() -> Any:
    """The vehicle of python-control's documentation, in NumPy."""

    def update(t: float, x: Any, u: Any, params: Any) -> Any:
        steer = np.clip(u[1], -0.5, 0.5)
        return np.array(
            [np.cos(x[2]) * u[0], np.sin(x[2]) * u[0], u[0] / 3.0 * np.tan(steer)]
        )

    return control.NonlinearIOSystem(
        update, None, states=3, name="vehicle", inputs=("v", "phi")
    )


def lane_change(title: str, points: int, **weights: Any) -> Example:
    """Four metres to the side on 100 m, in 10 s at 10 m/s."""
    return Example(
        title=title, system=car(),
        times=np.arange(points, dtype=np.float64) * (10 / (points - 1)),
        x0=np.array([0.0, -2, 0]), x_end=np.array([100.0, 2, 0]),
        u_end=np.array([10.0, 0]), limits=([8, -0.1], [12, 0.1]), **weights,
    )  # fmt: skip


def aircraft() -> Example:
    """The first plan of the predictive controller in mpc_aircraft.ipynb."""
    A = np.array([[0.99, 0.01, 0.18, -0.09, 0], [0, 0.94, 0, 0.29, 0],
                  [0, 0.14, 0.81, -0.9, 0], [0, -0.2, 0, 0.95, 0],
                  [0, 0.09, 0, 0, 0.9]])  # fmt: skip
    B = np.array([[0.01, -0.02], [-0.14, 0], [0.05, -0.2], [0.02, 0], [-0.01, 0]])
    C = np.array([[0, 1, 0, 0, -1], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [1, 0, 0, 0, 0]])
    u_end = np.array([0.8, -0.3])
    return Example(
        title="aircraft, `mpc_aircraft.ipynb`, first plan (sampled)",
        system=control.ss(A, B, C, 0, 0.2),
        times=0.2 * np.arange(6, dtype=np.float64), x0=np.zeros(5),
        x_end=np.linalg.solve(np.eye(5) - A, B @ u_end), u_end=u_end,
        Q=10 * C.T @ C, R=np.diag([3.0, 2]), P=None, limits=([-5, -6], [5, 6]),
    )  # fmt: skip


def examples() -> list[Example]:
    """Return the three examples of python-control's documentation."""
    return [
        lane_change("lane change, `steering-optimal.py`, approach 2", 20, Q=None,
                    R=np.diag([0.1, 1]), P=np.diag([1.0, 10, 10])),
        lane_change("lane change, page \"Optimization-Based Control\"", 10,
                    Q=np.diag([0, 0, 0.1]), R=np.eye(2), P=1000 * np.eye(3)),
        aircraft(),
    ]  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Answer:
    """Inputs that a contestant returned: at the time points, or held if sampled."""

    inputs: Array
    verdict: str


def theirs(example: Example, method: str | None) -> Answer:
    """Solve with python-control, from a straight line as its examples do."""
    one, opt = example, control.optimal
    straight = np.linspace(one.x0, one.x_end, one.times.size).T
    inputs = np.repeat(one.u_end[:, None], one.times.size, axis=1)
    guess = inputs if one.system.dt or method else (straight, inputs)
    size = len(one.x0)
    Q = np.zeros((size, size)) if one.Q is None else one.Q
    end = (
        None
        if one.P is None
        else opt.quadratic_cost(one.system, one.P, 0, x0=one.x_end)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = opt.solve_ocp(
            one.system, one.times, one.x0,
            opt.quadratic_cost(one.system, Q, one.R, x0=one.x_end, u0=one.u_end),
            [opt.input_range_constraint(one.system, *one.limits)],
            terminal_cost=end, initial_guess=guess, print_summary=False,
            **({"trajectory_method": method} if method else {}),
        )  # fmt: skip
    return Answer(
        inputs=np.asarray(found.inputs), verdict="success" if found.success else "no"
    )


def ours(example: Example, **options: Any) -> Answer:
    """Solve with swarmstart from the same system."""
    one, model = example, ss.Model.from_system(example.system)
    e, d = model.states - one.x_end, model.controls - one.u_end
    dt = one.times[1]
    stage = d.T @ one.R @ d + (0 if one.Q is None else e.T @ one.Q @ e)
    problem = ss.OptimalControlProblem(
        model, horizon=one.times[-1], intervals=one.times.size - 1,
        # python-control adds up the costs of a sampled system without dt.
        stage_cost=stage / dt if one.system.dt else stage,
        quadrature="left" if one.system.dt else "integral",
        terminal_cost=ca.SX(0) if one.P is None else e.T @ one.P @ e,
        bounds=ss.Bounds(controls=one.limits),
        control_shape="constant" if one.system.dt else "linear",
    )  # fmt: skip
    found = ss.solve(problem, one.x0, seed=0, **options)
    return Answer(inputs=found.controls, verdict=found.status.name.lower())


def judged(example: Example, inputs: Array) -> tuple[float, float]:
    """Return the cost of inputs, and the distance of the end from the wanted state."""
    one = example

    def stage(x: Array, u: Array) -> float:
        e, d = x - one.x_end, u - one.u_end
        return float(d @ one.R @ d + (0.0 if one.Q is None else e @ one.Q @ e))

    x, cost = one.x0, 0.0
    for k, (begin, end) in enumerate(zip(one.times, one.times[1:], strict=False)):
        u = inputs[:, k]
        if one.system.dt:
            cost += stage(x, u)
            x = one.system.dynamics(begin, x, u)
            continue
        slope = (inputs[:, k + 1] - u) / (end - begin)

        def rate(t: float, y: Array, first: Any = (begin, u, slope)) -> Array:
            at = first[1] + (t - first[0]) * first[2]
            return np.append(one.system.dynamics(t, y[:-1], at), stage(y[:-1], at))

        y = solve_ivp(
            rate, (begin, end), np.append(x, cost), "DOP853", rtol=1e-10, atol=1e-12
        ).y[:, -1]
        x, cost = y[:-1], y[-1]
    e = x - one.x_end
    return cost + (0.0 if one.P is None else float(e @ one.P @ e)), float(
        np.abs(e).max()
    )


CONTESTANTS: dict[str, Callable[[Example], Answer]] = {
    "python-control": lambda one: theirs(one, None),
    "python-control, shooting": lambda one: theirs(one, "shooting"),
    "swarmstart, defaults": ours,
    "swarmstart, IPOPT alone": lambda one: ours(one, search=None, lanes=0),
}


def timed(solve: Callable[[], Any], repeats: int) -> tuple[Any, float, float]:
    """Return an answer, CPU seconds of the first call, and the median of later ones."""
    seconds = []
    for _ in range(repeats + 1):
        begin = time.process_time()
        answer = solve()
        seconds.append(time.process_time() - begin)
    return answer, seconds[0], median(seconds[1:])


def example_rows(example: Example, repeats: int) -> list[str]:
    """Return the rows of all contestants on an example."""
    lines = []
    for name, solve in CONTESTANTS.items():
        if example.system.dt and name.endswith("shooting"):
            continue  # Its default there.
        answer, first, later = timed(partial(solve, example), repeats)
        cost, off = judged(example, answer.inputs)
        lines.append(
            row(example.title, name, f"{cost:.6g}", f"{off:.2g}", answer.verdict,
                f"{first:.2f} ({later:.2f})")
        )  # fmt: skip
    return lines


def shipped_rows(name: str) -> list[str]:
    """Return the rows of the solvers of `compare` on a shipped problem, same grid."""
    posed = first_problem(resolve(read_document(name)).posed())
    lines = []
    for solver in SOLVERS:
        trial = Trial(
            solver=solver_of(solver), budget={"seconds": BUDGET_S}, seed=0, search=None
        )
        begin = time.process_time()
        result = answered(posed, trial)
        seconds = time.process_time() - begin
        controls = np.array(result.as_json()["plan"]["controls"])
        cost, broken = integrated(posed.problem, posed.x0, controls)
        lines.append(
            row(f"`{name}`", f"`{solver}`", f"{cost:.6g}", f"{broken:.2g}",
                "feasible" if result.feasible else "no", f"{seconds:.2f}")
        )  # fmt: skip
    return lines


def integrated(
    problem: ss.OptimalControlProblem, x0: Any, controls: Array
) -> tuple[float, float]:
    """Return cost and largest end error of held controls, by an integration of ours."""
    model, f = problem.model, right_hand_side(problem.model)
    stage = ca.Function("stage", [model.states, model.controls], [problem.stage_cost])
    ends = [ca.vertcat(c.expression - c.lower)
            for c in problem.terminal_constraints]  # fmt: skip
    end = ca.Function("end", [model.states], [problem.terminal_cost, ca.vertcat(*ends)])
    y = np.append(np.asarray(x0, dtype=np.float64).ravel(), 0.0)
    for u in controls.T:

        def rate(t: float, z: Array, held: Array = u) -> Array:
            slope = np.array(f(z[:-1], held, [])).ravel()
            return np.append(slope, float(stage(z[:-1], held)))

        y = solve_ivp(rate, (0, problem.dt), y, "DOP853", rtol=1e-10, atol=1e-12).y[
            :, -1
        ]
    last, off = end(y[:-1])
    return y[-1] + float(last), float(np.abs(np.array(off)).max(initial=0.0))


def main() -> None:
    """Solve all problems, and print or write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    lines = [
        "## Examples of its documentation", "",
        *head("problem", "solver", "cost", "end error", "own verdict", "CPU s"),
    ]  # fmt: skip
    for example in examples():
        lines += example_rows(example, options.repeats)
    lines += [
        "", "## Problems of this package, with held controls on the same grid", "",
        "`compare` runs these solvers, from zero controls. By default `python-control` "
        "ends after 100 iterations of SLSQP; every solver ends after 120 s.", "",
        *head("problem", "solver", "cost", "end error", "confirmed", "CPU s"),
    ]  # fmt: skip
    for name in SHIPPED:
        lines += shipped_rows(name)
    publish(lines, options, TEXT)


if __name__ == "__main__":
    main()
