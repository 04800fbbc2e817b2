"""Warm start of an NLP that is written in CasADi, by one added line.

    warm = warm_start(opti, controls=[u], states=[x])
    solution = warm.solve()

This module reads the user's arguments; the work is done in warm_started.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import SEED, checked, either, mapping, of_kind, optional, text
from swarmstart.heuristics import Budget
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.foreign_nlp.elimination import read_nlp
from swarmstart.ocp.foreign_nlp.warm_search import BASINS, RADIUS
from swarmstart.ocp.foreign_nlp.warm_started import WarmStartedSolver
from swarmstart.ocp.nlp.nlp_sources import Indices, NlpSource, OptiSource, arguments_of
from swarmstart.ocp.search.settings import (
    Memetic,
    Multistart,
    SearchGiven,
    SearchSettings,
    search_settings,
)

BoundsGiven = Mapping[Any, ArrayLike] | Sequence[tuple[Any, ArrayLike]]


@checked(
    refused,
    bounds=either(
        mapping(words="a mapping"), of_kind((list, tuple), "a sequence of bounds")
    ),
    options=optional(mapping(words="a mapping of options")),
    seed=SEED,
    solver=text(),
)
def warm_start(  # noqa: PLR0913 - one added line says it all
    nlp: ca.Opti | Mapping[str, Any],
    *,
    controls: Sequence[Any],
    states: Sequence[Any],
    bounds: BoundsGiven = (),
    search: SearchGiven = "default",
    budget: Budget | int | None = None,
    seed: int | Sequence[int] = 0,
    p: ArrayLike | None = None,
    x0: ArrayLike | None = None,
    lbg: ArrayLike | None = None,
    ubg: ArrayLike | None = None,
    lbx: ArrayLike | None = None,
    ubx: ArrayLike | None = None,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
) -> WarmStartedSolver:
    """Return a solver for an Opti, or an NLP of CasADi, that uses two starts.

    It solves from the user's own start and from one found by a population search, and
    keeps the better solution.

    Args:
        nlp: An Opti whose `solver` is set, or a dictionary for `casadi.nlpsol`.
        controls: Variables of the controls, each of shape (rows, intervals) or
            (intervals, rows), or one variable for each interval. For a dictionary:
            expressions of nlp["x"], or tables (rows, intervals) of indices.
        states: Variables of the states at the nodes, in the same forms.
        bounds: Bounds for the search only, for controls that no constraint bounds: a
            dictionary, or pairs, of a variable and (lower, upper). Other variables
            without bounds, such as a free end time, are searched between a quarter of
            their initial value and four times that.
        search: A population search, as in `solve`.
        budget: Budget of the search; an integer is a number of evaluations; None means
            20,000.
        seed: Seed of each `solve`; the same seed gives the same bits.
        p: Values of the parameters; this and the following are for a dictionary only.
        x0: The user's own start.
        lbg: Lower bounds of g.
        ubg: Upper bounds of g.
        lbx: Lower bounds of x.
        ubx: Upper bounds of x.
        solver: Name of a plug-in of `nlpsol`.
        options: Options of the plug-in.

    Returns:
        A `WarmStartedSolver`, with `solve()` and, after it, `report`.

    Raises:
        InvalidProblemError: If a state cannot be eliminated, a control has no bounds, a
            parameter has no value, or an argument is of the wrong kind.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> opti = ca.Opti()
        >>> x, u = opti.variable(1, 6), opti.variable(1, 5)
        >>> for k in range(5):
        ...     opti.subject_to(x[k + 1] == x[k] + 0.2 * u[k])
        >>> opti.subject_to(x[0] == 0)
        >>> opti.subject_to(opti.bounded(-1, u, 1))
        >>> opti.minimize((x[5] ** 2 - 0.25) ** 2 + 0.1 * x[5])
        >>> opti.solver("ipopt", {"ipopt.print_level": 0, "print_time": False})
        >>> warm = ss.warm_start(opti, controls=[u], states=[x], budget=2000)
        >>> solution = warm.solve()  # doctest: +ELLIPSIS
        ...
        >>> bool(solution.value(x)[-1] < 0)
        True
    """
    source = _source(
        nlp,
        {"p": p, "x0": x0, "lbg": lbg, "ubg": ubg, "lbx": lbx, "ubx": ubx},
        solver,
        options,
    )
    layouts = (
        _layouts("states", states, source),
        _layouts("controls", controls, source),
    )
    both = np.intersect1d(layouts[0][0], layouts[1][0])
    given = read_nlp(source)
    if both.size:
        raise InvalidProblemError(
            f"{given.name(int(both[0]))} is named as a state and as a control"
        )
    return WarmStartedSolver(
        given, layouts, _asked(bounds, source), _settings(search, budget), seed
    )


def _source(
    nlp: ca.Opti | Mapping[str, Any],
    given: Mapping[str, ArrayLike | None],
    solver: str,
    options: Mapping[str, Any] | None,
) -> OptiSource | NlpSource:
    """Return the source of an NLP."""
    if isinstance(nlp, ca.Opti):
        named = [name for name, value in given.items() if value is not None]
        if named:
            raise InvalidProblemError(
                f"an Opti has its own numbers, expected no {', '.join(named)}"
            )
        return OptiSource(nlp)
    if not isinstance(nlp, Mapping) or not {"x", "f"} <= set(nlp):
        raise InvalidProblemError(
            "warm_start takes an Opti or a dictionary for nlpsol with 'x' and 'f', got "
            f"{shortened(nlp)}"
        )
    settings = dict(options or {})
    if any(settings.get("discrete", ())):
        raise InvalidProblemError(
            "expected continuous variables, found the option 'discrete'"
        )
    try:
        # Made here, so that refused options are reported at once.
        made = ca.nlpsol("owner", solver, dict(nlp), settings)
    except RuntimeError as error:
        raise InvalidProblemError(
            f"nlpsol refuses the NLP or its options: {str(error).splitlines()[-1]}"
        ) from error
    return NlpSource(nlp=nlp, solver=made, arguments=arguments_of(nlp, given))


def _settings(search: SearchGiven, budget: Budget | int | None) -> SearchSettings:
    """Return the search; search settings stand alone, with their own budget."""
    found = search_settings(search, budget)
    if found is None:
        raise InvalidProblemError("warm_start needs a search, got none")
    if isinstance(found.algorithm, Multistart | Memetic):
        raise InvalidProblemError(
            "warm_start takes a population search, such as 'lshade' or 'cma', since an "
            f"NLP has no lanes; got {shortened(found.algorithm)}"
        )
    if isinstance(search, SearchSettings):
        return found
    return replace(found, basins=BASINS, radius=RADIUS)


def _layouts(
    role: str, given: Sequence[Any], source: OptiSource | NlpSource
) -> list[Indices]:
    """Return the possible arrangements of variables in time, each (rows, times).

    Time may run along the columns, along the rows, or along the list itself.
    """
    if isinstance(given, ca.MX | ca.SX):  # One variable, not a list.
        given = [given]
    if not isinstance(given, list | tuple) or not given:
        raise InvalidProblemError(
            f"{role} must be a list of variables, at least one, got {shortened(given)}"
        )
    tables = [source.indices(role, one) for one in given]
    found = _readings(tables)
    # Over a single interval, controls have one time only.
    if not found and role == "controls" and all(t.shape[1] == 1 for t in tables):
        found.append(np.concatenate(tables))
    if not found:
        raise InvalidProblemError(
            f"{role} must have one number of times, at least 2, got shapes "
            f"{', '.join(str(table.shape) for table in tables)}"
        )
    if np.unique(found[0]).size != found[0].size:
        raise InvalidProblemError(f"{role} must name each variable once")
    return found


def _readings(tables: Sequence[Indices]) -> list[Indices]:
    """Return tables as (rows, times), once for each axis that may be the time."""
    found = []
    for parts in (tables, [table.T for table in tables]):
        if len({part.shape[1] for part in parts}) == 1 and parts[0].shape[1] > 1:
            found.append(np.concatenate(parts))
    if len({table.size for table in tables}) == 1 and len(tables) > 1:
        # One variable for each time.
        found.append(np.stack([t.ravel(order="F") for t in tables], axis=1))
    return found


def _asked(
    bounds: BoundsGiven, source: OptiSource | NlpSource
) -> list[tuple[Indices, float, float]]:
    """Return the bounds given by the user, as (indices in x, lower, upper)."""
    pairs = bounds.items() if isinstance(bounds, Mapping) else bounds
    found = []
    for pair in pairs:
        if not isinstance(pair, tuple | list) or len(pair) != len(("of", "limits")):
            raise InvalidProblemError(
                "bounds must be pairs of a variable and its (lower, upper), got "
                f"{shortened(pair)}"
            )
        variable, limits = pair
        try:
            lower, upper = (float(side) for side in np.array(limits, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise InvalidProblemError(
                "bounds must be pairs (lower, upper) of numbers, got "
                f"{shortened(limits)}"
            ) from error
        if not lower <= upper:
            raise InvalidProblemError(
                f"bounds must have lower <= upper, got ({lower:g}, {upper:g})"
            )
        found.append((source.indices("bounds", variable), lower, upper))
    return found
