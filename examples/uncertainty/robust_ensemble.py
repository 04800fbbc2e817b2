"""A crane and ropes of any length
===============================

A crane moves a load by 5 m in 7 s. Its rope is 2 to 4 m long, which is not known
better. How does it move so that the load hardly swings at the end, with any of these
lengths?

A plan for 3 m leaves no swing with that length, but up to 23.0 cm with others. One plan
for five lengths leaves at most 1.6 cm with any: no rope is measured, and no feedback is
needed. `ss.ensemble` makes one problem of all five, and `risk="worst"` counts the
worst.

Prints::

    planned for 3 m: at most 23.0 cm
    planned for 2 to 4 m: at most 1.6 cm

The same in YAML; `swarmstart run robust_ensemble.yaml` solves it:

.. literalinclude:: ../../../examples/uncertainty/robust_ensemble.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

x, v, swing, rate, push = (ca.SX.sym(n) for n in ("x", "v", "swing", "rate", "push"))
rope = ca.SX.sym("rope")  # m
turn = -(9.81 * ca.sin(swing) + push * ca.cos(swing)) / rope
missed = (x - 5) ** 2 + v**2  # the crane, m^2
swung = (rope * swing) ** 2 + rope**3 / 9.81 * rate**2  # square of the amplitude, m^2
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, v, swing, rate),  # m, m/s, rad, rad/s
        controls=push,  # m/s^2
        ode=ca.vertcat(v, push, rate, turn),
        parameters=rope,
    ),
    horizon=7.0,  # s
    intervals=35,
    stage_cost=1e-4 * push**2,
    terminal_cost=100 * (missed + swung),
    bounds=ss.Bounds(controls=(-1, 1)),
)
robust = ss.ensemble(problem, {"rope": np.linspace(2, 4, 5)}, risk="worst")
solution = ss.solve(robust, [0, 0, 0, 0], seed=0)
nominal = ss.solve(problem, [0, 0, 0, 0], known=ss.Known(parameters=[3.0]), seed=0)
amplitude = ca.Function("amplitude", [problem.model.states, rope], [ca.sqrt(swung)])


def at_end(controls: np.ndarray, length: float) -> float:
    """Return the amplitude at the end with a rope of this length [cm]."""
    plant = ss.Plant(
        problem.model, dt=problem.dt, substeps=4,
        parameters=lambda times: np.full((1, times.size), length),
    )  # fmt: skip
    state = np.zeros(4)
    for control in controls.T:
        state = plant(state, control)[:, -1]
    return 100 * float(amplitude(state, length))


axes = plt.figure().add_subplot(xlabel="rope [m]", ylabel="swing at the end [cm]")
lengths = np.linspace(1.6, 4.4, 29)
for answer, name in ((nominal, "planned for 3 m"), (solution, "planned for 2 to 4 m")):
    ends = np.array([at_end(answer.controls, length) for length in lengths])
    print(f"{name}: at most {ends[4:25].max():.1f} cm")  # 2 to 4 m
    axes.plot(lengths, ends, lw=2, label=name)
axes.axvspan(2, 4, color="0.92")
axes.set(ylim=0)
axes.legend()
plt.show()
