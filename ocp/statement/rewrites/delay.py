"""Transport delay of a control: x' = f(x, u(t - d)), over whole intervals.

    w_1+ = u,  w_i+ = w_i-1,  i = 2 ... k,       x' = f(x, w_k),      d = k dt

The states w_i hold the controls of the last k intervals, and the end of an interval
moves them on. The model, with its outputs, receives w_k; costs, bounds and constraints
use the control as it is commanded.

Source: Åström and Wittenmark (1997), Computer-Controlled Systems, 2.3, for the states
of a sampled system with a delay.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import require_number
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    Appended,
    changed_model,
    controls_before,
    replaced,
    with_states,
)
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite

_ROUNDING = 1e-9
"""Relative rounding of a delay that is a whole number of intervals."""


@dataclass(frozen=True, slots=True)
class TransportDelay(Rewrite):
    """Delays with which controls reach the equations of a model.

    The controls before the start are those of `Known(previous=...)`: one column stands
    for all intervals before; several stand for the latest ones, in the order of time.

    Attributes:
        seconds: Delay of each control, by its name [s]: a whole number of the
            problem's intervals.

    Raises:
        InvalidProblemError: If a delay is negative or not finite. A problem that is
            stated with this feature also raises the errors of `require`; if a delay is
            not a whole number of intervals, the message has the nearest delays that
            are.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> late = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, terminal=[(x, 1)], bounds=ss.Bounds(controls=(-2, 2)),
        ...     features=[ss.TransportDelay({"u": 0.25})],
        ... )
        >>> found = ss.solve(late, [0.0], search=None, lanes=0, seed=0)
        >>> print(found.states.round(3), abs(found.controls).round(3))
        [[0.    0.    0.333 0.667 1.   ]] [[1.333 1.333 1.333 0.   ]]
    """

    role = "delayed"
    is_remembered = True
    key = "delay_s"
    meaning = (
        "Delay with which the control reaches the model's equations, a whole number of "
        "intervals [s]; null and 0 mean none. Not with phases, a dual mode, a fixed "
        "end, or vehicles that do not plan jointly."
    )

    seconds: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not isinstance(self.seconds, Mapping):
            raise InvalidProblemError(
                "seconds of a TransportDelay must be a mapping of controls to delays, "
                f"such as {{'u': 0.2}}, got {shortened(self.seconds)}"
            )
        for name, delay in self.seconds.items():
            seconds = require_number(f"delay of {name!r}", delay)
            if not 0 <= seconds < np.inf:
                raise InvalidProblemError(
                    f"delay of {name!r} must be finite and at least 0 s, got {delay}"
                )

    def of_members(self, names: Mapping[str, Sequence[str]]) -> "TransportDelay":
        """Return the same delays for the controls of all members of an ensemble."""
        return TransportDelay(
            {
                own: delay
                for name, delay in self.seconds.items()
                for own in names.get(name, [name])
            }
        )

    def require(self, problem: OptimalControlProblem) -> None:
        """Raise if the delays do not go with a problem.

        Raises:
            InvalidProblemError: If a name is unknown; if a delay is not a whole number
                of intervals, or not shorter than the horizon; if the end time is free
                or the controls are linear; or if algebraic equations depend on a
                delayed control.
        """
        if problem.has_knots:
            raise InvalidProblemError(
                "a delay is for controls that are held: control_shape must be "
                f"constant, got {problem.control_shape!r}"
            )
        model = problem.model
        late = [model.controls[j] for j, n in self._intervals(problem) if n]
        solved = ca.vertcat(model.elimination.solution, model.elimination.unsolved)
        if late and solved.numel() and ca.depends_on(solved, ca.vertcat(*late)):
            raise InvalidProblemError(
                "a delayed control must not be part of algebraic equations: state the "
                "delay as states of the model"
            )

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether a control is delayed at all."""
        return any(count for _, count in self._intervals(problem))

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with the controls of the last intervals as states."""
        model = problem.model
        now, states, after, late = ca.vertsplit(model.controls), [], [], []
        for j, count in self._intervals(problem):
            name = model.control_names[j]
            line = [
                ca.SX.sym(f"{name} {i} interval{'s' * (i > 1)} ago")
                for i in range(1, count + 1)
            ]
            states += line
            after += [now[j], *line[:-1]] if line else []
            late.append(line[-1] if line else now[j])
        timed = replaced(model.controls, ca.vertcat(*late))
        appended = Appended(states=ca.vertcat(*states), after=ca.vertcat(*after))
        return with_states(problem, appended, changed_model(model, timed))

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return each control's values before the horizon, the latest first."""
        del x0
        counts = self._intervals(problem)
        before = controls_before(problem, previous, max(n for _, n in counts))
        return np.concatenate([before[j, ::-1][:count] for j, count in counts])

    def along(
        self, problem: OptimalControlProblem, start: Array, controls: Array, at: Array
    ) -> Array:
        """Return the states w_i at times `at`: the controls of i intervals earlier."""
        found, place, rows = self._sent(problem, start, controls), at.astype(int), []
        for (_, count), sent in zip(self._intervals(problem), found, strict=True):
            rows += [sent[count - i + place] for i in range(1, count + 1)]
        return np.array(rows)

    def acting(
        self, problem: OptimalControlProblem, start: Array, controls: Array
    ) -> Array:
        """Return the controls that reach the model in each interval, shape (nu, N)."""
        N = controls.shape[1]
        return np.array([sent[:N] for sent in self._sent(problem, start, controls)])

    def _sent(
        self, problem: OptimalControlProblem, start: Array, controls: Array
    ) -> list[Array]:
        """Return the controls before the horizon, the last one last, and in it."""
        found, first = [], 0
        for j, count in self._intervals(problem):
            line = start[first : first + count]
            found.append(np.concatenate([line[::-1], controls[j]]))
            first += count
        return found

    def _intervals(self, problem: OptimalControlProblem) -> list[tuple[int, int]]:
        """Return the number of each control with its delay in intervals."""
        names = problem.model.control_names
        if unknown := [name for name in self.seconds if name not in names]:
            raise InvalidProblemError(
                f"a delay must name controls, some of {', '.join(names)}, got "
                f"{', '.join(map(str, unknown))}"
            )
        if isinstance(problem.horizon, Free):
            raise InvalidProblemError(
                "a delay is a whole number of intervals, which needs their length: "
                "the horizon must be a number, got a free end time"
            )
        return [
            (j, _whole_intervals(name, self.seconds.get(name, 0.0), problem))
            for j, name in enumerate(names)
        ]


def _whole_intervals(name: str, delay: float, problem: OptimalControlProblem) -> int:
    """Return the number of intervals of the delay of a control [s].

    Raises:
        InvalidProblemError: If it is not whole, or not below the problem's.
    """
    dt, most = problem.dt, problem.intervals - 1
    exact = min(delay / dt, float(problem.intervals))  # The quotient may overflow.
    count = round(exact)
    is_whole = abs(exact - count) <= _ROUNDING * max(exact, 1.0)
    if is_whole and count <= most:
        return count
    if is_whole:
        raise InvalidProblemError(
            f"delay of {name!r} must be shorter than the horizon of "
            f"{_seconds(problem.length)}, got {_seconds(delay)}: the longest is "
            f"{_seconds(most * dt)}"
        )
    below = int(np.floor(exact))
    nearest = [_seconds(i * dt) for i in (below, below + 1) if i <= most]
    raise InvalidProblemError(
        f"delay of {name!r} must be a whole number of intervals of {_seconds(dt)}, got "
        f"{_seconds(delay)}: the nearest {'are' if nearest[1:] else 'is'} "
        f"{' and '.join(nearest)}"
    )


def _seconds(value: float) -> str:
    # Enough digits to tell a delay from whole intervals, and to be accepted as one.
    return f"{value:.12g} s"
