"""Exceptions of the package `ocp`."""

from swarmstart.errors import SwarmstartError, brief


class InvalidProblemError(SwarmstartError, ValueError):
    """An optimal-control problem, or an argument to one, is invalid."""


class DivergedError(SwarmstartError):
    """A simulated plant's state is not finite, or its equations are not solved."""


class SolveError(SwarmstartError):
    """A solver could not be run; not converging is a status, not an error."""


def refused(name: str, value: object, allowed: str) -> InvalidProblemError:
    """Return the error of an argument that is refused; see `arguments`."""
    return InvalidProblemError(f"{name} must be {allowed}, got {brief(value)}")
