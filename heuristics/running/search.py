"""Ask and tell: a search one generation at a time.

A generation is `points = search.ask()`, then `search.tell(*objective(points))`; the
best point so far is `search.best`.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arguments import (
    MOST_WORK,
    RNG,
    a_count,
    a_number,
    checked,
    either,
    mapping,
    of_kind,
    optional,
    reals,
)
from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.laws.algorithm import (
    ALGORITHM,
    MOST_NUMBERS,
    Algorithm,
    InvalidSettingsError,
    State,
    first_size_of,
    require,
)
from swarmstart.heuristics.laws.box import Box, InvalidPointsError
from swarmstart.heuristics.laws.initial import Initial, Values, initial_population
from swarmstart.heuristics.laws.order import Order
from swarmstart.heuristics.running.ahead import compiled_ahead, helper_runs
from swarmstart.heuristics.running.archive import Archive, collect, new_archive
from swarmstart.heuristics.running.budget import GOES_ON, Limits, finished
from swarmstart.heuristics.running.compiled_loop import (
    Call,
    CompiledObjective,
    Entries,
    Work,
    calls_of,
    loop,
    new_work,
)
from swarmstart.heuristics.running.interrupts import put_off
from swarmstart.heuristics.searches.arguments import default_order
from swarmstart.machine_code import (
    Pointers,
    address_of,
    compiling,
    is_kept,
    is_kernel,
    prepare,
    stopwatch,
)

ROOM = 4
"""The archive holds this many times the requested basins, since merging basins frees
places that cannot be refilled."""

Snapshot = Mapping[str, NDArray[np.generic]]
"""The whole state of a search, as arrays; save it by np.savez(file, **snapshot)."""


class AskTellError(SwarmstartError, RuntimeError):
    """`ask` and `tell` were not called in turn."""


class InvalidEvaluationError(SwarmstartError, ValueError):
    """The objective did not return a cost and a violation of each individual.

    Attributes:
        name: Name of the wrong value: "cost", "violation", or "objective" if the result
            is not a pair.
    """

    def __init__(self, message: str, *, name: str) -> None:
        """Store the message and the name."""
        super().__init__(message)
        self.name = name


class InvalidSnapshotError(SwarmstartError, ValueError):
    """A snapshot is not of a search with the same arguments."""


class Individual(NamedTuple):
    """A point with its cost and violation.

    Attributes:
        x: The point, shape (dim,).
        cost: Cost of the point.
        violation: Violation of the point, at least 0; 0 = feasible.
    """

    x: Array
    cost: float
    violation: float


@checked(
    InvalidSettingsError,
    algorithm=ALGORITHM,
    box=of_kind(Box, "a Box"),
    rng=RNG,
    order=optional(of_kind(Order, "an order as feasibility_first() makes it")),
    initial=optional(either(of_kind(Initial, "an Initial"), reals())),
    evaluations=optional(a_count(least=1, most=MOST_WORK)),
    basins=a_count(),
    radius=a_number(above=0, finite=False),
    snapshot=optional(mapping(words="a snapshot of a search")),
)
class Search:
    """A search, driven one generation at a time by `ask` and `tell`.

    Attributes:
        algorithm: Settings of the algorithm.
        box: The box that is searched.
        order: The order of individuals.
        rng: Source of randomness; the search advances it.
        compile_seconds: Wall time spent on machine code so far [s].

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> box = ss.Box(lower=[-1, -1], upper=[2, 2])
        >>> search = ss.Search(ss.LSHADE(size=20), box, rng=np.random.default_rng(0))
        >>> for _ in range(100):
        ...     population = search.ask()  # (dim, size)
        ...     cost = (population**2).sum(axis=0)
        ...     search.tell(cost, np.zeros_like(cost))
        >>> bool(search.best.cost < 1e-6)
        True
    """

    def __init__(  # noqa: PLR0913 - what a search can be told, by name
        self,
        algorithm: Algorithm,
        box: Box,
        *,
        rng: np.random.Generator,
        order: Order | None = None,
        initial: Initial | ArrayLike | None = None,
        evaluations: int | None = None,
        basins: int = 0,
        radius: float = 0.1,
        snapshot: Snapshot | None = None,
    ) -> None:
        """Draw the initial population, or continue from a snapshot.

        Args:
            algorithm: Settings of the algorithm.
            box: The box to search.
            rng: Source of randomness, kept and advanced.
            order: Order of individuals; None means `default_order()`.
            initial: Options of the initial population, or points that become its first
                columns, shape (dim, k), in the box; copied. None means `Initial()`.
            evaluations: Budget in evaluations, for algorithms whose population depends
                on it; None if it is not known.
            basins: Number of best distinct basins that are kept (`archive`).
            radius: Least distance between two of these basins, a fraction of the box's
                widths.
            snapshot: Snapshot of a search with the same arguments, which is continued
                bit for bit: the state of `rng` is set too. It excludes `initial`.

        Raises:
            InvalidPointsError: If initial points do not fit the box or the population.
            InvalidSettingsError: If the settings do not fit the box, an argument is of
                the wrong type, or both `initial` and `snapshot` are given.
            InvalidSnapshotError: If the snapshot is of another search.
        """
        if initial is not None and snapshot is not None:
            allowed = "None if snapshot is given"
            raise InvalidSettingsError("initial", initial, allowed)
        _require_basins(basins, box)
        self.algorithm = algorithm
        self.box = box
        self.order = default_order() if order is None else order
        self.rng = rng
        self._order = self.order.running()
        self._settings = algorithm.kernel_settings(box, self._order)
        if not hasattr(self._settings, "order"):
            allowed = "an algorithm whose kernel_settings have the field 'order'"
            raise InvalidSettingsError("algorithm", algorithm, allowed)
        self._basins = basins
        self._archive = new_archive(box, room=ROOM * basins, radius=float(radius))
        self.compile_seconds = 0.0
        self._known: Values | None = None
        self._asked: Array | None = None
        self._entries: Entries | None = None
        self._attached: tuple[CompiledObjective, Work, Pointers] | None = None
        size = first_size_of(algorithm, box, evaluations)
        if snapshot is not None:
            blank = np.zeros((box.dim, size))
            # On a copy: a snapshot that is refused leaves the generator as it is.
            template = algorithm.start(box, blank, rng=copy.deepcopy(rng))
            self._state = self._restored(snapshot, template)
            return
        given = initial if isinstance(initial, Initial) else Initial(points=initial)
        population, self._known = initial_population(box, size, given, rng=rng)
        with put_off(), stopwatch() as watch:
            self._state = algorithm.start(box, population, rng=rng)
        self.compile_seconds = watch.compile_seconds
        # If all costs are known, nothing of generation 0 is left to evaluate.
        if self._known is not None and self._known[0].size == size:
            self.ask()
            self.tell([], [])

    @property
    def state(self) -> State:
        """A copy of the algorithm's state, a NamedTuple of plain arrays."""
        return copy.deepcopy(self._state)

    @property
    def best(self) -> Individual:
        """The best individual so far; its cost is infinite if none was finite."""
        state = self._state
        return Individual(
            x=state.best.copy(),
            cost=float(state.best_cost[0]),
            violation=float(state.best_violation[0]),
        )

    @property
    def basins(self) -> tuple[Individual, ...]:
        """The best distinct basins met so far, the best first; see `archive`."""
        kept = self._archive
        return tuple(
            Individual(
                x=kept.points[:, k].copy(),
                cost=float(kept.cost[k]),
                violation=float(kept.violation[k]),
            )
            for k in range(min(int(kept.members[0]), self._basins))
        )

    @property
    def size(self) -> int:
        """Number of individuals of the next generation that are to be evaluated."""
        return int(self._state.size[0]) - self._known_count

    @property
    def _known_count(self) -> int:
        """Number of individuals of the next generation whose costs are known."""
        return 0 if self._known is None else self._known[0].size

    @property
    def generations(self) -> int:
        """Number of generations whose values were given to `tell`."""
        return int(self._state.generation[0])

    @property
    def evaluations(self) -> int:
        """Number of individuals whose values were given to `tell`."""
        return int(self._state.evaluations[0])

    @property
    def nonfinite(self) -> int:
        """Number of individuals so far whose cost or violation was not finite."""
        return int(self._state.nonfinite[0])

    def finished(self, limits: Limits) -> int:
        """Return whether and why the search ends here, a code of `budget`."""
        if not self.generations:
            return GOES_ON
        return finished(self._order, self._state, limits)

    @checked(
        InvalidSettingsError,
        progress=optional(a_number(least=0, most=1)),
        suggested=optional(reals(array=True)),
    )
    def ask(
        self, *, progress: float | None = None, suggested: Array | None = None
    ) -> Array:
        """The next generation to evaluate.

        Args:
            progress: Fraction of the budget used, in [0, 1]; falling inertia and
                shrinking populations depend on it. None leaves it as it was; it starts
                at 0.
            suggested: Points in the box, shape (dim, k), found by other means, that
                replace the last individuals. If there are more points than individuals,
                the first ones are taken. None means no points.

        Returns:
            The points as columns, shape (dim, size): a new array, read-only.
            Individuals of the initial population whose costs are known are left out.

        Raises:
            AskTellError: If `tell` was not called yet for the last generation.
            InvalidPointsError: If suggested points have another shape, or are not in
                the box.
            InvalidSettingsError: If progress is not in [0, 1], or points are suggested
                for the initial population or to an algorithm that samples a
                distribution.
        """
        if self._asked is not None:
            raise AskTellError("ask() before tell(): a generation is not evaluated yet")
        if suggested is not None:
            self._require_suggestible(suggested)
        if progress is not None:
            if not 0.0 <= progress <= 1.0:
                raise InvalidSettingsError("progress", progress, "in [0, 1]")
            self._state.progress[0] = progress
        self._state = _with_room(self._state)
        propose = self.algorithm.kernels.propose
        self._asked = np.empty((self.box.dim, int(self._state.size[0])))
        with put_off():  # See `interrupts`: an exception in Numba is a crash.
            propose(self.rng, self._settings, self._state, self._asked)
        if suggested is not None:
            taken = suggested[:, : self._asked.shape[1]]
            self._asked[:, self._asked.shape[1] - taken.shape[1] :] = taken
        points = self._asked[:, self._known_count :].copy()
        points.setflags(write=False)
        return points

    def _require_suggestible(self, suggested: Array) -> None:
        """Validate points suggested for the next generation."""
        first = not self.generations
        # A distribution is updated by the points that were sampled from it.
        samples = "sampled" in _fields(self._state)
        allowed = "None for an algorithm that samples, and in the initial population"
        require("suggested", suggested, ok=not (first or samples), allowed=allowed)
        shape = np.shape(suggested)
        if len(shape) != 2 or shape[0] != self.box.dim:  # noqa: PLR2004
            raise InvalidPointsError(
                f"suggested must have shape ({self.box.dim}, k), got {shape}",
                shape=shape,
            )
        outside = np.flatnonzero(~self.box.contains(suggested))
        if outside.size:
            raise InvalidPointsError(
                f"suggested must lie in the box, columns {outside.tolist()} do not",
                shape=shape,
            )

    def tell(self, cost: ArrayLike, violation: ArrayLike) -> None:
        """Give the costs and violations of the generation asked last.

        Args:
            cost: Costs, shape (size,); NaN and infinity rank last. Copied.
            violation: Violations, shape (size,), at least 0. Copied.

        Raises:
            AskTellError: If no generation was asked.
            InvalidEvaluationError: If a shape is wrong or a violation is negative.
        """
        if self._asked is None:
            raise AskTellError("tell() before ask(): there is nothing to evaluate")
        known = self._known_count
        size = self._asked.shape[1] - known
        cost = _evaluations("cost", cost, size)
        violation = _evaluations("violation", violation, size)
        if self._known is not None:
            cost = np.concatenate([self._known[0], cost])
            violation = np.concatenate([self._known[1], violation])
        if np.any(violation < 0.0):
            raise InvalidEvaluationError(
                f"violation must be at least 0, got {np.nanmin(violation)}",
                name="violation",
            )
        accept = self.algorithm.kernels.accept
        with put_off():
            accept(self._settings, self._state, self._asked, cost, violation)
            collect(self._order, self._archive, self._asked, cost, violation)
            self._state.evaluations[0] -= known  # They were not evaluated here.
            self._asked = self._known = None

    def abandon(self) -> None:
        """Drop the generation whose values were not given to `tell`, if there is one.

        The next `ask` makes another one, with the random numbers that follow.
        """
        self._asked = None

    def loop(
        self,
        objective: CompiledObjective,
        *,
        generations: int,
        limits: Limits,
        progress: float,
    ) -> Work | None:
        """Ask, evaluate and tell several generations in compiled code.

        Args:
            objective: A compiled objective.
            generations: Largest number of generations.
            limits: Limits of the search.
            progress: Fraction of the budget used so far, in [0, 1]; with a limit of
                evaluations it is computed anew for each generation.

        Returns:
            The history that the loop wrote. None if the loop did not run, since the
            objective cannot be called from compiled code, or costs of the initial
            population are known.

        Raises:
            AskTellError: If `tell` was not called yet for the last generation.
        """
        if self._asked is not None:
            raise AskTellError(
                "loop() before tell(): a generation is not evaluated yet"
            )
        if self._known is not None:
            return None
        self._state = _with_room(self._state)
        attached = self._attached_to(objective)
        if attached is None:
            return None
        memory, pointers = attached
        work = memory._replace(
            best_cost=np.empty(generations),
            best_violation=np.empty(generations),
            evaluations=np.empty(generations, dtype=np.int64),
        )
        self._state.progress[0] = progress
        given = self._looped()
        with put_off():
            loop(*given, work, pointers, limits)
        return work

    def prepare(self, *, compiled: bool) -> None:
        """Compile or load all kernels of a run beforehand.

        Args:
            compiled: Whether the generations are run by `loop`.
        """
        with stopwatch() as watch, compiling():
            jobs = self.preparations(compiled=compiled)
            if helper_runs() or not self.is_prepared(compiled=compiled):
                with compiled_ahead(self.algorithm, compiled=compiled) as helper:
                    for k, job in enumerate(jobs):
                        if k not in helper.part:
                            job()
                    helper.wait()
            # What the helper has done is loaded; if it failed, it is done here.
            for job in jobs:
                job()
        self.compile_seconds += watch.compile_seconds

    def preparations(self, *, compiled: bool) -> list[Callable[[], object]]:
        """Return the tasks of `prepare`, for propose, accept, collect and the loop."""
        calls = self._calls()
        if not compiled:
            return [partial(prepare, kernel, *given) for kernel, given in calls]
        if not all(is_kernel(kernel) for kernel, _ in calls):
            allowed = "an algorithm whose kernels numba.njit compiles"
            raise InvalidSettingsError("algorithm", self.algorithm, allowed)
        jobs = [partial(address_of, kernel, *given) for kernel, given in calls]
        looped = (
            *(self.rng, self._settings, (self._state, self._archive)),
            *(Entries(0, 0, 0), new_work(self.box.dim, 0, 0)),
            *(Pointers(0, 0, 0), Limits(0, 0.0, 0)),
        )
        return [*jobs, partial(prepare, loop, *looped)]

    def _calls(self) -> list[Call]:
        searched = self._state, self._archive
        return calls_of(self.algorithm.kernels, self.rng, self._settings, searched)

    def is_prepared(self, *, compiled: bool) -> bool:
        """Return whether the largest kernel is compiled already."""
        propose, given = self._calls()[0]
        return is_kept(propose, *given, for_kernel=compiled)

    def _looped(
        self,
    ) -> tuple[np.random.Generator, Any, tuple[State, Archive], Entries]:
        """Return the first arguments of the compiled loop."""
        if self._entries is None:
            addresses = (address_of(kernel, *given) for kernel, given in self._calls())
            self._entries = Entries(*addresses)
        searched = self._state, self._archive
        return self.rng, self._settings, searched, self._entries

    def _attached_to(
        self, objective: CompiledObjective
    ) -> tuple[Work, Pointers] | None:
        """Return memory for a generation, bound to an objective; it is reused.

        None if the objective cannot be called from compiled code.
        """
        size = int(self._state.size[0])
        kept = self._attached
        if kept is None or kept[0] is not objective or kept[1].cost.size < size:
            work = new_work(self.box.dim, size, 0)
            pointers = objective.attach(work.asked, work.cost, work.violation)
            if pointers is None:
                return None
            kept = self._attached = (objective, work, pointers)
        return kept[1:]

    def snapshot(self) -> dict[str, NDArray[np.generic]]:
        """Return a copy of the whole state, to save and continue from.

        Raises:
            AskTellError: If the values of a generation were not given to `tell` yet, or
                if costs of the initial population are known and `ask` was not called
                yet.
        """
        if self._asked is not None or self._known is not None:
            raise AskTellError("snapshot() before tell(): a generation is under way")
        # The states of some generators, such as MT19937, contain arrays.
        rng = json.dumps(self.rng.bit_generator.state, default=np.ndarray.tolist)
        return {
            **{f"arguments.{n}": np.array(a) for n, a in self._arguments().items()},
            **{f"state.{name}": a.copy() for name, a in _fields(self._state).items()},
            **{f"basins.{n}": a.copy() for n, a in _fields(self._archive).items()},
            "order.level": self._order.level.copy(),
            "rng": np.array(rng),
        }

    def _restored(self, snapshot: Snapshot, template: State) -> State:
        """Take over the content of a snapshot; return the state."""
        try:
            for name, own in self._arguments().items():
                kept = str(snapshot[f"arguments.{name}"])
                if kept != own:
                    raise ValueError(f"{name} is {own}, that of the snapshot {kept}")
            state = _filled(template, "state", snapshot)
            self._archive = _filled(self._archive, "basins", snapshot)
            self._order.level[:] = snapshot["order.level"]
            self.rng.bit_generator.state = json.loads(str(snapshot["rng"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidSnapshotError(
                f"snapshot must be of a search with the same arguments: {error}"
            ) from error
        return state

    def _arguments(self) -> dict[str, str]:
        """Return the arguments that a search shares with its snapshots, as text."""
        return {
            "algorithm": repr(self.algorithm),
            "box": repr((self.box.lower.tolist(), self.box.upper.tolist())),
            "order": repr(self.order),
            "basins": repr(self._basins),
            "radius": repr(float(self._archive.radius[0])),
        }


def _fields(record: object) -> dict[str, Array]:
    """Return the arrays of a NamedTuple by name."""
    arrays: dict[str, Array] = record._asdict()  # type: ignore[attr-defined]
    return arrays


Record = TypeVar("Record")


def _with_room(state: State) -> State:
    """Return the state with room for the next generation in its array `sampled`.

    Kernels cannot replace an array, so the array in which a state keeps individuals
    from propose to accept grows here: shape (dim, at least the size), its contents
    lost. The compiled loop returns before it needs more room.
    """
    kept, size = _fields(state).get("sampled"), int(state.size[0])
    if kept is None or kept.shape[1] >= size:
        return state
    grown = np.zeros((kept.shape[0], size))
    replaced: State = state._replace(sampled=grown)  # type: ignore[attr-defined]
    return replaced


def _filled(template: Record, prefix: str, snapshot: Snapshot) -> Record:
    """Return a record of the template's kind with the snapshot's arrays.

    Raises:
        KeyError: If an array is missing.
        ValueError: If an array has another type or another number of dimensions.
    """
    arrays = {}
    for name, like in _fields(template).items():
        array = np.array(snapshot[f"{prefix}.{name}"], order="C")
        if array.dtype != like.dtype or array.ndim != like.ndim:
            raise ValueError(f"{prefix}.{name} is {array.dtype}, {array.shape}")
        arrays[name] = array
    return type(template)(**arrays)


def _evaluations(name: str, values: ArrayLike, size: int) -> Array:
    """Copy costs or violations; raise InvalidEvaluationError unless they are `size`."""
    try:
        array = np.array(values)
        if array.dtype.kind not in "biuf":
            raise TypeError("text and complex numbers are not converted")
        array = array.astype(np.float64)
    except (TypeError, ValueError) as error:
        message = f"{name} must be an array of {size} numbers: {error}"
        raise InvalidEvaluationError(message, name=name) from error
    if array.shape != (size,):
        message = f"{name} must have shape ({size},), got {array.shape}"
        raise InvalidEvaluationError(message, name=name)
    return array


def _require_basins(basins: int, box: Box) -> None:
    """Refuse an invalid number of basins, or one whose archive would not fit."""
    most = MOST_NUMBERS // (ROOM * box.dim)
    allowed = f"at most {most} with {box.dim} variables"
    require("basins", basins, ok=basins <= most, allowed=allowed)
