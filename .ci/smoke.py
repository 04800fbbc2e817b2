"""A short use of each part of the installed package, with answers that are known.

A pendulum is swung up, in machine code and not by CasADi's map; a table is looked up in
a model; python-control designs a gain; two steps of a flight are run, drawn and judged.
"""

import pathlib
import sys
import tempfile

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart.cases.commands.front.cli import main
from swarmstart.terminal_set import continuous_terminal_set


def expect(name: str, expected: object, *, found: object, ok: bool) -> None:
    """End the program with an error if a check failed."""
    if not ok:
        raise SystemExit(f"{name}: expected {expected}, found {found}")


x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
model = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
problem = ss.OptimalControlProblem(
    model, horizon=3.0, intervals=50, stage_cost=u**2,
    bounds=ss.Bounds(controls=(-8.0, 8.0)), terminal=[x - ca.vertcat(np.pi, 0)],
)  # fmt: skip
solution = ss.solve(problem, x0=[0, 0], seed=0)
TOLERANCE = 1e-5
ok = abs(solution.cost - 36.712600) < TOLERANCE and solution.status.is_confirmed
expect("the pendulum", 36.712600, found=solution.cost, ok=ok)

evaluate = ss.compile_batch(ca.Function("f", [x], [ca.sin(x[0]) * x[1]]))
expect("the backend", "llvm", found=evaluate.backend, ok=evaluate.backend == "llvm")

table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, 1.0, 4.0])
y = ca.SX.sym("y")
looked_up = ss.Model(states=y, controls=u, ode=table(y) + u)
expect("a table", "a model", found=looked_up, ok=looked_up.nx == 1)

cart = ca.Function("cart", [x, u], [ca.vertcat(x[1], u)])
rest = ss.Reference(x_ref=[0, 0], u_ref=[0], u_lower=[-1], u_upper=[1])
weights = {"Q": np.eye(2), "R": np.eye(1)}
gain = continuous_terminal_set(cart, rest, **weights).K
ok = np.allclose(gain, [[1.0, np.sqrt(3.0)]], rtol=1e-9)
expect("a gain of python-control", "(1, sqrt 3)", found=gain, ok=ok)

with tempfile.TemporaryDirectory() as folder:
    out = pathlib.Path(folder, "out")
    flight = f"run formation_v --set steps=2 --quiet --json --out {out}".split()
    code = main(flight)
    expect("a flight", 0, found=code, ok=code == 0)
    expect("figures", "some", found=0, ok=any((out / "figures").iterdir()))
sys.exit(main(["check", "formation_v", "close_formation", "reconfiguration", "swap_5"]))
