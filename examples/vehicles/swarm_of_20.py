"""Twenty drones change places
===========================

Twenty drones change places in a cube of 4 m, past three balls, one of which moves.
There are gusts, and 30 % of all messages are lost. Each drone plans by itself, and no
two may come nearer than 0.35 m. (A distance along z counts half.)

They keep 0.374 m if a drone follows a plan only after all others that may still change
theirs have accepted it. If each plan is followed at once, the rule `hearsay`, two pairs
come too near, and little time is saved. `ss.run` takes the shipped scenario and a
setting for its rule; `ss.simulate_swarm` does the same with places of your own.

Prints::

    acknowledged: 0 collisions, smallest distance 0.374 m, all arrived after 9.7 s
    hearsay: 2 collisions, smallest distance 0.206 m, all arrived after 9.1 s

The same as a shipped scenario: `swarmstart run swarm_20 --set rule=hearsay`.
"""

import matplotlib.pyplot as plt
import numpy as np

import swarmstart as ss

figure = plt.figure(figsize=(8, 3.8))
view = figure.add_subplot(1, 2, 1, projection="3d")
view.set_box_aspect((1, 1, 1), zoom=0.85)
right = figure.add_subplot(1, 2, 2, xlabel="time [s]", ylabel="smallest distance [m]")
for rule, style in (("acknowledged", "-"), ("hearsay", "--")):
    run = ss.run("swarm_20", seed=0, settings={"rule": rule})
    found = run.measures
    nearest, arrival = found["min_distance_m"], found["arrival_time_s"]
    print(
        f"{rule}: {found['collisions']} collisions, smallest distance {nearest:.3f} m, "
        f"all arrived after {arrival:.1f} s"
    )
    places = run.trajectory.dense_states.reshape(20, 6, -1)[:, :3]  # x, y, z [m]
    scaled = places * np.array([1, 1, 0.5])[:, None]
    apart = np.linalg.norm(scaled[:, None] - scaled, axis=2)
    apart[range(20), range(20)] = np.inf
    right.plot(run.trajectory.dense_times, apart.min(axis=(0, 1)), style, label=rule)
    if rule == "acknowledged":
        for x, y, z in places:
            view.plot(x, y, z, linewidth=1)
            view.plot(x[-1:], y[-1:], z[-1:], "ko", markersize=3)
view.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
right.axhline(0.35, color="0.5", linewidth=1)
right.legend()
plt.show()
