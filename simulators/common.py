"""Parts that all simulators share: an error, and checks of names, states and units."""

import difflib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import a_number
from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError, brief
from swarmstart.ocp.system import read_unit

NEAR = 1e-9
"""Largest difference of a start from the requested one, relative to it or to 1."""
LONGEST_STEP = 3600.0
"""Longest step [s]."""
STEP = a_number(above=0, most=LONGEST_STEP)
"""Lengths of a step [s]."""
_SHOWN = 20


class SimulatorError(SwarmstartError):
    """A simulator cannot be loaded, started or stepped as requested.

    Attributes:
        simulator: Name of the simulator: its file, command or aircraft.
    """

    def __init__(self, simulator: str, why: str) -> None:
        """Name the simulator."""
        super().__init__(f"{simulator}: {why}")
        self.simulator = simulator


def require_known(
    simulator: str, role: str, names: Iterable[str], known: Sequence[str]
) -> None:
    """Raise if a simulator lacks a name; the message suggests the nearest one.

    Raises:
        SimulatorError: If a name is not one of `known`.
    """
    for name in names:
        if name in known:
            continue
        near = difflib.get_close_matches(name, known, n=1)
        shown = ", ".join(known[:_SHOWN]) + (", ..." if len(known) > _SHOWN else "")
        hint = f"did you mean {near[0]!r}?" if near else f"it has {shown or 'none'}"
        raise SimulatorError(
            simulator, f"expected {role} of the simulator, found {name!r}; {hint}"
        )


def require_last(simulator: str, x: Array, last: ArrayLike | None) -> None:
    """Raise if a state is not the one that a simulator returned last.

    Raises:
        SimulatorError: If it is another state, or no run has begun.
    """
    if last is None:
        raise SimulatorError(
            simulator, "expected start_at() before a step; a failed step ends a run"
        )
    if not np.array_equal(x, last):
        raise SimulatorError(
            simulator,
            "expected the state that was returned last, since the simulator keeps its "
            f"own; found {brief(x.tolist())} for {brief(np.array(last).tolist())}; "
            "start_at() begins a new run",
        )


def vector(simulator: str, role: str, values: ArrayLike, names: Sequence[str]) -> Array:
    """Return finite numbers, one for each name.

    Raises:
        SimulatorError: If there are more or fewer, or one is not finite.
    """
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (len(names),) or not np.isfinite(found).all():
        raise SimulatorError(
            simulator,
            f"expected {len(names)} finite numbers as {role} ({', '.join(names)}), "
            f"found {brief(found.tolist())}",
        )
    return found


def require_start(
    simulator: str, asked: Array, found: Array, names: Sequence[str], near: float = NEAR
) -> None:
    """Raise if a simulator does not begin at the state that is asked for.

    Args:
        simulator: The simulator, for the message.
        asked: The state asked for, shape (nx,).
        found: The state at which the simulator begins, shape (nx,).
        names: Names of the states.
        near: Largest allowed difference, relative to the larger of 1 and the value
            asked for.

    Raises:
        SimulatorError: If a state differs; the message has those that do.
    """
    apart = np.abs(found - asked) > near * np.maximum(1.0, np.abs(asked))
    if apart.any() or not np.isfinite(found).all():
        differing = [
            f"{name} = {is_:.9g} for {want:.9g}"
            for name, is_, want, differs in zip(names, found, asked, apart, strict=True)
            if differs or not np.isfinite(is_)
        ]
        raise SimulatorError(
            simulator,
            "expected a run that begins at the given state, found "
            f"{', '.join(differing)}",
        )


def require_units(
    simulator: str, wanted: Mapping[str, str], found: Mapping[str, str]
) -> None:
    """Raise if a simulator states another unit than the one that is expected.

    Units that cannot be read, or that one side does not state, are not compared.

    Args:
        simulator: The simulator, for the message.
        wanted: Name of a variable -> the expected unit.
        found: Name of a variable -> the simulator's unit.

    Raises:
        SimulatorError: If a unit differs; the message has the first one.
    """
    for name, unit in wanted.items():
        theirs = found.get(name, "")
        if not theirs or theirs == unit:
            continue  # Reading a unit takes a second, the first time.
        sides = read_unit(unit), read_unit(theirs)
        if sides[0] and sides[1] and not sides[0].is_like(sides[1]):
            raise SimulatorError(
                simulator,
                f"expected {name} in {unit}, as the scenario states it; found "
                f"{theirs} (if both are the same, leave out the scenario's)",
            )
