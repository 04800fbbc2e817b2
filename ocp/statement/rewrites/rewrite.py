"""Rewrite: a map from a problem to a simpler one, and the way back.

A rewrite removes one feature of a problem. It may append states to the model, replace
expressions, and subtract numbers from states; it leaves the states that are there in
their places. `chain.py` composes all rewrites; solvers know only the last problem, the
core.

    accepts   does a problem have the feature?
    apply     problem -> problem without it
    origin    the numbers that are subtracted from the states
    start     the initial values of its states
    along     the values of its states over the horizon
    signalled the same, of states that follow from signals
    known     known parameters, signals and time -> those of the rewritten problem
    guess     controls as the problem states them -> those of the rewritten problem
    controls  controls of the rewritten problem -> those that the problem states
    acting    the controls that the model's equations receive

A feature may also be part of a statement itself: `OptimalControlProblem(features=...)`.

The design is that of cvxpy's reductions: Agrawal, Verschueren, Diamond and Boyd (2018),
A rewriting system for convex optimization problems, Journal of Control and Decision 5.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.statement.feature import Feature
from swarmstart.ocp.statement.problem import OptimalControlProblem


class Rewrite(Feature, ABC):
    """A map from a problem to a simpler one.

    In all methods `problem` is the problem before the rewrite.

    Attributes:
        role: Name of the appended states in `Lowered.places`.
        is_remembered: Whether the appended states remember something from plan to plan
            in receding horizon: the next plan begins with their values after the first
            interval of the last plan.
    """

    role: ClassVar[str]
    is_remembered: ClassVar[bool] = False

    @abstractmethod
    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether a problem has the feature that this rewrite removes."""

    @abstractmethod
    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the rewritten problem.

        Raises:
            InvalidProblemError: If the feature does not go with another one.
        """

    def origin(self, problem: OptimalControlProblem) -> Array:
        """Return the number that is subtracted from each state of a problem, (nx,)."""
        return np.zeros(problem.model.nx)

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return the initial values of the appended states; NaN for a decided one.

        Args:
            problem: Problem before this rewrite.
            x0: Its initial state, shape (nx,).
            previous: Controls of the intervals before the horizon: of the last one,
                shape (nu,), or of several, the last one last, shape (nu, m); None: the
                allowed value nearest to zero.
        """
        del problem, x0, previous
        return np.empty(0)

    def along(
        self, problem: OptimalControlProblem, start: Array, controls: Array, at: Array
    ) -> Array:
        """Return the appended states over the horizon; by default they stay constant.

        Args:
            problem: Problem before this rewrite.
            start: Their initial values, shape (k,).
            controls: Controls of the rewritten problem (core), shape (nu, N).
            at: Times, in intervals since the start, shape (n,).

        Returns:
            Shape (k, n); at the end of an interval, the values after the jump there.
        """
        del problem, controls
        return np.repeat(start[:, None], at.size, axis=1)

    def signalled(
        self, problem: OptimalControlProblem, signals: Array, at: Array
    ) -> Array | None:
        """Return the appended states over the horizon, if they follow from signals.

        Args:
            problem: Problem before this rewrite.
            signals: Signals at the nodes, shape (ns or more, nodes).
            at: Times, in intervals since the start, shape (n,).

        Returns:
            Shape (k, n), as from `along`; None if they do not follow from signals.
        """
        del problem, signals, at
        return None

    def known(
        self,
        problem: OptimalControlProblem,
        parameters: ArrayLike,
        signals: ArrayLike,
        time: float,
    ) -> tuple[ArrayLike, ArrayLike, float]:
        """Return known parameters, signals and time for the rewritten problem."""
        del problem
        return parameters, signals, time

    def guess(
        self, problem: OptimalControlProblem, start: Array, controls: Array
    ) -> tuple[Array, Array]:
        """Return the appended states' start and the core's controls from a guess.

        Args:
            problem: Problem before this rewrite.
            start: Initial values of the appended states, shape (k,); not changed.
            controls: Guess of the controls as they are stated.
        """
        del problem
        return start, controls

    def controls(self, start: Array, controls: Array) -> Array:
        """Return the core's controls in the form of the problem before this rewrite.

        Args:
            start: Initial values of the appended states, shape (k,).
            controls: Controls of the rewritten problem (core), shape (nu, N).
        """
        del start
        return controls

    def acting(
        self, problem: OptimalControlProblem, start: Array, controls: Array
    ) -> Array:
        """Return the controls that the model's equations receive, shape (nu, N).

        Args:
            problem: Problem before this rewrite.
            start: Initial values of the appended states, shape (k,).
            controls: Controls of the rewritten problem (core), shape (nu, N).
        """
        del problem, start
        return controls
