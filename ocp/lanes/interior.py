"""Many instances of one problem solved at once, by an interior-point method in lanes.

An instance has an initial state, parameters and perhaps signals of its own. Every lane
runs IPOPT's method with a Riccati recursion (interior_kernels.py). Lanes are
independent: an answer has the same bits whatever the other lanes solve, and for any
number of threads. However, numbers are divided by the sizes of one instance of a call:
with other instances in the call, all numbers, and so the last digits of answers, may
differ.

Some lanes are solved side by side in one memory, whose rows have names (blocks.py).
Names of an interval: x, xa (state after it), u, w (slacks and elastic variables), m
(multipliers of its rows), lam (multiplier of F(x, u) - xa = 0), z (duals); the steps of
these, which begin with "d."; and of the recursion k, K (step of u: k + K dx, with dx
the step of x) and V, v (lam after the step: V dxa + v, with dxa the step of xa). Names
of the ends: y (decisions about the start), x0, end, and w, m, z of both ends. Names of
a lane: those of interior_verdict.py.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.scan import MOST_INSTRUCTIONS
from swarmstart.ocp.lanes.answers import LaneAnswers, joined
from swarmstart.ocp.lanes.barrier import RELAXED
from swarmstart.ocp.lanes.blocks import (
    NEXT,
    Job,
    Layout,
    kernel_sizes,
    placed,
    results_of,
)
from swarmstart.ocp.lanes.interior_kernels import (
    OF_LANE,
    Interior,
    compile_interior,
    require_short,
)
from swarmstart.ocp.lanes.interior_parts import Places, places_of
from swarmstart.ocp.lanes.interior_verdict import AIMED
from swarmstart.ocp.lanes.kernels import Kernel
from swarmstart.ocp.lanes.posed import NoLanesError, Posed, posed, refused_by_lanes
from swarmstart.ocp.lanes.turns import Rows, take_turns
from swarmstart.ocp.nlp.transcription import NonlinearProgram, multiple_shooting
from swarmstart.ocp.rollout.fitness import Arguments, Known, at_nodes, shared_arguments
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.tape import UnknownOperationError

TOLERANCE = 1e-8
"""Largest scaled error at which a lane ends."""
MOST = 300
"""Largest number of steps of a lane."""
FIRST_MU, FIRST_RHO = 1e-2, 1.0
"""First parameter of the central path, and first price of broken rows, for a cost of
size 1 at the start. A large mu leads away from the start, to an optimum that may be a
worse one."""
LEAST_UNIT, SAYING = 1e-8, 1e-6
"""Least unit of the cost, and least cost of a start that may be the unit, both relative
to the natural size of the cost. If a problem has limits, the cost of a start says less
about the cost of the optimum, so the unit is at least `LIMITED`."""
LIMITED = 1e-2
_CACHE = 1 << 20
"""Size of the memory of the lanes that are solved side by side [bytes], about that of a
core's own cache."""
_FEWEST, _MOST_SIDE_BY_SIDE = 8, 32
_CHUNK = 1 << 26
"""Size of the numbers that starts are made of [bytes]."""
_EXAMINED = 16
"""Largest number of instances that are asked for their sizes."""
_FAR = 1e3
"""Ratio of a size to the median of all instances above which its instance is not the
one whose sizes are taken."""
_WIDEST = 700.0
"""Largest logarithm of a size; that of an infinite one would not be finite."""
_SWEPT = 8
"""Least ratio of instructions, those of a sweep over an interval by those of the
interval (16 to 80 were seen). So sweeps that must be too long are refused without
counting their instructions, which would take seconds."""
_TURNS = 64
"""Number of turns between two checks for Ctrl-C."""
BLANK = {
    "tries": 1.0, "paid": np.inf, "worst": np.inf, "filter_theta": 1e300,
    "filter_phi": 1e300, "theta_most": 1e300,
}  # fmt: skip
"""First value of the numbers of a lane that do not begin at 0. The first trial of a
lane has the length 0."""
_KEPT = "u", "y", "x", "end", "paid", "worst", "iterations", "met", "force_start"


class Instances(NamedTuple):
    """Data of M instances of a problem after all rewrites (core).

    Attributes:
        x0: Initial states, with the guesses of the decisions about them, shape (nx, M).
        parameters: Parameters, shape (np, M).
        signals: `ca.vec` of the signals at the nodes, shape (ns * nodes, M).
    """

    x0: Array
    parameters: Array
    signals: Array

    def known(self, problem: OptimalControlProblem, number: int) -> Known:
        """Return the known data of an instance of the core.

        Args:
            problem: The rewritten problem (core).
            number: Number of the instance.
        """
        return Known(
            self.parameters[:, number], at_nodes(problem, self.signals[:, number])
        )

    def at(self, chosen: "slice | NDArray[np.int64]") -> "Instances":
        """Return some of the instances."""
        return Instances(*(one[:, chosen] for one in self))


class Common(NamedTuple):
    """The numbers that instances have in common.

    Attributes:
        posed: Sizes, and numbers that all lanes share.
        own_signals: Whether each instance has its own signals.
    """

    posed: Posed
    own_signals: bool


class InteriorLanes:
    """Local solves of many instances of one problem.

    Attributes:
        problem: The problem after all rewrites (core).
    """

    def __init__(
        self,
        problem: OptimalControlProblem | Shooting,
        *,
        program: NonlinearProgram | None = None,
        tolerance: float = TOLERANCE,
        most: int = MOST,
        longest: int = MOST_INSTRUCTIONS,
    ) -> None:
        """Derive the functions of the lanes; they are compiled when first needed.

        Args:
            problem: The problem, or its functions.
            program: NLP of the problem, if it is built already.
            tolerance: Largest scaled error at which a lane ends.
            most: Largest number of steps of a lane.
            longest: Largest number of instructions of an interval's part of a kernel.

        Raises:
            NoLanesError: If the problem has a feature that lanes do not support.
        """
        shooting = shooting_of(problem)
        reason = refused_by_lanes(shooting.problem)
        if reason:
            raise NoLanesError(reason)
        self.problem = shooting.problem
        self._program = program or multiple_shooting(shooting)
        self._arguments, self._sizing = Arguments(shooting), shooting.sizing
        self._tolerance, self._most, self._longest = tolerance, most, longest
        self._made = dict[bool, _Made]()

    def __call__(  # noqa: PLR0913 - instances and their starts
        self,
        instances: Instances,
        controls: Array,
        starts: Array,
        states: Array | None = None,
        *,
        common: Common | None = None,
        mu: float | None = None,
        rho: float = FIRST_RHO,
        threads: int = 1,
    ) -> LaneAnswers:
        """Return the local optima that starts lead to.

        Args:
            instances: The instances.
            controls: Controls, shape (nu, N, M), finite.
            starts: Decisions about the start, shape (ny, M), one row for each of
                `problem.free_starts`.
            states: Guess of the states between intervals, shape (nx, N + 1, M); None:
                those that the controls lead to.
            common: Result of the method `common` for these instances, or for more that
                include them; its sizes decide the last digits. None: it is computed for
                these instances.
            mu: First value of the central path's parameter, for a cost of size 1 at the
                start; small for starts near an optimum. None: FIRST_MU.
            rho: First price of broken rows, for a cost of size 1 at the start.
            threads: Largest number of threads.

        Raises:
            NoLanesError: If machine code cannot be made.
        """
        if not controls.shape[2]:
            return _none(self.problem, controls, starts)
        one, own_signals = common or self.common(instances)
        made = self._made_for(own_signals)
        count = max(1, _CHUNK // (8 * made.given))
        found = []
        for first in range(0, controls.shape[2], count):
            part = slice(first, first + count)
            guess = None if states is None else states[:, :, part]
            chunk = _Chunk(
                made, one, instances.at(part), controls[:, :, part],
                starts[:, part], guess, mu, rho,
            )  # fmt: skip
            found.append(chunk.solved(threads))
        return joined(found)

    def common(self, instances: Instances) -> Common:
        """Return the numbers that instances have in common, and compile the code.

        Args:
            instances: The instances, at least one.

        Raises:
            NoLanesError: If machine code cannot be made.
        """
        own_signals = bool(np.any(instances.signals != instances.signals[:, :1]))
        self._made_for(own_signals)
        return Common(self._posed(instances), own_signals)

    def repeated(
        self, x0: ArrayLike, known: Known, count: int
    ) -> tuple[Instances, Common]:
        """Return one instance several times, for as many starts.

        Args:
            x0: Initial state of the rewritten problem (core), shape (nx,).
            known: Values of the parameters and signals.
            count: Number of times.
        """
        instances = Instances(*(
            np.repeat(np.reshape(one, (-1, 1)), count, axis=1)
            for one in shared_arguments(self.problem, x0, known)
        ))  # fmt: skip
        one = posed(self._program, self._arguments, x0, known)
        return instances, Common(one, own_signals=False)

    def kernels(self) -> Interior[Kernel]:
        """Return the machine code for instances with the same signals.

        Raises:
            NoLanesError: If the code cannot be made.
        """
        return self._made_for(own_signals=False).kernels

    def sizes(self, x0: ArrayLike, known: Known) -> Sizes:
        """Return the sizes of one instance, which numbers are divided by."""
        return self._arguments.sizes(x0, known)

    def _made_for(self, own_signals: bool) -> "_Made":
        if own_signals not in self._made:
            interval = self._program.parts.interval.values.n_instructions()
            try:
                require_short(interval, self._longest // _SWEPT)
                places = places_of(self._program)
                kernels = compile_interior(
                    places,
                    own_signals=own_signals,
                    tolerance=self._tolerance,
                    most=self._most,
                    longest=self._longest,
                )
            except (NoCompilerError, UnknownOperationError) as error:
                raise NoLanesError(str(error)) from error
            self._made[own_signals] = _Made.of(places, kernels, own_signals)
        return self._made[own_signals]

    def _posed(self, instances: Instances) -> Posed:
        """Return what all instances share, with sizes that suit all of them.

        The sizes are those of the instance with the largest size of the cost. Instances
        that are far from the others, or not finite, are not considered: with the sizes
        of a state at 1e8, all other instances would seem to meet their limits.
        """
        problem = self.problem
        able = np.flatnonzero(np.isfinite(np.vstack(instances)).all(axis=0))
        if not able.size:  # The first one is refused, with a reason.
            able = np.arange(instances.x0.shape[1])
        places = np.linspace(0, able.size - 1, min(able.size, _EXAMINED)).astype(int)
        numbers = able[np.unique(places)].tolist()
        asked = instances.at(np.array(numbers))
        signals = at_nodes(problem, asked.signals)
        sizes = self._sizing.of_all(asked.x0, asked.parameters, signals)
        logs = np.log([
            np.concatenate([one.states, one.controls, 1 / one.weights, [one.cost]])
            for one in sizes
        ])  # fmt: skip
        logs = np.clip(logs, -_WIDEST, _WIDEST)
        apart = (logs - np.median(logs, axis=0)).max(axis=1)
        costs = [one.cost for one in sizes]
        largest = numbers[int(np.argmax(np.where(apart <= np.log(_FAR), costs, 0)))]
        return posed(
            self._program,
            self._arguments,
            instances.x0[:, largest],
            instances.known(problem, largest),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """The machine code of a problem's lanes.

    Attributes:
        places: The parts of the problem.
        kernels: The machine code.
        layout: Layout of the memory.
        rows: Rows that the loop reads.
        given: Number of rows that hold the numbers of a start.
        own_signals: Whether each lane has its own signals.
    """

    places: Places
    kernels: Interior[Kernel]
    layout: Layout
    rows: Rows
    given: int
    own_signals: bool

    @staticmethod
    def of(places: Places, kernels: Interior[Kernel], own_signals: bool) -> "_Made":
        """Return the machine code with its layout."""
        layout, rows = _layout_of(kernels)
        given = sum(layout.places[name][1] for name in _given(places))
        return _Made(places, kernels, layout, rows, given, own_signals)


def has_limits(places: Places) -> bool:
    """Return whether a problem has rows with limits, or bounds of states."""
    nx, parts = places.nx, (places.interval, places.end, places.begin)
    bounded = any(entry < nx for entry in places.interval.walls.own.of)
    return bounded or any(part.walls.height for part in parts)


def _given(places: Places) -> list[str]:
    """Return the names of the numbers of a start."""
    ends = [f"{place}.{name}" for place in ("begin", "end") for name in ("w", "z")]
    known = [
        name
        for place in (places.interval, places.end, places.begin)
        for name in place.known
        if name.split(".")[1] in OF_LANE
    ]
    return [
        "fixed", "x", "xa", "u", "w", "z", "y", "x0", "end", "mu", "rho", *ends, *known,
    ]  # fmt: skip


def state_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names x whose new value after a trial has the name "next.x".

    Those in `AIMED` come first, which a sweep (the computation of Newton's step)
    writes.
    """
    found = [name.removeprefix(NEXT) for name in names if name.startswith(NEXT)]
    return *AIMED, *(name for name in found if name not in AIMED)


def _layout_of(kernels: Interior[Kernel]) -> tuple[Layout, Rows]:
    """Return the rows that kernels need, and those that the loop reads."""
    sizes = kernel_sizes(kernels[3:])
    state = state_names(sizes)
    named = [
        *state, *(f"next.{name}" for name in state), *(f"aim.{name}" for name in AIMED),
    ]  # fmt: skip
    named += [name for name in sizes if name not in named]
    layout = placed(named, sizes)
    places = layout.places
    at = {name: place for name, (place, _) in places.items()}
    size = sum(places[name][1] for name in state)
    rows = Rows(
        state=0, aim=at[f"aim.{AIMED[0]}"], aims=len(AIMED), following=size, size=size,
        tries=at["tries"], taken=at["taken"], done=at["done"],
    )  # fmt: skip
    return layout, rows


class _Chunk:
    """Some instances, whose starts are in memory at the same time."""

    def __init__(  # noqa: PLR0913, PLR0917 - instances and their starts
        self,
        made: _Made,
        one: Posed,
        instances: Instances,
        controls: Array,
        starts: Array,
        states: Array | None,
        mu: float | None,
        rho: float,
    ) -> None:
        """Scale the starts and move them inside the bounds."""
        self._made, self._posed, self._instances = made, one, instances
        self._shared = shared_numbers(one, made.places)
        M, nx, N = controls.shape[2], one.x0.size, one.intervals
        scaled = instances.x0 / one.sizes.states[:, None]
        tied = one.tied.sum(axis=1) > 0
        numbers = {
            "fixed": np.where(tied[:, None], 0.0, scaled),
            "u": one.scaled(controls),
            "y": starts / one.start_sizes,
            "mu": np.full((1, M), FIRST_MU if mu is None else mu),
            "no_cost": np.zeros((1, M)),
            "no_slope": np.zeros((1, M)),
            "rho": np.full((1, M), rho),
            "rolled": np.full((1, M), float(states is None)),
            "xa": np.zeros((N * nx, M)),
        }
        if states is not None:
            inner = states[:, 1:] / one.sizes.states[:, None, None]
            numbers["xa"] = np.moveaxis(inner, 1, 0).reshape(N * nx, M)
        for place in ("interval", "end", "begin"):
            numbers[f"{place}.parameters"] = instances.parameters
            numbers[f"{place}.unit"] = np.ones((1, M))
        if made.own_signals:
            for place, own in _signals(one, instances.signals).items():
                numbers[f"{place}.signals"] = own
                # Kernels must not find those that all would share.
                self._shared.pop(f"{place}.signals", None)
        for kernel in made.kernels[:3]:
            numbers |= self._evaluated(kernel, numbers)
        size = np.nan_to_num(numbers["size"], nan=1.0)
        least = LEAST_UNIT
        if has_limits(made.places):
            size = np.where(size < SAYING, 1.0, size)
            least = LIMITED
        self._unit = np.where(size > 0, size, 1.0).clip(least, 1.0)
        for place in ("interval", "end", "begin"):
            numbers[f"{place}.unit"] = self._unit
        self._numbers = numbers

    def _evaluated(
        self, kernel: Kernel, numbers: Mapping[str, Array]
    ) -> dict[str, Array]:
        own = kernel.code.shape.per_individual
        arguments = [
            np.ascontiguousarray(numbers[name] if is_own else self._shared[name])
            for name, is_own in zip(kernel.reads, own, strict=True)
        ]
        return dict(zip(kernel.writes, kernel.code.evaluate(arguments), strict=True))

    def solved(self, threads: int) -> LaneAnswers:
        """Return the answers."""
        made, posed = self._made, self._posed
        names = _given(made.places)
        if made.own_signals:
            names += [n for n in made.layout.places if n.endswith(".signals")]
        names = [name for name in names if name in made.layout.places]
        given = np.vstack([self._numbers[name] for name in names])
        fit = _CACHE // (8 * made.layout.size)
        job = Job(
            kernels=made.kernels[3:], layout=made.layout, rows=made.rows,
            shared=self._shared, blank=_blank(made.layout), given=given, brought=names,
            kept=_KEPT, loop=take_turns, turns=_TURNS,
            side_by_side=max(_FEWEST, min(fit, _MOST_SIDE_BY_SIDE)),
        )  # fmt: skip
        u, y, x, end, paid, worst, iterations, met, force = results_of(job, threads)
        unit = self._unit[0] * posed.sizes.cost
        nu = posed.sizes.controls.size
        low, high = (
            (side[:nu] * posed.sizes.controls)[:, None, None]
            for side in (posed.least, posed.most)
        )
        return LaneAnswers(
            controls=np.clip(posed.controls(u), low, high),
            starts=np.clip(y, *posed.first_limits) * posed.start_sizes,
            states=posed.states(x, end),
            cost=paid[0] * unit,
            violation=worst[0],
            iterations=iterations[0].astype(np.int64),
            optimal=met[0] > 0,
            costates=force * unit / posed.sizes.states[:, None],
        )


def shared_numbers(posed: Posed, places: Places) -> dict[str, Array]:
    """Return the arguments that all lanes share, by their names in kernels."""
    numbers = dict[str, Array]()
    for place in (places.interval, places.end, places.begin):
        known = getattr(posed, place.name)
        if known is None:
            numbers |= {
                f"{place.name}.{side}": np.zeros(0) for side in ("lower", "upper")
            }
            continue
        shared, signals, *limits = known
        lower, upper = (np.array(side[: place.walls.height]) for side in limits)
        equal = np.equal(lower, upper)
        count = place.given["parameters"].numel()
        numbers[f"{place.name}.shared"] = shared[count:]
        numbers[f"{place.name}.signals"] = signals
        numbers[f"{place.name}.lower"] = np.where(equal, lower, _relaxed(lower, -1))
        numbers[f"{place.name}.upper"] = np.where(equal, upper, _relaxed(upper, 1))
    bounds = {
        "least": (posed.least, -1), "most": (posed.most, 1),
        "x_least": (posed.x_least, -1), "x_most": (posed.x_most, 1),
    }  # fmt: skip
    first = {
        "first_least": (posed.first_least, -1),
        "first_most": (posed.first_most, 1),
    }
    for at, sides in (("interval", bounds), ("begin", first)):
        for name, (side, sign) in sides.items():
            numbers[f"{at}.{name}"] = _relaxed(side, sign)
    return {
        name: np.ascontiguousarray(one, dtype=np.float64)
        for name, one in numbers.items()
    }


def _relaxed(side: Array, sign: float) -> Array:
    """Return limits a little wider."""
    return np.asarray(side + sign * RELAXED * np.maximum(1.0, np.abs(side)))


def _signals(posed: Posed, signals: Array) -> dict[str, Array]:
    """Return the signals of intervals and ends, a column for each instance."""
    if not signals.size:
        return {}
    nodes = posed.windows
    M = signals.shape[1]
    at = signals.reshape((-1, nodes[-1][-1] + 1, M), order="F")
    own = [np.swapaxes(at[:, window], 0, 1).reshape(-1, M) for window in nodes]
    return {"interval": np.concatenate(own), "end": at[:, -1], "begin": at[:, 0]}


def _blank(layout: Layout) -> Array:
    """Return the initial memory of a lane."""
    blank = np.zeros(layout.size)
    for name, value in BLANK.items():
        blank[layout.at(name)] = value
    return blank


def _none(
    problem: OptimalControlProblem, controls: Array, starts: Array
) -> LaneAnswers:
    """Return the answers of no instances."""
    nothing = np.zeros(0)
    return LaneAnswers(
        controls=controls,
        starts=starts,
        states=np.zeros((problem.model.nx, problem.intervals + 1, 0)),
        cost=nothing,
        violation=nothing,
        iterations=np.zeros(0, dtype=np.int64),
        optimal=np.zeros(0, dtype=np.bool_),
    )
