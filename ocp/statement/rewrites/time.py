"""Time: t = t0 + L tau, with the parameter t0 and the signal tau from 0 to 1."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    changed_fields,
    changed_model,
    replaced,
    signal_rows,
    with_equations,
    with_parameters,
)
from swarmstart.ocp.statement.rewrites.end_time import length_of
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite


@dataclass(frozen=True, slots=True)
class Time(Rewrite):
    """A model that depends on the time -> one with a further parameter and signal."""

    role = "time"

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether the model has a symbol of the time."""
        return bool(problem.model.time.numel())

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with the time as an expression."""
        length, parameters, decided = length_of(problem)
        model = problem.model
        begin, tau = ca.SX.sym("t0"), ca.SX.sym("tau")
        timed = replaced(model.time, begin + length * tau)
        signals = ca.vertcat(model.signals, tau)
        return replace(
            problem,
            model=with_equations(
                model,
                parameters=ca.vertcat(parameters, begin),
                signals=signals,
                time=ca.SX(0, 1),
                **changed_model(model, timed),
            ),
            signals=ca.vertcat(signals, problem.signals[model.ns :, 0]),
            decided=decided,
            **changed_fields(problem, timed, timed),
        )

    def known(
        self,
        problem: OptimalControlProblem,
        parameters: ArrayLike,
        signals: ArrayLike,
        time: float,
    ) -> tuple[ArrayLike, ArrayLike, float]:
        """Return the parameters with t0, and the signals with tau.

        Raises:
            InvalidProblemError: If the shape of the signals is not the problem's.
        """
        rows, own = signal_rows(problem, signals), problem.model.ns
        tau = np.linspace(0.0, 1.0, problem.nodes)[None, :]
        values = with_parameters(problem, parameters, time)
        return values, np.vstack([rows[:own], tau, rows[own:]]), time
