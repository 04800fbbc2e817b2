"""All sequences of modes: closed forms, another integrator, and the default solve."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp

from swarmstart.benchmarks.hard.enumeration import (
    SwitchedSystem,
    all_costs,
    car,
    optimum,
)
from swarmstart.cases.commands.front.cli import main

CONSTANTS = {
    "hill": 0.9, "length": 8.0, "phase": 2.0, "drag": 0.06, "width": 0.7, "shift": 0.3,
}  # fmt: skip


def heater(fee: float = 0.0) -> SwitchedSystem:
    """Return x' = s - x with s = 0 or 1, to end at 0.4; switches cost a fee."""
    return SwitchedSystem(
        rates=lambda state, mode: mode - state,
        start=np.array([0.0]),
        modes=np.array([0.0, 1.0]),
        previous=0,
        dt=0.5,
        switch_cost=lambda before, after: fee * abs(after - before),
        terminal_cost=lambda state: (state[0] - 0.4) ** 2,
    )


def test_costs_of_a_linear_system_are_those_of_its_closed_form() -> None:
    costs, decay = all_costs(heater(0.01), 5), np.exp(-0.5)
    for modes in product((0, 1), repeat=5):
        x, fees = 0.0, 0.01 * np.abs(np.diff([0, *modes])).sum()
        for mode in modes:
            x = mode + (x - mode) * decay
        assert costs[modes] == pytest.approx((x - 0.4) ** 2 + fees, abs=1e-10)


def test_costs_of_the_car_are_those_of_another_integrator() -> None:
    system = car(CONSTANTS)
    costs = all_costs(system, 4)
    for gears in [(1, 1, 2, 3), (3, 2, 1, 1), (2, 3, 3, 2)]:
        state, cost, before = system.start, 0.0, 1
        for gear in gears:
            held = np.array([gear])
            piece = solve_ivp(
                lambda _, s, held=held: system.rates(s[:, None], held)[:, 0],
                (0, 1), state, method="DOP853", rtol=1e-11, atol=1e-11,
            )  # fmt: skip
            state, cost = piece.y[:, -1], cost + 0.3 * (gear - before) ** 2
            before = gear
        cost -= state[0] + state[1] ** 2 / 2
        assert costs[tuple(gear - 1 for gear in gears)] == pytest.approx(cost, abs=1e-8)


def test_optimum_is_the_least_and_local_optima_are_counted() -> None:
    costs = all_costs(car(CONSTANTS), 5)
    best = optimum(car(CONSTANTS), 5)
    assert best.cost == costs.min()
    assert costs[tuple(int(gear) - 1 for gear in best.modes)] == best.cost
    assert best.second == np.sort(costs, axis=None)[1]

    def is_local(modes: tuple[int, ...]) -> bool:
        others = (
            costs[(*modes[:k], mode, *modes[k + 1 :])]
            for k in range(5)
            for mode in range(3)
        )
        return bool(costs[modes] <= min(others))

    count = sum(is_local(modes) for modes in product(range(3), repeat=5))
    assert best.local_optima == count > 1


def test_shifts_that_cost_more_are_fewer() -> None:
    shifts = []
    for shift in (0.0, 0.3, 10.0):
        modes = optimum(car(CONSTANTS | {"shift": shift}), 6).modes
        shifts.append(float(np.abs(np.diff([1, *modes])).sum()))
    assert shifts == sorted(shifts, reverse=True)
    assert shifts[-1] == 0


def document(intervals: int) -> str:
    return yaml.safe_dump(
        {
            "kind": "problem",
            "constants": CONSTANTS,
            "definitions": {
                "ratio": "0.6**(gear - 1)",
                "pull": "ratio*exp(-((ratio*v - 1)/width)**2)",
                "slope": "hill*sin(2*pi*x/length + phase)",
            },
            "states": {
                "x": {"start": 0, "rate": "v"},
                "v": {"start": 1, "rate": "pull - drag*v - slope"},
            },
            "controls": {"gear": {"bounds": [1, 3], "integer": True, "previous": 1}},
            "step_cost": "shift*(gear - previous(gear))**2",
            "terminal_cost": "-x - v**2/2",
            "prediction": {
                "horizon_s": float(intervals), "intervals": intervals, "substeps": 20,
            },
        },
        sort_keys=False,
    )  # fmt: skip


@pytest.mark.parametrize("intervals", [6, 8])
def test_default_solve_finds_the_best_sequence(
    intervals: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "car.yaml"
    file.write_text(document(intervals), encoding="utf-8")
    options = ("--json", "--no-figures", "--seed", "0", "--out", str(tmp_path / "out"))
    main(["run", str(file), *options])
    cost = json.loads(capsys.readouterr().out)["measures"]["cost"]
    best = optimum(car(CONSTANTS), intervals)
    # 20 steps of RK4 in an interval are wrong by 1e-6, sequences differ by 1e-2.
    assert cost == pytest.approx(best.cost, abs=1e-5)
    assert best.second - best.cost > 1e-2


def test_too_many_sequences_are_refused() -> None:
    with pytest.raises(ValueError, match="at most 2000000 sequences, got 14 intervals"):
        all_costs(car(CONSTANTS), 14)
