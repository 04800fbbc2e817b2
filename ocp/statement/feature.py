"""Features: parts of a problem that are given as objects, such as a transport delay.

Before the solution, a rewrite turns the problem into one without the feature
(`rewrites/rewrite.py`).
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened


class Feature:
    """A part of a problem's statement besides its fields.

    Attributes:
        goes_with_teams: Whether plans of teams and of the dual mode may have the
            feature. They may if it remembers nothing from one plan to the next and does
            not change the controls.
    """

    goes_with_teams: ClassVar[bool] = False

    def of_members(self, names: Mapping[str, Sequence[str]]) -> "Feature":
        """Return the feature that the ensemble of a problem with this feature has.

        Args:
            names: Name of a control of the problem -> the names of the controls that
                the members have in its place; its own name if they share it.
        """
        del names
        return self

    def require(self, problem: Any) -> None:
        """Raise if the feature does not go with a problem that is being stated.

        Args:
            problem: An OptimalControlProblem, whose other fields are checked.

        Raises:
            InvalidProblemError: If the feature does not go with the problem.
        """

    def accepts(self, problem: Any) -> bool:
        """Return whether the feature changes a problem; a delay of 0 s does not.

        Args:
            problem: An OptimalControlProblem.
        """
        del problem
        return True


def features_given(given: object) -> tuple[Feature, ...]:
    """Return the features given for a problem, checked.

    Raises:
        InvalidProblemError: If `features` is not a list of features.
    """
    if not isinstance(given, list | tuple) or not all(
        isinstance(one, Feature) for one in given
    ):
        raise InvalidProblemError(
            "features must be a list of features, such as [TransportDelay({'u': 0.2})],"
            f" got {shortened(given)}"
        )
    return tuple(given)


def effective(problem: Any) -> list[Feature]:
    """Return the features of an OptimalControlProblem that change it."""
    return [feature for feature in problem.features if feature.accepts(problem)]
