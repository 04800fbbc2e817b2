"""Claims of the package about a case: the only module that calls the package."""

import warnings

from swarmstart import solve
from swarmstart.ocp import BackendWarning, InvalidProblemError, SolutionStatus
from swarmstart.tests.adversary.case import Case, problem_of
from swarmstart.tests.adversary.judge import Claim


def claimed(
    case: Case, *, backend: str = "auto", seed: int = 0, repair: bool = True
) -> Claim:
    """Return what `solve` says of a case, with default settings.

    Args:
        case: The case.
        backend: "auto", "llvm" or "casadi".
        seed: Of all randomness.
        repair: As `solve` takes it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BackendWarning)
        try:
            problem = problem_of(case)
            solution = solve(
                problem, case.start, backend=backend, seed=seed, repair=repair
            )
        except InvalidProblemError:  # Refused as impossible, which may be right.
            return Claim(controls=None)
    return Claim(
        controls=solution.controls,
        cost=solution.cost,
        is_confirmed=solution.status.is_confirmed,
        is_local_optimum=solution.status is SolutionStatus.CONVERGED,
    )
