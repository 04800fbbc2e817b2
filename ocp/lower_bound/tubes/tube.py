"""A moving polytope that holds every admissible trajectory.

    { x : D x <= s(t) },  s linear over slabs of time

d_k is row k of D, the outward direction of face k; s_k(t) is the level of this face.
Over each slab, s_k rises faster than

    r_k = max of d_k f(t, x, u) over  d_k x = s_k(t),  D x <= s(t),  all u,

and s(0) >= D x0, with f the right-hand side and x0 the initial state. r_k is bounded
from above by interval arithmetic with outward rounding (`faces.py`, `motion.py`). Then
no trajectory leaves the polytope: one that did would be on some faces at its last
moment inside. As f is continuous, d_k x rises more slowly than s_k on each of these
faces for some time, and the trajectory cannot reach the other faces at once. The bounds
of the states are part of the polytope here, with constant levels, since admissible
trajectories keep them.

r_k depends on the levels at the slab's end, which are raised until every level rises
fast enough; if that does not converge, the slab is halved. A face that does not touch
the polytope may move freely: it is tightened until it touches.

Source: Blanchini and Miani (2015), Set-Theoretic Methods in Control, section 4.2
(Nagumo's condition); Dang and Maler (1998), Reachability Analysis via Face Lifting.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.lower_bound.stated.answer import Tube
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes.faces import Template, rates_at_faces, template_of
from swarmstart.ocp.lower_bound.tubes.motion import PAD, Motion, motion_of
from swarmstart.terminal_set.interval_arithmetic import UnknownIntervalOperationError

SLABS = 100
CELLS = {1: 1, 2: 8, 3: 5}
"""Cells along each coordinate of a face, by the number of states."""
FACES = 32
"""Faces of a tube of two states. More of them make it tighter, and slower to handle:
the Van der Pol oscillator's x1 ends at most at 6.2 with 24, 5.3 with 32, 4.7 with 48.
"""
_EIGHTHS = 8
_ROUGHLY = 4
"""Ratio of slabs of the final tube and of the rough one, which gives the widths of the
states for the directions."""
_MOST_ALIKE = 2.0
"""Largest quotient of two widths of states that count as equal."""
_LEAST_WIDTH = 1e-4
"""Least width of a state that is used, relative to the largest one."""
_GREATEST = 1e6
"""Level, in sizes or in multiples of x0 (the larger), that counts as a blow-up."""
_ROUNDS = 12
"""Largest number of times that a slab's end is raised before the slab is halved."""
_DRAWN_IN = 3
"""Number of rounds in which faces are tightened; later rounds only raise."""
_BEYOND = 0.1
"""Fraction by which a raise is enlarged, so that the next round fits."""
_HALVINGS = 8
_MOST_EXCESS = 0.02
"""Relative excess of the polytope's width above which a slab is halved."""
_MOST_SLABS = 20
"""Largest number of slabs, in multiples of the requested number."""


@dataclass(eq=False)
class NoTubeError(SwarmstartError):
    """No set was found that holds the trajectories.

    Attributes:
        reason: The cause, and what would help: sentences.
    """

    reason: str

    def __str__(self) -> str:
        """Return the reason."""
        return self.reason


def tube_of(
    statement: Statement,
    *,
    slabs: int = SLABS,
    cells: int | None = None,
    faces: int = FACES,
) -> Tube:
    """Enclose all admissible trajectories of a statement.

    Args:
        statement: Statement with 1, 2 or 3 states.
        slabs: Number of pieces of time, at least 1; pieces that are too long are
            halved.
        cells: Number of parts of a face along each of its coordinates; None means
            CELLS.
        faces: Number of faces for two states, a multiple of 8, so that the diagonals
            are among them; there are 2 for one state, 26 for three. If the set's
            widths differ much, faces between the axes turn towards its narrow sides.

    Returns:
        The tube, from 0 to the latest end; proven, rounding included.

    Raises:
        NoTubeError: If there are more states, the dynamics jump or have an operation
            without interval form, or the trajectories cannot be bounded.
    """
    if statement.n not in CELLS:
        raise NoTubeError(f"A tube has 1 to 3 states; there are {statement.n}.")
    parts = CELLS[statement.n] if cells is None else cells
    if min(slabs, parts) < 1 or faces < _EIGHTHS or faces % _EIGHTHS:
        raise NoTubeError(
            "A tube needs at least 1 of slabs and cells, and a multiple of 8 of faces; "
            f"found {slabs}, {parts} and {faces}."
        )
    _require_numbers(statement)
    try:
        motion = motion_of(statement)
    except UnknownIntervalOperationError as error:
        raise NoTubeError(f"No set holds the trajectories for sure: {error}.") from None
    box = statement.state_box

    def found(directions: Array, slabs: int, excess: float = _MOST_EXCESS) -> Tube:
        template = template_of(directions, box)
        march = _March(
            statement=statement,
            motion=motion,
            template=template,
            cells=parts,
            most_excess=excess,
        )
        return _marched(march, slabs)

    plain = _directions(statement.n, faces)
    if statement.n == 1:
        return found(plain, slabs)
    try:
        few = max(1, slabs // _ROUGHLY)
        # Only its widths are used, so no slab is halved for its excess.
        rough = found(_directions(statement.n, _EIGHTHS), few, np.inf)
    except NoTubeError:
        return found(plain, slabs)
    return found(_scaled(plain, rough), slabs)


def _require_numbers(statement: Statement) -> None:
    """Validate that all numbers are finite."""
    low, high = statement.control_box
    for name, values in (
        ("the initial state", statement.x0),
        ("the bounds of the controls", np.concatenate([low, high])),
        ("the latest end", np.array(statement.horizon[1])),
    ):
        if not np.isfinite(values).all():
            raise NoTubeError(f"A tube needs {name} to be finite; found {values}.")
    if not statement.horizon[1] > 0:
        raise NoTubeError(f"The latest end must be above 0; it is {statement.horizon}.")


def _directions(n: int, faces: int) -> Array:
    """Return the directions of the faces, shape (K, n), the axes first."""
    axes = np.repeat(np.eye(n), 2, axis=0) * np.tile([1.0, -1.0], n)[:, None]
    if n == 1:
        return np.asarray(axes)
    if n < max(CELLS):
        angles = 2 * np.pi * np.arange(faces) / faces
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        is_axis = np.arange(faces) % (faces // 4) == 0
        return np.vstack([axes, circle[~is_axis]])
    signs = np.array(list(product([1.0, 0.0, -1.0], repeat=n)))
    mixed = signs[np.abs(signs).sum(axis=1) > 1]
    return np.vstack([axes, mixed / np.linalg.norm(mixed, axis=1)[:, None]])


def _scaled(directions: Array, rough: Tube) -> Array:
    """Return directions for a polytope as wide in each state as a rough tube.

    Faces at equal angles leave the corners of a long, thin set empty.
    """
    n = directions.shape[1]
    widths = (rough.levels[:, 0 : 2 * n : 2] + rough.levels[:, 1 : 2 * n : 2]).max(
        axis=0
    )
    if not 0.0 < widths.max() < np.inf:
        return directions
    widths = np.maximum(widths / widths.max(), _LEAST_WIDTH)
    if widths.min() * _MOST_ALIKE > 1.0:
        return directions
    mixed = directions[2 * n :] / widths
    return np.vstack(
        [directions[: 2 * n], mixed / np.linalg.norm(mixed, axis=1)[:, None]]
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _March:
    """The computation of a tube, slab after slab, with the data that slabs share."""

    statement: Statement
    motion: Motion
    template: Template
    cells: int
    most_excess: float

    def rates(self, times: tuple[float, float], start: Array, stop: Array) -> Array:
        """Return upper bounds of the outward rate at each face over a slab of time.

        Args:
            times: Beginning and end of the slab.
            start: Level of each face at the beginning, shape (K,).
            stop: Level of each face at the end, shape (K,).
        """
        return rates_at_faces(
            self.motion,
            self.template,
            times=times,
            levels=np.array([start, stop]),
            cells=self.cells,
        )


def _marched(march: _March, slabs: int) -> Tube:
    """Return the tube, slab by slab."""
    latest = march.statement.horizon[1]
    times, levels = [0.0], [_first_levels(march)]
    limit = _GREATEST * max(1.0, float(np.abs(march.statement.x0).max()))
    whole = latest / slabs
    step, least = whole, whole / 2**_HALVINGS
    # Rates of a very short slab are the first guess of how fast its end rises.
    rates = march.rates((0.0, least), levels[0], levels[0])
    while times[-1] < latest:
        # The last slab takes the rest of the time, rounding included.
        until = times[-1] + step
        stop = latest if until > latest - 0.25 * step else until
        found = _slab(march, (times[-1], stop), levels[-1], rates, limit)
        may_halve = step > least and len(times) < _MOST_SLABS * slabs
        if found is None:
            if not may_halve:
                raise NoTubeError(_blow_up(march, times[-1], levels[-1]))
            step *= 0.5
            continue
        after = march.rates((stop, stop + least), found, found)
        slope = (found - levels[-1]) / (stop - times[-1])
        part = _excess(march, found, slope, after, stop - times[-1], whole)
        if part > march.most_excess and may_halve:
            step *= 0.5
            continue
        rates = after
        times.append(stop)
        levels.append(found)
        step = min(whole, step * (2.0 if part < 0.25 * march.most_excess else 1.0))
    return Tube(
        directions=march.template.directions,
        times=np.array(times),
        levels=np.array(levels),
    )


def _excess(
    march: _March,
    levels: Array,
    slope: Array,
    after: Array,
    length: float,
    whole: float,
) -> float:
    """Return the excess width of a slab that is due to its linear levels.

    Args:
        march: The common parts of all slabs.
        levels: Levels at the slab's end.
        slope: Slopes of the levels.
        after: Rates at the slab's end.
        length: Length of the slab [s].
        whole: Length of a slab that is not halved [s].

    Returns:
        The excess, relative to the width of the polytope or to the distance that its
        fastest face moves in a whole slab, whichever is larger.
    """
    is_on = np.isfinite(after)
    if not is_on.any():
        return 0.0
    widths = levels + levels[march.template.opposite]
    scale = np.maximum(widths, whole * np.abs(after[is_on]).max())[is_on]
    excess = 0.5 * length * (slope - after)[is_on]
    return float((excess / np.maximum(scale, 1e-12)).max())


def _first_levels(march: _March) -> Array:
    """Return levels with x0 inside, rounding included."""
    terms = march.template.directions * march.statement.x0
    return np.asarray(terms.sum(axis=1) + PAD * np.abs(terms).sum(axis=1))


def _slab(
    march: _March,
    times: tuple[float, float],
    start: Array,
    expected: Array,
    limit: float,
) -> Array | None:
    """Return levels at the end of a slab that satisfy all rates.

    Args:
        march: The common parts of all slabs.
        times: Beginning and end of the slab.
        start: Levels at its beginning.
        expected: Expected rates; infinite if unknown.
        limit: Greatest level.

    Returns:
        The levels; None if none were found.
    """
    length, template = times[1] - times[0], march.template
    is_known = np.isfinite(expected)
    fastest = np.abs(expected[is_known]).max(initial=0.0)
    stop = template.tightened(start + length * np.where(is_known, expected, fastest))
    for number in range(_ROUNDS):
        rates = march.rates(times, start, stop)
        # A float quotient of differences has a relative error of a few 2^-53.
        slope = (stop - start) / length
        is_short = ~(slope - PAD * np.abs(slope) > rates)
        if not is_short.any():
            return stop
        least = start + length * rates
        if not (np.abs(least[is_short]) < limit).all():
            return None
        # More than any rounding, yet too little to matter.
        room = 1e-7 * length * np.abs(rates[is_short]).max()
        room += 1e-12 * (1.0 + template.reach(np.array([start, stop])))
        raised = np.where(is_short, least + room + _BEYOND * (least - stop), stop)
        if number < _DRAWN_IN:
            drawn = template.tightened(raised) + room
            raised = np.where(is_short, np.minimum(raised, drawn), raised)
        stop = np.maximum(stop, raised)
    return None


def _blow_up(march: _March, time: float, levels: Array) -> str:
    """Return a message: the state that could not be bounded, and what would help."""
    statement = march.statement
    axes = levels[: 2 * statement.n].reshape(-1, 2)
    grown = np.maximum(axes[:, 0] - statement.x0, axes[:, 1] + statement.x0)
    state = int(np.argmax(grown))
    size = statement.sizes[state]
    low, high = -axes[state, 1] * size, axes[state, 0] * size
    return (
        f"No set was found that holds the trajectories beyond t = {time:.6g} s: the "
        f"state {statement.states[state].name()}, from {low:.4g} to {high:.4g} there, "
        "cannot be bounded any longer. Bounds of the states would help, or a shorter "
        "horizon, or narrower bounds of the controls."
    )
