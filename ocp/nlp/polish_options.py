"""Options of the NLP solvers for the polish.

From a good start IPOPT begins with a small barrier and small pushes away from the
bounds. With its defaults it would first move away from the start, and might not return.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any

import casadi as ca

from swarmstart.arguments import (
    FLAG,
    a_count,
    a_number,
    checked,
    mapping,
    optional,
    text,
)
from swarmstart.ocp.common.errors import InvalidProblemError, refused

_NEAR: Mapping[str, Any] = MappingProxyType(
    {"mu_init": 1e-5, "bound_push": 1e-6, "bound_frac": 1e-6, "slack_bound_push": 1e-6,
     "slack_bound_frac": 1e-6}
)  # fmt: skip

_WARM: Mapping[str, Any] = MappingProxyType(
    {"warm_start_init_point": "yes", "mu_strategy": "adaptive",
     **{f"warm_start_{pushed}": 1e-9
        for pushed in ("bound_push", "bound_frac", "slack_bound_push",
                       "slack_bound_frac", "mult_bound_push")}}
)  # fmt: skip
"""For a start with multipliers: the barrier follows from their fit to the point."""


_SILENT = {"print_header": False, "print_iteration": False}
# Without its own check a QP with an empty trust region, as from a start that breaks its
# limits, is one without solution, so that the polish ends with a status and no error.
_QP = {"error_on_fail": False, "inputs_check": False}
_SQP = {
    **_SILENT,
    "print_status": False,
    "qpsol_options": {"printLevel": "none", **_QP},
}
_QUIET: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "sqpmethod": _SQP,
        "feasiblesqpmethod": _SQP,
        "qrsqp": {**_SILENT, "qpsol_options": _QP},
        "fatrop": {"fatrop.print_level": 0},
    }
)
"""Options that keep the other solvers of CasADi from printing."""
DEAF: Mapping[str, str] = MappingProxyType({"fatrop": "fatrop.max_iter"})
"""NLP solvers that CasADi cannot stop between iterations -> option of their limit."""


@checked(
    refused,
    tolerance=a_number(above=0),
    max_seconds=optional(a_number(above=0, finite=False)),
    max_iterations=a_count(least=1),
    options=mapping(keys=text(), words="a mapping of options"),
)
@dataclass(frozen=True, kw_only=True, slots=True)
class IpoptOptions:
    """Options of IPOPT.

    Attributes:
        max_iterations: Largest number of iterations.
        tolerance: IPOPT's convergence tolerance `tol`; the NLP's variables are scaled
            to one.
        max_seconds: Largest wall time [s]; None means no limit.
        options: Further options of IPOPT by their own names, such as {"mu_strategy":
            "adaptive"}; they take precedence over the ones set here.

    Raises:
        InvalidProblemError: If a number is not positive.

    Example:
        >>> import swarmstart as ss
        >>> options = ss.IpoptOptions(max_iterations=50, max_seconds=2.0)
        >>> options.settings(near=False)["ipopt.max_iter"]
        50
    """

    max_iterations: int = 300
    tolerance: float = 1e-8
    max_seconds: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def plugin(self) -> str:
        """Name of the solver in CasADi."""
        return "ipopt"

    @checked(refused, near=FLAG, warm=FLAG)
    def settings(self, *, near: bool, warm: bool = False) -> dict[str, Any]:
        """Return the options as CasADi takes them.

        Args:
            near: Whether the start is good and the solver should stay near it.
            warm: Whether the start has multipliers, too.
        """
        told: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "max_iter": self.max_iterations,
            "tol": self.tolerance,
            # By default IPOPT relaxes bounds by 1e-8. Clipping its controls to the
            # bounds would then break active path constraints.
            "bound_relax_factor": 0.0,
            **(_WARM if warm else _NEAR if near else {}),
        }
        if self.max_seconds is not None:
            told["max_wall_time"] = self.max_seconds
        told.update(self.options)
        return {f"ipopt.{name}": value for name, value in told.items()}


@checked(
    refused, plugin=text(), options=mapping(keys=text(), words="a mapping of options")
)
@dataclass(frozen=True, kw_only=True, slots=True)
class NlpOptions:
    """Options of another NLP solver of CasADi, such as sqpmethod or fatrop.

    Attributes:
        plugin: Name of the solver in CasADi.
        options: Options of the plug-in, as CasADi's `nlpsol` takes them.

    Raises:
        InvalidProblemError: If the plug-in is not installed.

    Example:
        >>> import swarmstart as ss
        >>> ss.NlpOptions(plugin="sqpmethod", options={"max_iter": 20}).plugin
        'sqpmethod'
    """

    plugin: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Validate the name of the plug-in."""
        if not isinstance(self.plugin, str) or not has_solver(self.plugin):
            raise InvalidProblemError(
                "plugin must be an NLP solver of CasADi that is installed, such as "
                f"ipopt or sqpmethod, got {self.plugin!r}"
            )

    @checked(refused, near=FLAG, warm=FLAG)
    def settings(self, *, near: bool, warm: bool = False) -> dict[str, Any]:
        """Return the options as CasADi takes them.

        Args:
            near: Not used.
            warm: Not used.
        """
        del near, warm
        quiet = dict(_QUIET.get(self.plugin, {}))
        if self.options.get("qpsol", "qpoases") != "qpoases":
            quiet["qpsol_options"] = _QP  # Names of other options differ.
        return {**quiet, **self.options}


PolishOptions = IpoptOptions | NlpOptions


def has_solver(name: str) -> bool:
    """Return whether CasADi has an NLP solver of this name.

    Raises:
        InvalidProblemError: If the present folder holds files that CasADi could take
            for its own plug-ins: CasADi also looks there, for the solver and for what
            the solver uses, and would run code that others left there.
    """
    if _here_are_plugins():
        raise InvalidProblemError(
            "expected no files libcasadi_* in the present folder, from which CasADi "
            f"could load native code as part of {name!r}, found some; work in another "
            "folder"
        )
    return bool(ca.has_nlpsol(name))


def _here_are_plugins() -> bool:
    try:
        return any(name.startswith("libcasadi_") for name in os.listdir())
    except FileNotFoundError:  # The folder was removed.
        return False
    except OSError:  # What cannot be listed can still be loaded.
        return True


def check_solver(options: PolishOptions) -> None:
    """Make an NLP solver for a small problem, to check that it accepts its options.

    Raises:
        InvalidProblemError: If the solver does not take them; with CasADi's words.
    """
    x = ca.MX.sym("x")
    nlp = {"x": x, "f": x**2, "g": x}
    try:
        ca.nlpsol("trial", options.plugin, nlp, options.settings(near=False))
    except (RuntimeError, NotImplementedError) as error:
        said = str(error).strip().splitlines()[-1].strip()
        raise InvalidProblemError(
            f"{options.plugin} must take its options, it says: {said}"
        ) from error


class PolishStatus(Enum):
    """Status of an NLP solver at its end."""

    CONVERGED = "converged to a local optimum"
    ITERATION_LIMIT = "stopped at the limit of iterations or time"
    INFEASIBLE = "found no feasible point near the guess"
    NUMERICAL_FAILURE = "broke off for a numerical reason"
    WORSE = "converged to a point that is worse than the guess"


IPOPT_STATUS = {
    "Solve_Succeeded": PolishStatus.CONVERGED,
    "Solved_To_Acceptable_Level": PolishStatus.CONVERGED,
    "Maximum_Iterations_Exceeded": PolishStatus.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": PolishStatus.ITERATION_LIMIT,
    "Maximum_WallTime_Exceeded": PolishStatus.ITERATION_LIMIT,
    "User_Requested_Stop": PolishStatus.ITERATION_LIMIT,  # By a watch.
    "Infeasible_Problem_Detected": PolishStatus.INFEASIBLE,
}
