"""Small random problems, each with two features of the library switched on."""

from collections.abc import Callable, Iterator
from itertools import combinations

import casadi as ca
import numpy as np
from numpy.random import Generator

from swarmstart.tests.ocp.feature_pairs.stated import Limited, Stated, Tabulated

Feature = Callable[[Stated, Generator], None]
OPEN = np.inf


def _named(*names: str) -> ca.SX:
    return ca.vertcat(*[ca.SX.sym(name) for name in names])


def _base(rng: Generator) -> Stated:
    """Return a damped double integrator, a pendulum or a unicycle, drawn."""
    intervals = int(rng.integers(6, 13))
    kind = rng.choice(["cart", "pendulum", "unicycle"])
    c, d = rng.uniform(0.5, 1.5, 2)
    if kind == "unicycle":
        x, u = _named("x", "y", "heading"), _named("speed", "turn")
        ode = ca.vertcat(u[0] * ca.cos(x[2]), c * u[0] * ca.sin(x[2]), u[1] - 0.1 * d)
        limits = np.array([-0.5, -1.5]), np.array([1.5, 1.5])
    else:
        x, u = _named("x", "v"), _named("force")
        pull = -d * x[1] if kind == "cart" else -2 * d * ca.sin(x[0])
        ode = ca.vertcat(x[1], c * u + pull)
        limits = np.array([-2.0]), np.array([2.0])
    nx, nu = x.numel(), u.numel()
    weights, target = rng.uniform(0.5, 2.0, nx), rng.uniform(-0.5, 0.5, nx)
    return Stated(
        states=x,
        controls=u,
        ode=ode,
        x0=rng.uniform(-0.6, 0.6, nx),
        limits=limits,
        horizon=float(rng.uniform(1.0, 2.0)),
        intervals=intervals,
        stage=ca.dot(weights, (x - target) ** 2) + 0.2 * ca.sumsqr(u),
        terminal=2 * ca.sumsqr(x - target),
        guess=rng.uniform(-0.2, 0.2, (nu, intervals)),
    )


def _end_time(s: Stated, rng: Generator) -> None:
    s.end_time = 0.6 * s.horizon, 1.5 * s.horizon
    s.stage += 0.3
    s.terminal += 3 * ca.sumsqr(s.states)


def _decided(s: Stated, rng: Generator) -> None:
    gain = ca.SX.sym("gain")
    s.decided["gain"] = gain, -0.5, 1.0
    s.ode[-1] += gain * s.states[0]
    s.terminal += float(rng.uniform(0.5, 1)) * (gain - 0.3) ** 2


def _known(s: Stated, rng: Generator) -> None:
    load = ca.SX.sym("load")
    s.parameters["load"] = load, float(rng.uniform(-0.5, 0.5))
    s.ode[-1] += load
    s.stage += load * s.states[0]


def _free_start(s: Stated, rng: Generator) -> None:
    first = s.states[0]
    s.start[(0,)] = float(s.x0[0]) - 0.3, float(s.x0[0]) + 0.5
    s.initial += (first - float(s.x0[0])) ** 2


def _tied_start(s: Stated, rng: Generator) -> None:
    s.x0[1] = s.x0[0]
    s.start[(0, 1)] = -1.0, 1.0
    s.initial += (s.states[0] - 0.2) ** 2


def _periodic(s: Stated, rng: Generator) -> None:
    s.start[(0,)] = -2.0, 2.0
    s.periodic = [0]


def _returning(s: Stated, rng: Generator) -> None:
    s.periodic = [0]


def _previous(s: Stated, rng: Generator) -> None:
    if not s.before.numel():
        s.before = ca.SX.sym("before", s.controls.numel())
        s.previous = rng.uniform(-0.3, 0.3, s.controls.numel())


def _moves(s: Stated, rng: Generator) -> None:
    _previous(s, rng)
    s.step += float(rng.uniform(0.1, 1)) * ca.sumsqr(s.controls - s.before)


def _delay(s: Stated, rng: Generator) -> None:
    _previous(s, rng)
    s.delay = int(rng.integers(1, 4))


def _rate_limit(s: Stated, rng: Generator) -> None:
    _previous(s, rng)
    most = float(rng.uniform(0.2, 0.5))
    s.path.append(Limited(s.controls[-1] - s.before[-1], -most, most))


def _discrete(s: Stated, rng: Generator) -> None:
    s.next_state = s.states + s.horizon / s.intervals * s.ode
    s.ode = ca.SX(0, 1)


def _jump(s: Stated, rng: Generator) -> None:
    kept = float(rng.uniform(0.75, 1.25))  # Limits hold before and after.
    last = kept * s.states[-1] + 0.05 * s.controls[-1]
    if s.wind.numel():
        last += 0.1 * s.wind
    s.next_state = ca.vertcat(s.states[:-1], last)


def _time(s: Stated, rng: Generator) -> None:
    s.time, s.clock = ca.SX.sym("t"), float(rng.uniform(0, 3))
    s.ode[-1] += 0.5 * ca.sin(2 * s.time)
    s.stage += 0.1 * ca.cos(s.time) * s.states[0]


def _wind(s: Stated, rng: Generator) -> None:
    s.wind = ca.SX.sym("wind")
    s.rows["wind"] = rng.uniform(-0.6, 0.6, s.nodes)
    s.ode[0] += s.wind


def _reference(s: Stated, rng: Generator) -> None:
    s.reference = ca.SX.sym("reference")
    s.rows["reference"] = rng.uniform(-1, 1, s.nodes)
    s.stage += (s.states[0] - s.reference) ** 2


def _moving_limit(s: Stated, rng: Generator) -> None:
    _reference(s, rng)
    s.rows["reference"] = np.linspace(0.4, 0.1, s.nodes)
    s.path.append(Limited(s.controls[0] - s.reference, -OPEN, 0.2))


def _tabulated(s: Stated, rng: Generator, method: str) -> None:
    grid = np.sort(np.append(rng.uniform(-1.5, 1.5, 4), [-4.0, -2.5, 2.5, 4.0]))
    grid = grid + 0.05 * np.arange(grid.size)
    symbol = ca.SX.sym(method)
    values = 0.4 * np.tanh(grid) + rng.uniform(-0.1, 0.1, grid.size)
    s.tables.append(Tabulated(symbol, (s.states[0],), (grid,), values, method))
    s.ode[-1] -= symbol


def _linear_table(s: Stated, rng: Generator) -> None:
    _tabulated(s, rng, "linear")


def _spline(s: Stated, rng: Generator) -> None:
    _tabulated(s, rng, "bspline")


def _surface(s: Stated, rng: Generator) -> None:
    grid = np.linspace(-4, 4, 6), np.linspace(-5, 5, 5)
    symbol, values = ca.SX.sym("surface"), rng.uniform(0, 0.5, (6, 5))
    arguments = s.states[0], s.states[1]
    s.tables.append(Tabulated(symbol, arguments, grid, values, "bspline"))
    s.stage += symbol


def _path(s: Stated, rng: Generator) -> None:
    most = float(s.x0[-1] ** 2 + rng.uniform(0.0, 0.05))
    s.path.append(Limited(s.states[-1] ** 2, -OPEN, most))


def _mixed(s: Stated, rng: Generator) -> None:
    mixed = s.controls[-1] + 0.5 * s.states[-1]
    s.path.append(Limited(mixed, -0.6, float(rng.uniform(0.1, 0.6))))


def _softly(s: Stated, rng: Generator, prices: tuple[float, float]) -> None:
    most = float(s.x0[-1] + rng.uniform(-0.1, 0.2))
    s.path.append(Limited(s.states[-1], -OPEN, most, prices))


def _soft(s: Stated, rng: Generator) -> None:
    _softly(s, rng, (float(rng.uniform(0.2, 1)), 0.0))


def _soft_square(s: Stated, rng: Generator) -> None:
    _softly(s, rng, (0.1, float(rng.uniform(1, 5))))
    s.path.append(Limited(s.controls[0] + s.states[0], -0.2, 0.2, (0.0, 1.0)))


def _ceiling(s: Stated, rng: Generator) -> None:
    if not s.time.numel():
        s.time, s.clock = ca.SX.sym("t"), float(rng.uniform(0, 3))
    s.ceiling = 0.4 + 0.3 * ca.sin(3 * s.time)


def _gain(s: Stated, rng: Generator) -> None:
    s.maximize = True


def _tied(s: Stated, rng: Generator) -> None:
    """Add a control that is tied to another."""
    trim = ca.SX.sym("trim")
    s.controls = ca.vertcat(s.controls, trim)
    s.limits = np.append(s.limits[0], -2.0), np.append(s.limits[1], 2.0)
    s.guess = np.vstack([s.guess, 0.5 * s.guess[:1]])
    s.ode[-1] += 0.3 * trim
    s.path.append(Limited(trim - 0.5 * s.controls[0], 0.0, 0.0))


def _target(s: Stated, rng: Generator) -> None:
    end = float(s.x0[0] + 0.1)
    s.ends.append(Limited(s.states[0], end, end))


def _end_range(s: Stated, rng: Generator) -> None:
    s.ends.append(Limited(s.states[0] + s.states[1] ** 2, -0.3, 0.3))


def _initial(s: Stated, rng: Generator) -> None:
    s.initial += float(rng.uniform(0.5, 1)) * (s.states[-1] - 0.4) ** 2
    s.start[(s.states.numel() - 1,)] = -1.0, 1.0


def _step(s: Stated, rng: Generator) -> None:
    s.step += 0.1 * ca.sumsqr(s.controls) * (1 + s.states[0] ** 2)


def _left(s: Stated, rng: Generator) -> None:
    s.quadrature = "left"


def _right(s: Stated, rng: Generator) -> None:
    s.quadrature = "right"


def _checks(s: Stated, rng: Generator) -> None:
    s.checks = int(rng.integers(2, 4))


def _euler(s: Stated, rng: Generator) -> None:
    s.integrator = "euler"


def _stiff(s: Stated, rng: Generator) -> None:
    s.integrator = "stiff"
    s.ode[-1] -= 20 * (s.states[-1] - 0.2 * ca.sin(s.states[0]))


def _bounded(s: Stated, rng: Generator) -> None:
    room = float(rng.uniform(0.05, 0.2))
    s.bounds[s.states.numel() - 1] = float(s.x0[-1]) - 0.4, float(s.x0[-1]) + room


def _unbounded(s: Stated, rng: Generator) -> None:
    s.limits = np.full(s.controls.numel(), -OPEN), np.full(s.controls.numel(), OPEN)


def _algebraic(s: Stated, rng: Generator) -> None:
    z = ca.SX.sym("z")
    solution = (s.controls[0] - s.states[0]) / (2 + s.states[1] ** 2)
    residual = (2 + s.states[1] ** 2) * z + s.states[0] - s.controls[0]
    s.solved = z, residual, solution
    s.ode[-1] += 0.5 * z
    s.stage += 0.1 * z**2


def _as_function(s: Stated, rng: Generator) -> None:
    s.as_function = True


FEATURES: dict[str, Feature] = {
    "checks": _checks,  # First: it says how many nodes the signals have.
    "tied controls": _tied,
    "free end time": _end_time,
    "decided parameter": _decided,
    "known parameter": _known,
    "free start": _free_start,
    "tied start": _tied_start,
    "free initial cost": _initial,
    "periodic state": _periodic,
    "returning state": _returning,
    "penalised moves": _moves,
    "rate limit": _rate_limit,
    "delay": _delay,
    "time in rates": _time,
    "signal in rates": _wind,
    "signal in cost": _reference,
    "moving limit": _moving_limit,
    "linear table": _linear_table,
    "bspline": _spline,
    "spline surface": _surface,
    "path inequality": _path,
    "mixed inequality": _mixed,
    "terminal equality": _target,
    "terminal range": _end_range,
    "step cost": _step,
    "left sums": _left,
    "right sums": _right,
    "euler": _euler,
    "stiff": _stiff,
    "bounds of states": _bounded,
    "soft constraint": _soft,
    "soft, squared": _soft_square,
    "moving bound": _ceiling,
    "maximise": _gain,
    "unbounded controls": _unbounded,
    "algebraic variable": _algebraic,
    "ode as a function": _as_function,
    "jump": _jump,  # Last: they take the rates as they are.
    "discrete time": _discrete,
}
APART = (
    {"discrete time", "jump", "free end time", "stiff", "euler", "ode as a function"},
    {"free start", "tied start", "periodic state", "returning state"},
    {"free initial cost", "tied start", "returning state", "bounds of states"},
    {"left sums", "right sums"},
    {"euler", "stiff"},
    {"signal in cost", "moving limit"},
    {"ode as a function", "signal in rates", "algebraic variable"},
    {"periodic state", "returning state", "terminal equality", "terminal range"},
    {"delay", "free end time"},
    {"delay", "algebraic variable"},
)
"""Sets of which no two go together, because they write the same entry, or cannot."""


MEETING = (
    ("checks", "stiff"),
    ("checks", "tied controls"),
    ("delay", "jump"),
    ("delay", "penalised moves"),
    ("delay", "right sums"),
    ("delay", "discrete time"),
    ("discrete time", "path inequality"),
    ("free end time", "time in rates"),
    ("free end time", "periodic state"),
    ("jump", "bounds of states"),
    ("jump", "path inequality"),
    ("jump", "signal in rates"),
    ("left sums", "signal in cost"),
    ("right sums", "signal in cost"),
)
"""Pairs that meet in one place of the code, compared in any case."""


def go_together(first: str, second: str) -> bool:
    """Return whether two features may stand in one problem."""
    both = {first, second}
    if both <= APART[0]:
        return "discrete time" not in both and both not in (
            {"euler", "stiff"},
            {"jump", "ode as a function"},
        )
    return not any(both <= apart for apart in APART[1:])


def pairs(rng: Generator) -> Iterator[tuple[str, str]]:
    """Yield pairs of features without end: every feature once, then again.

    None comes twice before all have come.
    """
    names, used = list(FEATURES), set[frozenset[str]]()
    every = [p for p in combinations(names, 2) if go_together(*p)]
    while True:
        left = [p for p in every if frozenset(p) not in used]
        if not left:
            used.clear()
            continue
        taken: set[str] = set()
        for number in rng.permutation(len(left)):
            pair = left[number]
            if not taken & set(pair):
                taken |= set(pair)
                used.add(frozenset(pair))
                yield pair


def drawn(names: tuple[str, ...], rng: Generator) -> Stated:
    """Return a random problem with some features."""
    stated = _base(rng)
    for name, feature in FEATURES.items():
        if name in names:
            feature(stated, rng)
    stated.names = names
    return stated
