"""What reconfigurations and transfers must reach: a bar is a command and a bound."""

from swarmstart.benchmarks.bars import Bar
from swarmstart.benchmarks.flights import Job

FIRST, SECOND = "reconfiguration", "reconfiguration_reverse"
LSHADE = ("search={name: lshade, size: 100}",)
REFERENCE = ("reference=ipopt",)
POLISHED = ("polish=ipopt",)
HARD = ("order={name: feasibility_first}",)
GENTLE = (*HARD, "vehicle.bank_rad=[-radians(3), radians(3)]", "steps=12")
STRAIGHT = ("vehicle.bank_rad=[-1e-9, 1e-9]",)

Bound = tuple[str, str, float | tuple[float, float]]


def _bars(name: str, job: Job, *bounds: Bound, seeds: int = 10) -> list[Bar]:
    return [
        Bar(name=name, job=job, measure=m, relation=r, bound=b, seeds=seeds)
        for m, r, b in bounds
    ]


_DISTANCES: tuple[Bound, ...] = (
    ("min_distance_m", ">=", 5),
    ("max_distance_m", "<=", 50),
    ("penalty_max", "<=", 0),
)
_COSTS: tuple[Bound, ...] = tuple(
    (f"cost_per_horizon[{k}]", "+-", bound)
    for k, bound in enumerate([(756.4, 1), (342, 2), (111, 2), (7.9, 0.8)])
)
_REFERENCE = {
    FIRST: (756.338, 342.008, 111.175, 7.905),
    SECOND: (755.639, 341.949, 110.228, 7.833, 0.747),
}


def _along_the_reference(scenario: str) -> list[Bar]:
    """J* to 1e-3 and L-SHADE's gap, where the best plan known is flown."""
    job = Job(scenario, (*LSHADE, *REFERENCE, "polish=ipopt"), "literal")
    best: list[Bound] = [
        (f"best_cost_per_horizon[{k}]", "+-", (value, 1e-3 * value))
        for k, value in enumerate(_REFERENCE[scenario])
    ]
    return _bars("reference", job, *best, ("search_gap_max", "<=", 1e-6), seeds=3)


BARS: list[Bar] = [
    *_bars(
        "literal", Job(FIRST, variant="literal"), ("position_error_m", "<=", 1.5),
        *_COSTS, *_DISTANCES,
    ),
    *_bars(
        "literal", Job(SECOND, variant="literal"), ("position_error_m", "<=", 0.8),
        ("cost_per_horizon[4]", "<=", 1.5), ("cost_rises", "<=", 0), *_DISTANCES,
    ),
    *_bars(
        "no turns", Job(FIRST, STRAIGHT, "literal"),
        ("position_error_m", "+-", (15.2, 0.05)), seeds=1,
    ),
    *_along_the_reference(FIRST),
    *_along_the_reference(SECOND),
    *_bars(
        "gap of DE", Job(FIRST, REFERENCE, "literal"), ("gap_max", "<=", 1), seeds=5
    ),
    *_bars(
        "gap of DE", Job(SECOND, REFERENCE, "literal"), ("gap_max", "<=", 1), seeds=5
    ),
    *_bars(
        "L-SHADE", Job(FIRST, (*LSHADE, "steps=10"), "literal"),
        ("position_error_m", "<=", 0.05),
    ),
    *_bars(
        "L-SHADE", Job(FIRST, (*LSHADE, "steps=20"), "literal"),
        ("position_error_m", "<=", 0.01),
    ),
    *_bars(
        "corrected", Job(FIRST, variant="corrected"), ("position_error_m", "<=", 2.0),
        *_DISTANCES,
    ),
    *_bars(
        "corrected", Job(SECOND, variant="corrected"), ("position_error_m", "<=", 1.5),
        *_DISTANCES,
    ),
    *_bars(
        "corrected, polished", Job(FIRST, POLISHED, "corrected"),
        ("position_error_m", "<=", 2.0),
    ),
    *_bars(
        "corrected, polished", Job(SECOND, POLISHED, "corrected"),
        ("position_error_m", "<=", 1.5),
    ),
    *_bars(
        "3 degrees, p = 5",
        Job(FIRST, (*GENTLE, "prediction.intervals=5"), "literal", ipopt=True),
        ("cost_rises", "<=", 0), ("position_error_m", "<=", 0.15), seeds=1,
    ),
    *_bars(
        "3 degrees, p = 1", Job(FIRST, GENTLE, "literal", ipopt=True),
        ("cost_rises", ">=", 1), seeds=1,
    ),
    *_bars(
        "swap of 5, at the checks", Job("swap_5", ("repair=false",)),
        ("cost", "<=", 0.390), ("violation", "<=", 1e-4),
    ),
    *_bars(
        "swap of 8, at the checks", Job("swap_8", ("repair=false",)),
        ("cost", "<=", 1.51), ("violation", "<=", 1e-4), seeds=5,
    ),
    *_bars(
        "swap of 5, on the path", Job("swap_5"), ("confirmed", ">=", 1),
        ("min_distance_m", ">=", 4.9995),
    ),
    *_bars(
        "a hundred", Job("formation_100"), ("min_distance_m", ">=", 5),
        ("max_link_distance_m", "<=", 50), ("position_error_m", "<=", 0.1),
        ("infeasible_steps", "<=", 0), seeds=5,
    ),
]  # fmt: skip
