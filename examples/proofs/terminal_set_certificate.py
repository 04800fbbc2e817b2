"""Hand over from planning to a linear law inside a terminal set that is proven.

Shows: `terminal_set_of`, its certificate as a file, and `DualMode`.

Prints:
    level 2.461, proven in every part
    the linear law takes over at 2.3 s, and the pendulum stays upright
    wrote certificate.json
"""

import os
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np

import swarmstart as ss

UPRIGHT = np.array([np.pi, 0.0])


def pendulum() -> ss.OptimalControlProblem:
    """Return the problem to bring a pendulum upright, with a quadratic cost."""
    angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
    model = ss.Model(
        states=ca.vertcat(angle, speed),
        controls=torque,
        ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle)),
    )
    off = angle - np.pi
    return ss.OptimalControlProblem(
        model,
        horizon=2.0,
        intervals=20,
        stage_cost=10 * off**2 + 0.1 * speed**2 + 0.05 * torque**2,
        terminal_cost=100 * off**2 + 10 * speed**2,
        bounds=ss.Bounds(controls=(-5.0, 5.0)),
    )


def main() -> None:
    """Prove a terminal set, use it in closed loop, and write its certificate."""
    problem = pendulum()
    weights = ss.Weights(Q=np.diag([10.0, 0.1]), R=np.array([[0.05]]))
    found = ss.terminal_set_of(
        problem, at=UPRIGHT, weights=weights, rng=np.random.default_rng(0)
    )
    if found.certificate is None or found.certificate.unproven():
        raise SystemExit("expected a certificate in which all is proven")
    print(f"level {found.alpha:.3f}, proven in every part")

    planner = ss.Planner(problem, search="lshade", polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    dual = ss.DualMode(loop, sets=[found], targets=[lambda time: UPRIGHT])
    plant = ss.Plant(problem.model, dt=problem.dt, substeps=10)
    run = ss.simulate(plant, dual, [0, 0], steps=50, seed=0)
    modes = [decision.mode for decision in run.decisions]
    begins = run.times[modes.index(ss.Mode.LINEAR)]
    upright = np.allclose(run.states[:, -1], UPRIGHT, atol=1e-3)
    print(
        f"the linear law takes over at {begins:.1f} s, and the pendulum "
        + ("stays upright" if upright else "does not stay upright")
    )

    # A folder of your own in place of this one keeps the file; check it again with
    # python -m swarmstart.terminal_set.check certificate.json
    file = Path(tempfile.mkdtemp()) / "certificate.json"
    file.write_text(ss.certificate_text(found.certificate), encoding="utf-8")
    print("wrote", file.name)
    os.remove(file)


if __name__ == "__main__":
    main()
