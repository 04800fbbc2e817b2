"""Least time from point to point
==============================

How long does a mass of 1 kg need at least for 1 m, from rest to rest, if the force is
at most 1 N? The answer is known in closed form: full force for 1 s, full braking for
1 s.

The solver finds the same 2 s, and the switch in the middle. The end time is decided
with the controls: `ss.Free` takes the place of the length of the plan.

Prints::

    end time 2.0000 s, in closed form 2 s
    acceleration at first 1.00, at last -1.00 m/s^2

The same in YAML; `swarmstart run free_end_time.yaml` solves it:

.. literalinclude:: ../../../examples/plans/free_end_time.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt

import swarmstart as ss

x, v, acceleration = (ca.SX.sym(name) for name in ("x", "v", "acceleration"))
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, v),
        controls=acceleration,
        ode=ca.vertcat(v, acceleration),
    ),
    horizon=ss.Free(0.5, 5.0),  # s
    intervals=20,
    stage_cost=ca.SX(1),  # its integral is the time
    bounds=ss.Bounds(controls=(-1.0, 1.0)),
    terminal=[x - 1, v],
)
solution = ss.solve(problem, x0=[0, 0], seed=0)
pushes = solution.controls[0]
print(f"end time {solution.times[-1]:.4f} s, in closed form 2 s")
print(f"acceleration at first {pushes[0]:.2f}, at last {pushes[-1]:.2f} m/s^2")

figure, (plane, force) = plt.subplots(1, 2)
plane.plot(*solution.path.states[:2], "k", linewidth=2)
plane.plot(*solution.states[:, ::2], "o", color="tab:blue")
plane.text(0.5, 0.3, "a dot every\n0.2 s", ha="center", color="tab:blue")
plane.set(xlabel="position [m]", ylabel="speed [m/s]", ylim=(0, 1.1))
force.stairs(pushes, solution.times, color="tab:orange", fill=True)
force.set(xlabel="time [s]", ylabel="acceleration [m/s²]")
plt.show()
