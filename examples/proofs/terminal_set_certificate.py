"""A proven set in which a linear law takes over
=============================================

A pendulum is swung up by plans of two seconds. Near the top a linear law would do, but
how near, with a torque of at most 5 N m, held for 0.1 s?

Inside the ellipse of the picture: there the law keeps the torque in its bounds, and the
pendulum comes nearer to the top; `ss.terminal_set_of` proves this by interval
arithmetic. `ss.DualMode` hands over to the law there, after 2.3 s. The certificate is a
file; `python -m swarmstart.terminal_set.check certificate.json` proves it again.

Prints::

    level 2.461, proven in every part
    the linear law takes over at 2.3 s, and the pendulum stays upright
    wrote certificate.json

The same in YAML; `swarmstart run terminal_set_certificate.yaml` simulates it:

.. literalinclude:: ../../../examples/proofs/terminal_set_certificate.yaml
   :language: yaml
"""

import tempfile
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

UPRIGHT = np.array([np.pi, 0.0])
angle, speed, torque = (ca.SX.sym(name) for name in ("angle", "speed", "torque"))
off = angle - np.pi
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(angle, speed),  # rad, rad/s
        controls=torque,  # N m; mass and length are 1
        ode=ca.vertcat(speed, torque - 9.81 * ca.sin(angle)),
    ),
    horizon=2.0,  # s
    intervals=20,
    stage_cost=10 * off**2 + 0.1 * speed**2 + 0.05 * torque**2,
    terminal_cost=100 * off**2 + 10 * speed**2,
    bounds=ss.Bounds(controls=(-5.0, 5.0)),
)
weights = ss.Weights(Q=np.diag([10.0, 0.1]), R=np.array([[0.05]]))
rng = np.random.default_rng(0)
found = ss.terminal_set_of(problem, at=UPRIGHT, weights=weights, rng=rng)
parts = "every part" if not found.certificate.unproven() else "some parts"
print(f"level {found.alpha:.3f}, proven in {parts}")

planner = ss.Planner(problem, search="lshade", polish=ss.IpoptOptions())
loop = ss.RecedingHorizon(planner=planner)
dual = ss.DualMode(loop, sets=[found], targets=[lambda time: UPRIGHT])
plant = ss.Plant(problem.model, dt=problem.dt, substeps=10)
run = ss.simulate(plant, dual, [0, 0], steps=50, seed=0)
first = [decision.mode for decision in run.decisions].index(ss.Mode.LINEAR)
begins, miss = run.times[first], abs(run.states[:, -1] - UPRIGHT).max()
stays = "stays" if miss < 1e-3 else "does not stay"
print(f"the linear law takes over at {begins:.1f} s, and the pendulum {stays} upright")

file = Path(tempfile.mkdtemp()) / "certificate.json"
file.write_text(ss.certificate_text(found.certificate), encoding="utf-8")
print("wrote", file.name)

axes = plt.figure().add_subplot(xlabel="angle [rad]", ylabel="speed [rad/s]")
turn = np.linspace(0, 2 * np.pi, 100)
edge = np.linalg.cholesky(np.linalg.inv(found.P / found.alpha))
x, y = UPRIGHT[:, None] + edge @ [np.cos(turn), np.sin(turn)]
axes.fill(x, y, color="tab:orange", alpha=0.4, label="proven set")
axes.plot(*run.dense_states, color="tab:blue", label="plans, then the law")
axes.plot(*run.states[:, first], "ko", label=f"hand-over at {begins:.1f} s")
axes.legend()
plt.show()
