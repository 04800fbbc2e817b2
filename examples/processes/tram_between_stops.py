"""A tram drives over a hill
=========================

A tram of 40 t has 100 s for the 1100 m to the next stop, and a hill of 8 m is between.
How is it driven so that it takes the least energy from the wire?

It takes 2.08 kWh, all of it on the first 220 m, and then no power at all. The tram
rolls up the hill, crosses its top at 28 km/h, rolls down and brakes only at the end. If
the brakes return 80 % of their energy, 1.36 kWh are left, and the drive changes little:
the tram holds 56 km/h before the hill. One local optimum is known; IPOPT alone finds it
too. The part that is returned is a parameter of the model, given by `ss.Known`.

Prints::

    0% returned: 2.08 kWh, top speed 61 km/h
    80% returned: 1.36 kWh, top speed 57 km/h

The same in YAML; `swarmstart run tram_between_stops.yaml` solves it without return:

.. literalinclude:: ../../../examples/processes/tram_between_stops.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

place, speed, returned = (ca.SX.sym(name) for name in ("place", "speed", "returned"))
drive, brake = ca.SX.sym("drive"), ca.SX.sym("brake")
slope = -(place - 700) / 11250 * 8 * ca.exp(-(((place - 700) / 150) ** 2))
drag = 2.0 + 0.005 * speed**2 + 40 * 9.81 * slope  # kN
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(place, speed),  # m, m/s
        controls=ca.vertcat(drive, brake),  # kN
        ode=ca.vertcat(speed, (drive - brake - drag) / 40),
        parameters=returned,
    ),
    horizon=100.0,  # s
    intervals=40,
    stage_cost=(drive / 0.85 - returned * brake) * speed,  # kW; 0.85: the motors
    bounds=ss.Bounds(controls=(0, 45)),
    constraints=[ss.PathConstraint(expression=drive * speed, upper=350)],  # kW
    terminal=[place - 1100, speed],
)
solution = ss.solve(problem, [0, 0], known=ss.Known(parameters=[0.0]), seed=0)
second = ss.solve(problem, [0, 0], known=ss.Known(parameters=[0.8]), seed=0, lanes=8)

upper, lower = plt.figure().subplots(2, sharex=True)
for answer, part in ((solution, "0%"), (second, "80%")):
    top = 3.6 * answer.states[1].max()
    print(f"{part} returned: {answer.cost / 3600:.2f} kWh, top speed {top:.0f} km/h")
    upper.plot(
        answer.path.states[0], 3.6 * answer.path.states[1], label=f"{part} returned"
    )
upper.set(ylabel="speed [km/h]")
upper.legend()
places, forces = solution.states[0, :-1], solution.controls[0] - solution.controls[1]
height = 8 * np.exp(-(((places - 700) / 150) ** 2))
dots = lower.scatter(places, height, c=forces, cmap="PuOr_r", edgecolors="k")
plt.colorbar(dots, label="force [kN]")
lower.set(xlabel="place [m]", ylabel="height [m]")
plt.show()
