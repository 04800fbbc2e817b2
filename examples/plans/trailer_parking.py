"""Park a car with a trailer
=========================

A car with a trailer stands in a lane and has to stand between two flower beds, trailer
first. The trailer turns against the steering, and it jackknifes if the angle at the
hitch grows too large. What is the best way, if time and hard steering cost?

The car drives past the gap, steers away, and backs in with one reversal. The best way
round a bed has three reversals and costs 44 % more. IPOPT finds no plan at all from
zero controls; the random starts of `ss.solve` lead to both ways.

Prints::

    parked in 18.58 s with 1 reversal
    largest angle at the hitch 0.72 of 0.90 rad

The same in YAML; `swarmstart run trailer_parking.yaml` solves it:

.. literalinclude:: ../../../examples/plans/trailer_parking.yaml
   :language: yaml
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

names = ("x", "y", "heading", "hitch", "steering", "speed", "turn")
x, y, heading, hitch, steering, speed, turn = (ca.SX.sym(name) for name in names)
wheelbase, drawbar = 2.5, 3.5  # m
turning = speed / wheelbase * ca.tan(steering)
rear = ca.vertcat(x, y)  # the car's rear axle, which carries the hitch
along = ca.vertcat(ca.cos(heading), ca.sin(heading))
trailer = rear - drawbar * ca.vertcat(ca.cos(heading - hitch), ca.sin(heading - hitch))
beds = [(-3.0, 0.0), (3.0, 0.0)]  # of radius 1.2 m; the vehicles are 2.2 m wide
problem = ss.OptimalControlProblem(
    ss.Model(
        states=ca.vertcat(x, y, heading, hitch, steering),  # m, rad
        controls=ca.vertcat(speed, turn),  # m/s, rad/s
        ode=ca.vertcat(
            speed * along, turning, turning - speed / drawbar * ca.sin(hitch), turn
        ),
    ),
    horizon=ss.Free(10.0, 40.0),  # s
    intervals=30,
    substeps=2,
    stage_cost=1 + turn**2,
    bounds=ss.Bounds(
        controls=([-1.5, -0.6], [1.5, 0.6]),
        states=([-15, -8, -4, -0.9, -0.6], [15, 6, 4, 0.9, 0.6]),
    ),
    constraints=[
        ss.disc(point, centre=bed, radius=1.2 + 1.1)
        for point in (rear + 1.2 * along, trailer)
        for bed in beds
    ],
    terminal=[x, y + 2.5, heading - np.pi / 2, hitch, steering],
)
solution = ss.solve(problem, [-6, 3, 0, 0, 0], search=None, lanes=32, seed=0)
reversals = np.count_nonzero(np.diff(np.sign(solution.controls[0])))
print(f"parked in {solution.times[-1]:.2f} s with {reversals} reversal")
print(f"largest angle at the hitch {abs(solution.states[3]).max():.2f} of 0.90 rad")

axes = plt.figure().add_subplot(aspect="equal", xlabel="x [m]", ylabel="y [m]")
for bed in beds:
    axes.add_patch(plt.Circle(bed, 1.2, color="0.75"))
for node in (0, 8, 12, 17, 21, 30):
    a, b, car, bend, _ = solution.states[:, node]
    look = {"alpha": 0.6, "facecolor": plt.cm.viridis(node / 31), "edgecolor": "k"}
    for angle, back, length in ((car, -0.7, 4.0), (car - bend, -4.6, 3.2)):
        look |= {"angle": np.degrees(angle), "rotation_point": (a, b)}
        axes.add_patch(plt.Rectangle((a + back, b - 1.1), length, 2.2, **look))
axes.plot(*solution.path.states[:2], "k", linewidth=1)
plt.show()
