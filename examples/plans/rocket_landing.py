"""Land a rocket with little fuel
==============================

A rocket of 30 t comes in at 206 m/s, 1500 m up and 1500 m beside the pad. Its engine
cannot be shut off: it gives 160 to 800 kN. Which landing burns the least fuel?

Full thrust, least thrust, full thrust: the engine first brakes the sideways speed, then
the rocket drops for 10 s, and a last burn stops it on the pad. So only the two switches
and the tilt are to be found. There is one optimum: IPOPT alone finds it as well, and
all random starts of `ss.solve` end in it.

Prints::

    fuel 3588.6 kg, landed after 20.61 s
    the engine switches at 3.6 s, 13.9 s
    local optima found: 1

The same in YAML; `swarmstart run rocket_landing.yaml` solves it:

.. literalinclude:: ../../../examples/plans/rocket_landing.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

names = ("x", "height", "vx", "vz", "mass", "thrust", "tilt")
x, height, vx, vz, mass, thrust, tilt = (ca.SX.sym(name) for name in names)
gravity, exhaust = 9.81, 2800.0  # m/s^2, m/s
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, height, vx, vz, mass),  # m, m/s, t
        controls=ca.vertcat(thrust, tilt),  # kN, rad
        ode=ca.vertcat(
            vx,
            vz,
            thrust / mass * ca.sin(tilt),
            thrust / mass * ca.cos(tilt) - gravity,
            -thrust / exhaust,
        ),
    ),
    horizon=ss.Free(10.0, 60.0),  # s
    intervals=40,
    terminal_cost=1000 * (30 - mass),  # kg of fuel
    bounds=ss.Bounds(controls=([160.0, -1.2], [800.0, 1.2])),
    terminal=[x, height, vx, vz],
)
solution = ss.solve(problem, [-1500, 1500, 200, -50, 30], seed=0)
thrusts, times = solution.controls[0], solution.times
switches = times[np.flatnonzero(abs(np.diff(thrusts > 480))) + 1]
print(f"fuel {solution.cost:.1f} kg, landed after {times[-1]:.2f} s")
print("the engine switches at", ", ".join(f"{time:.1f} s" for time in switches))
print("local optima found:", len(solution.optima))

figure, (path, engine) = plt.subplots(1, 2, width_ratios=[3, 2])
path.plot(*solution.path.states[:2], color="0.7")
places, (thrusts, tilts) = solution.states[:2, :-1], solution.controls
flames = [-thrusts * np.sin(tilts), -thrusts * np.cos(tilts)]
path.quiver(*places, *flames, color="tab:orange", headwidth=1, headlength=1, scale=4000)
path.plot(*solution.states[:2, ::3], "o", color="tab:purple", markersize=5)
path.set(aspect="equal", xlabel="x [m]", ylabel="height [m]", ylim=(-60, 1600))
path.set(xticks=[-1500, -1000, -500, 0], xlim=(-1600, 250))
engine.stairs(thrusts, times, color="tab:purple", linewidth=2)
engine.set(xlabel="time [s]", ylabel="thrust [kN]", ylim=(0, 850))
plt.show()
