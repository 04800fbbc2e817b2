"""Held signals: s keeps the value at the start of an interval until the next one.

    s(t) = s_0 + h_k,  t_k <= t < t_(k+1),      h_0 = 0,      h_(k+1) = s(t_(k+1)) - s_0

Other signals are linear between the nodes, so that a jump of a price or of a limit
would become a ramp. The parameter s_0 is the value at the start of the horizon, and the
state h jumps at the ends of intervals. A constraint on states is thus checked with the
values before and after the jump. A constraint on the controls of an interval is checked
with the value that holds in that interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened, symbol_names
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    Appended,
    changed_fields,
    changed_model,
    replaced,
    signal_rows,
    with_parameters,
    with_states,
)
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite


def held_signals(problem: OptimalControlProblem) -> set[str]:
    """Return the names of a problem's signals that are held within intervals."""
    held = [one for one in problem.features if isinstance(one, HeldSignals)]
    return {name for one in held if one.accepts(problem) for name in one.names}


@dataclass(frozen=True, slots=True)
class HeldSignals(Rewrite):
    """Signals that jump, such as a tariff: constant within each control interval.

    The value at the start of an interval holds until the next interval begins. At the
    end of the horizon the signal jumps to its last value. Values at checks within an
    interval are not used. A model in discrete time takes the values at the nodes, as
    without this feature. If the end time is free, all signals stretch with the horizon.
    `RecedingHorizon(until=...)` refuses a problem with this feature.

    Attributes:
        names: Names of the signals.

    Raises:
        InvalidProblemError: If `names` is not a list of different names. A problem that
            is stated with this feature also raises the errors of `require`.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u, price = (ca.SX.sym(name) for name in ("x", "u", "price"))
        >>> bought = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=2.0, intervals=2,
        ...     stage_cost=price * u + u**2, terminal=[(x, 1)], signals=price,
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ...     features=[ss.HeldSignals(["price"])],
        ... )
        >>> prices = ss.Known(signals=[[0.0, 1.0, 1.0]])  # 1 from t = 1 s on
        >>> found = ss.solve(bought, [0.0], known=prices, search=None, lanes=0, seed=0)
        >>> print(found.controls.round(3), round(found.cost, 4))
        [[0.75 0.25]] 0.875
    """

    role = "held"
    goes_with_teams = True

    names: Sequence[str]

    def __post_init__(self) -> None:
        """Check the names."""
        given = self.names
        if isinstance(given, str) or not (
            isinstance(given, Sequence) and all(isinstance(n, str) for n in given)
        ):
            raise InvalidProblemError(
                "names of HeldSignals must be a list of names of signals, such as "
                f"['price'], got {shortened(given)}"
            )
        if len(set(given)) < len(given):
            raise InvalidProblemError(
                "names of HeldSignals must be different, got "
                f"{', '.join(map(repr, given))}"
            )
        object.__setattr__(self, "names", tuple(given))

    def require(self, problem: OptimalControlProblem) -> None:
        """Raise if the problem lacks one of the signals.

        Raises:
            InvalidProblemError: If a name is unknown.
        """
        names = symbol_names(problem.signals)
        if unknown := [name for name in self.names if name not in names]:
            raise InvalidProblemError(
                "HeldSignals must name signals of the problem, some of "
                f"{', '.join(names) or 'none'}, got {', '.join(unknown)}"
            )

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether signals are held within intervals in continuous time."""
        return bool(self.names) and not problem.model.is_discrete

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem in which states hold the signals within an interval."""
        model, rows = problem.model, self._rows(problem)
        signals = ca.vertcat(*[problem.signals[row] for row in rows])
        states, first = (
            ca.vertcat(*[ca.SX.sym(f"{name}{suffix}") for name in self.names])
            for suffix in (", held", " at the start")
        )
        change = replaced(signals, first + states)
        equations = changed_model(model, change) | {
            # What the end of an interval sets meets the values from then on.
            "next_state": model.next_state,
            "parameters": ca.vertcat(model.parameters, first),
            # All signals in their order, since the states jump to some of them.
            "signals": problem.signals,
        }
        return with_states(
            problem,
            Appended(states=states, after=signals - first),
            equations,
            **changed_fields(problem, change, change),
        )

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return zeros: the states are the signals less their values at the start."""
        del problem, x0, previous
        return np.zeros(len(self.names))

    def signalled(
        self, problem: OptimalControlProblem, signals: Array, at: Array
    ) -> Array:
        """Return each signal at the start of the intervals, less its first value."""
        rows = signals[self._rows(problem)]
        begun = np.minimum(at.astype(int), problem.intervals)
        return np.asarray(rows[:, begun * problem.checks] - rows[:, :1])

    def known(
        self,
        problem: OptimalControlProblem,
        parameters: ArrayLike,
        signals: ArrayLike,
        time: float,
    ) -> tuple[ArrayLike, ArrayLike, float]:
        """Return parameters, signals and time for the problem without held signals.

        The held signals' values at the start of the horizon are further parameters.

        Raises:
            InvalidProblemError: If the shape of the signals is not the problem's.
        """
        rows = signal_rows(problem, signals)
        first = rows[self._rows(problem), 0]
        return with_parameters(problem, parameters, first), rows, time

    def _rows(self, problem: OptimalControlProblem) -> list[int]:
        """Return the numbers of the signals."""
        names = symbol_names(problem.signals)
        return [names.index(name) for name in self.names]
