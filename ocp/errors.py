"""Errors of the optimal-control room."""

from swarmstart.errors import SwarmstartError


class InvalidProblemError(SwarmstartError, ValueError):
    """An optimal-control problem, or what is given to one, cannot be posed."""


class DivergedError(SwarmstartError):
    """A simulated plant left the finite numbers, or its algebraic equations."""


class SolveError(SwarmstartError):
    """A solver could not be run; not converging is a status, not an error."""
