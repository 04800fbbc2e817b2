"""A controller as an FMU
======================

Simulink, Dymola and OpenModelica run parts from other tools as FMUs. How does a
predictive controller come into such a tool?

`ss.export_fmu` packs its C code with a description of inputs and outputs and a library
for this machine. Here FMPy runs the archive as such a tool does, by `ss.FmuPlant`:
every 0.1 s it takes the place and speed of a cart, and gives the force for the next 0.1
s. The cart comes to rest at 0 and keeps its speed limit of 0.8 m/s.

Prints::

    sources/buildDescription.xml sources/cart.c sources/cart.h sources/cart_fmu.c
    largest speed 0.80 m/s; 6 s later 0.00 m from the goal

There is no YAML form of this page; `swarmstart export fmu pendulum` writes the FMU of a
shipped scenario.
"""

import tempfile
import zipfile
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

place, speed, force = (ca.SX.sym(name) for name in ("place", "speed", "force"))
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(place, speed),  # m, m/s
        controls=force,  # N; the mass is 1 kg
        ode=ca.vertcat(speed, force),
    ),
    horizon=3.0,  # s
    intervals=30,
    stage_cost=place**2 + 0.1 * speed**2 + 0.05 * force**2,
    bounds=ss.Bounds(controls=(-1.0, 1.0), states=([-5, -0.8], [5, 0.8])),
)
planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
made = ss.export_c(ss.RecedingHorizon(planner=planner), [2.0, 0.0], name="cart")
file = Path(tempfile.mkdtemp()) / "cart.fmu"
file.write_bytes(ss.export_fmu(made))
inside = zipfile.ZipFile(file).namelist()
print(*(name for name in inside if name.startswith("sources")))

try:
    controller = ss.FmuPlant(file, states=["force"], controls=["place", "speed"])
except (ss.MissingPackageError, ss.SimulatorError) as error:
    raise SystemExit(f"not run: {error}") from None
forces = [controller.start_at(controller.start)]
moved = [np.array([2.0, 0.0])]
for _ in range(60):
    forces.append(controller.step(forces[-1], moved[-1], 0.1))
    (newton,), speed_now = forces[-1], moved[-1][1]
    moved.append(moved[-1] + 0.1 * np.array([speed_now + 0.05 * newton, newton]))
places, speeds = np.transpose(moved)
print(f"largest speed {abs(speeds).max():.2f} m/s; 6 s later", end=" ")
print(f"{abs(places[-1]):.2f} m from the goal")

times = 0.1 * np.arange(61)
axes = plt.figure().add_subplot(xlabel="time [s]")
axes.axhline(-0.8, color="0.5", linestyle=":", label="speed limit")
axes.plot(times, places, "-", label="place [m]")
axes.plot(times, speeds, "--", label="speed [m/s]")
force_by_fmu = {"baseline": None, "color": "k", "label": "force [N], by the FMU"}
axes.stairs(np.ravel(forces[1:]), times, **force_by_fmu)
axes.legend()
plt.show()
