"""NLP of a problem and its solvers, one set for each number of fixed steps."""

from collections.abc import Callable, Mapping
from functools import cache, partial
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca

from swarmstart.machine_code import compiling
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.nlp.nlp_sources import last_line
from swarmstart.ocp.nlp.polish_options import PolishOptions
from swarmstart.ocp.nlp.transcription import NonlinearProgram, multiple_shooting
from swarmstart.ocp.nlp.watching import Iterates, Ratios, ratios_of
from swarmstart.ocp.rollout.fixed_steps import FixedSteps
from swarmstart.ocp.rollout.shooting import Shooting

_NONE: Mapping[str, Any] = MappingProxyType({})


class Solvers(NamedTuple):
    """An NLP, its solver far from an answer and its solver near one.

    Attributes:
        program: The NLP.
        far: Its solver far from an answer.
        near: Returns the solver near an answer; built at the first call.
        warm: Returns the solver that starts from multipliers; built at the first call.
        iterates: Receives the solvers' iterates; None: they are not observed.
        ratios: Cost of derivatives, in rollouts.
    """

    program: NonlinearProgram
    far: ca.Function
    near: Callable[[], ca.Function]
    warm: Callable[[], ca.Function]
    iterates: Iterates | None
    ratios: Ratios


class NlpSolvers:
    """Solvers of one problem; each is built at its first use and then kept.

    Attributes:
        built: Solvers built so far, by the steps of their NLP.
    """

    def __init__(
        self, shooting: Shooting, options: PolishOptions, *, is_watched: bool = False
    ) -> None:
        """Build the solver, or postpone it until its steps are known.

        Args:
            shooting: The problem's functions.
            options: Options of the solver.
            is_watched: Whether its iterates are observed.

        Raises:
            InvalidProblemError: If the solver refuses an option.
        """
        self._shooting, self._options = shooting, options
        self._is_watched = is_watched
        self.built: dict[FixedSteps | None, Solvers] = {}
        problem = shooting.problem
        if problem.is_adaptive and not problem.collocation:
            # The steps are not known yet.
            x = ca.MX.sym("x")
            self._solver({"x": x, "f": x}, _NONE, near=False)
        else:
            self.built[None] = self._new(None)

    @property
    def program(self) -> NonlinearProgram | None:
        """The NLP; None if its steps are not known yet."""
        built = self.built.get(None)
        return None if built is None else built.program

    def __call__(self, steps: FixedSteps | None) -> Solvers:
        """Return the NLP for given steps with its solvers.

        Args:
            steps: Steps of the NLP; None: the problem's.
        """
        if steps not in self.built:
            with compiling():  # During planning.
                self.built[steps] = self._new(steps)
        return self.built[steps]

    def _new(self, steps: FixedSteps | None) -> Solvers:
        fixed = self._shooting if steps is None else steps.shooting(self._shooting)
        program = multiple_shooting(fixed)
        ipopt = self._options.plugin == "ipopt"
        given: Mapping[str, Any] = program.derivatives if ipopt else _NONE
        iterates = Iterates(program.nlp) if self._is_watched else None
        if iterates is not None:
            given = {**given, "iteration_callback": iterates}
        far = self._solver(program.nlp, given, near=False)

        @cache
        def near(*, warm: bool) -> ca.Function:
            if not ipopt:
                return far
            with compiling():  # During planning.
                return self._solver(program.nlp, given, near=True, warm=warm)

        return Solvers(
            program,
            far,
            partial(near, warm=False),
            partial(near, warm=True),
            iterates,
            ratios_of(program, self._shooting),
        )

    def _solver(
        self,
        nlp: dict[str, Any],
        given: Mapping[str, Any],
        *,
        near: bool,
        warm: bool = False,
    ) -> ca.Function:
        options = self._options
        settings = {
            "print_time": False,
            "show_eval_warnings": False,
            "error_on_fail": False,
            "calc_lam_p": False,
            **given,
            **options.settings(near=near, warm=warm),
        }
        try:
            return ca.nlpsol("polish", options.plugin, nlp, settings)
        except RuntimeError as error:
            raise InvalidProblemError(
                f"{options.plugin} refuses its options: expected its own names and "
                f"types, found {dict(options.options)}: {last_line(error)}"
            ) from error
