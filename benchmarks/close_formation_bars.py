"""What the close formation flights must reach: a bar is a command and a bound."""

from swarmstart.benchmarks.bars import Bar
from swarmstart.benchmarks.flights import Job

SCENARIO = "close_formation"
FAST = "close_formation_fast"
VORTEX = "close_formation_vortex"


def sampled(dt: float, *more: str) -> tuple[str, ...]:
    """Return the settings for 30 s of flight with another sampling time."""
    return f"prediction.dt_s={dt:g}", f"steps={round(30 / dt)}", *more


def horizon(p: int, *more: str) -> tuple[str, ...]:
    """Return the settings for a horizon of p steps."""
    return f"prediction.intervals={p}", *more


EXACT = ("prediction.kinematics=exact",)
BOTH_EXACT = (*EXACT, "plant.kinematics=exact")
GENTLE = ("search.F=0.5", "search.CR=0.9")
EULER = ("integrator=euler",)
REFERENCE = ("reference=ipopt",)
UNSEEDED = ("leader_as_candidate=false", "search.warm_start=none")

TEXT = Job(SCENARIO)
SOLVED = Job(SCENARIO, ipopt=True)


def _deterministic(
    name: str, job: Job, *bounds: tuple[str, str, float | tuple[float, float]]
) -> list[Bar]:
    return [
        Bar(name=name, job=job, measure=m, relation=r, bound=b, seeds=1)
        for m, r, b in bounds
    ]


def _stochastic(
    name: str,
    job: Job,
    *bounds: tuple[str, str, float | tuple[float, float]],
    over: str = "every",
) -> list[Bar]:
    return [
        Bar(name=name, job=job, measure=m, relation=r, bound=b, over=over)
        for m, r, b in bounds
    ]


DETERMINISTIC = [
    *_deterministic(
        "D4",
        SOLVED,
        ("x_settle_s", "+-", (8.8, 0.2)),
        ("y_settle_s", "+-", (8.6, 0.2)),
        ("x_max_dev_ft", "+-", (51.65, 0.2)),
        ("x_min_dev_ft", "+-", (-19.62, 0.3)),
        ("y_max_dev_ft", "+-", (16.79, 0.2)),
    ),
    *_deterministic(
        "D5",
        Job(SCENARIO, sampled(0.02), ipopt=True),
        ("x_settle_s", "+-", (6.78, 0.1)),
        ("x_min_dev_ft", ">=", -0.05),
    ),
    *_deterministic(
        "D5",
        Job(FAST, ipopt=True),
        ("x_settle_s", "+-", (10.32, 0.15)),
        ("x_min_dev_ft", ">=", -0.05),
    ),
    *_deterministic("D6", SOLVED, ("cost_rises", "+-", (44, 2))),
    *_deterministic(
        "D7", Job(SCENARIO, EULER, ipopt=True), ("x_rms_last_5s_ft", ">=", 45)
    ),
    *_stochastic("D7", Job(SCENARIO, EULER), ("x_rms_last_5s_ft", ">=", 45)),
    *_deterministic(
        "D8", Job(SCENARIO, horizon(30), ipopt=True), ("y_max_dev_ft", ">=", 20)
    ),
    *_deterministic(
        "D8",
        Job(SCENARIO, horizon(30, *BOTH_EXACT), ipopt=True),
        ("y_max_dev_ft", "<=", 4.5),
        ("x_settle_s", "<=", 6.0),
    ),
    *_deterministic(
        "D9",
        Job(SCENARIO, horizon(10, *BOTH_EXACT), ipopt=True),
        ("x_settle_s", "<=", 6.8),
        ("y_max_dev_ft", "<=", 3.5),
    ),
    *_deterministic(
        "D10",
        Job(VORTEX, ipopt=True),
        ("drag_saving_ideal_percent", "+-", (33.518, 0.001)),
        ("drag_saving_percent", "+-", (28.70, 0.1)),
    ),
    *_deterministic(
        "D10",
        Job(VORTEX, horizon(10, *EXACT), ipopt=True),
        ("drag_saving_percent", "+-", (33.09, 0.1)),
    ),
]

STOCHASTIC = [
    *_stochastic("S1", TEXT, ("x_settle_s", "<=", 10.5), ("y_settle_s", "<=", 9.5)),
    *_stochastic(
        "S1", TEXT, ("x_settle_s", "<=", 9.1), ("y_settle_s", "<=", 8.9), over="median"
    ),
    *_stochastic(
        "S2",
        TEXT,
        ("x_max_dev_ft", "+-", (51.7, 1.5)),
        ("x_min_dev_ft", "+-", (-19.5, 2.5)),
        ("y_max_dev_ft", "+-", (17, 0.8)),
    ),
    *_stochastic("S3", TEXT, *((f"{a}_rms_last_5s_ft", "<=", 0.06) for a in "xyz")),
    *_stochastic(
        "S4",
        Job(SCENARIO, REFERENCE),
        ("gap_relative_median", "<=", 1e-3),
        ("gap_absolute_median", "<=", 0.15),
        ("gap_absolute_p90", "<=", 0.5),
        ("gap_min", ">=", -1e-6),
    ),
    *_stochastic(
        "S5",
        Job(SCENARIO, sampled(0.02)),
        ("x_settle_s", "+-", (6.77, 0.1)),
        ("x_rms_last_5s_ft", "<=", 0.01),
    ),
    *_stochastic(
        "S5",
        Job(FAST),
        ("x_settle_s", "+-", (10.31, 0.1)),
        ("x_rms_last_5s_ft", "<=", 0.01),
        ("wall_s", "<", 15),
    ),
    Bar(
        name="S6",
        job=Job(SCENARIO, (*REFERENCE, *GENTLE)),
        against=Job(SCENARIO, REFERENCE),
        measure="gap_absolute_median",
        relation=">=",
        bound=50,
    ),
    Bar(
        name="S7",
        job=Job(SCENARIO, REFERENCE),
        against=Job(SCENARIO, (*REFERENCE, *UNSEEDED)),
        measure="gap_absolute_median",
        relation=">=",
        bound=3,
    ),
    *_stochastic(
        "S8", Job(SCENARIO, horizon(20)), ("settled", "<", 0.5), over="mean"
    ),
    *_stochastic(
        "S8", Job(SCENARIO, horizon(20, *BOTH_EXACT)), ("settled", "<", 0.5),
        over="mean",
    ),
    *_stochastic(
        "S8", Job(SCENARIO, horizon(20, *GENTLE)), ("x_settle_s", "<=", 9)
    ),
    *_stochastic(
        "S8", Job(SCENARIO, horizon(20, *BOTH_EXACT, *GENTLE)), ("x_settle_s", "<=", 9)
    ),
    *_stochastic(
        "S9", Job(VORTEX), ("drag_saving_percent", "+-", (28.7, 0.3)), over="median"
    ),
    *_stochastic("S9", Job(VORTEX), ("drag_saving_percent", "+-", (28.9, 0.6))),
    *_stochastic("S9", Job(VORTEX, EULER), ("drag_saving_percent", "<=", 13)),
    *_stochastic(
        "S10",
        Job(VORTEX, horizon(10, *EXACT, *GENTLE)),
        ("drag_saving_percent", ">=", 31.9),
        over="median",
    ),
    *_stochastic("S11", TEXT, ("same_again", ">=", 1)),
]  # fmt: skip

LITERAL_SOLVED = Job(SCENARIO, variant="literal", ipopt=True)
LITERAL = Job(SCENARIO, variant="literal")
AS_PRINTED = [
    *_deterministic(
        "literal",
        LITERAL_SOLVED,
        ("x_settle_s", "+-", (8.9, 0.2)),
        ("x_max_dev_ft", "+-", (52.4, 0.3)),
        ("z_max_ft", "<=", 1),
        ("steady_altitude_command_ft", "+-", (-12.8, 0.2)),
    ),
    *_stochastic("literal", LITERAL, ("x_settle_s", "<=", 10.5), ("z_max_ft", "<=", 1)),
    *_deterministic(
        "literal, Euler",
        Job(SCENARIO, EULER, variant="literal", ipopt=True),
        ("x_rms_last_5s_ft", ">=", 45),
    ),
    *_stochastic(
        "literal, Euler",
        Job(SCENARIO, EULER, variant="literal"),
        ("x_rms_last_5s_ft", ">=", 45),
    ),
]

# A full turn at 3 deg/s, from 5 s to 125 s, 50 ft/s faster within it.
TURN = Job(
    SCENARIO,
    (
        "steps=1500",
        "leader.between=linear",
        "leader.manoeuvre=["
        "{time_s: 0, speed_ft_s: 200, heading_rad: 0}, "
        "{time_s: 5, speed_ft_s: 200, heading_rad: 0}, "
        "{time_s: 45, speed_ft_s: 200, heading_rad: 2*pi/3}, "
        "{time_s: 65, speed_ft_s: 250, heading_rad: pi}, "
        "{time_s: 125, speed_ft_s: 250, heading_rad: 2*pi}]",
        "commands.heading_from=leader",
    ),
)
TURN_SOLVED = TURN._replace(ipopt=True)
TURNS = [
    *_deterministic(
        "full turn",
        TURN_SOLVED,
        ("position_error_late_ft", "<=", 1),
        ("error_in_turn_ft", "<=", 1),
    ),
    *_stochastic(
        "full turn",
        TURN,
        ("position_error_late_ft", "<=", 1),
        ("error_in_turn_ft", "<=", 1),
    ),
]

BARS: list[Bar] = [*DETERMINISTIC, *STOCHASTIC, *AS_PRINTED, *TURNS]

GUST_LEVELS_FT_S = (0, 3, 6, 12)
GUST_SEEDS = 20
WINGSPAN_FT = 30.0


def gust_job(level: float, p: int) -> Job:
    """Return the flight of the gust table: the vortex plant, exact kinematics."""
    gusts = (f"plant.gusts.sigma_ft_s={level:g}",)
    longer = horizon(p, *EXACT, *GENTLE) if p > 1 else ()
    return Job(VORTEX, (*gusts, *longer))


GUSTS: list[Bar] = [
    Bar(
        name="gusts",
        job=gust_job(level, 10),
        measure="min_range_ft",
        relation=">=",
        bound=WINGSPAN_FT,
        seeds=GUST_SEEDS,
    )
    for level in GUST_LEVELS_FT_S
]
