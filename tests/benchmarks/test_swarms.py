"""The measurement of swarms: what is drawn, what counts, and what the page says."""

import numpy as np

import swarmstart as ss
from swarmstart.benchmarks.swarms import (
    APART,
    CLUTTER,
    DELAYED_HUNDRED,
    DISTANCE,
    HUNDRED,
    SCALE,
    TWENTY,
    UNICYCLES,
    WEDGE,
    Trial,
    flown,
    gate_table,
    page,
    transition,
    wedge,
)


def test_draws_have_room_and_are_the_same_for_the_same_seed() -> None:
    swarm = transition(12, 3.0, 4, clutter=5)
    for places in (swarm.starts, swarm.goals):
        apart = np.linalg.norm((places[:, None] - places) * SCALE, axis=2)
        assert apart[~np.eye(12, dtype=bool)].min() >= APART * DISTANCE
    assert len(swarm.obstacles) == 5
    assert (transition(12, 3.0, 4, clutter=5).starts == swarm.starts).all()


def test_the_wedge_is_that_of_the_flight_without_messages() -> None:
    swarm = wedge()
    assert swarm.size == 100
    # The leader is in front, and has the goal of the first slot, at which it stands.
    ahead = int(swarm.goals[:, 0].argmax())
    assert swarm.goals[ahead, :2].tolist() in swarm.starts[:, :2].tolist()
    # Rows of 1, 3, 5, ... UAVs, 15 m apart.
    rows = np.unique(swarm.goals[:, 0], return_counts=True)
    assert (np.diff(rows[0]) == 15).all()
    assert rows[1][::-1].tolist() == [2 * k + 1 for k in range(10)]


def test_page_counts_collisions_with_and_without_acceptances() -> None:
    swarm, links = transition(3, 3.0, 0), ss.Links(most_delay=1)
    safe = flown(swarm, links, 0)
    assert safe.all_arrive
    assert safe.step_ms > 0
    rules = [("delays", "acknowledged", [safe]), ("delays", "hearsay", [safe, safe])]
    names = (TWENTY, HUNDRED, DELAYED_HUNDRED, CLUTTER, UNICYCLES, WEDGE, "another")
    rows = {name: [safe] for name in names}
    said = page(rules, rows, (8.0, [9.0, 9.4]), "the command")
    assert said[0].startswith(
        "If a vehicle changes its plan only after all others have accepted the new one "
        "(rule `acknowledged`), 0 of 8 flights have a collision, and 100.0% of the "
        "vehicles arrive; by rules without acceptances 0 of 2 flights have one."
    )
    assert "arrives after 9 to 9.4 s in 2 runs." in said[-1]
    assert "| delays | hearsay | 2 | 0 | 2 |" in "\n".join(gate_table(rules))


def test_a_flight_that_comes_too_near_is_a_collision() -> None:
    links = ss.Links(most_delay=6, loss=0.3)
    trials = [flown(transition(10, 2.2, s), links, s, "hearsay", 0.3) for s in range(4)]
    row = gate_table([("delays", "hearsay", trials)])[-1]
    count = int(row.split("|")[4])
    assert count == sum(
        float(t.flight.apart.min()) < t.flight.swarm.distance for t in trials
    )
    assert count > 0
    assert isinstance(trials[0], Trial)
