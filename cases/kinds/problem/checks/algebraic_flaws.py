"""Errors of algebraic equations, which determine variables of a model."""

from collections.abc import Iterator

import casadi as ca

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Place
from swarmstart.cases.kinds.problem.stated.members import Member, members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import model_of
from swarmstart.cases.kinds.problem.stated.parts import Equation
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import number
from swarmstart.errors import SwarmstartError


def algebraic_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of equations that determine no variables, or without a value.

    At the start and the end of the horizon there is no control, so that a variable that
    depends on a control has no value there.
    """
    if not scenario.algebraic:
        return
    member = members_of(scenario, shared_of(scenario))[0]
    wrong = list(_of_scales(scenario, member))
    yield from wrong
    if wrong:
        return
    try:
        model = model_of(scenario, [member])
    except SwarmstartError as error:
        yield ("algebraic",), error
        return
    for place, scope, text in _at_ends(scenario):
        value = model.sx(scope, member.scopes[scope].symbol(text))
        if ca.depends_on(value, model.controls):
            yield (
                place,
                f"expected no algebraic variable that depends on controls in {scope}, "
                f"found {text}",
            )


def _of_scales(scenario: ProblemScenario, member: Member) -> Iterator[LocatedFlaw]:
    for name, given in scenario.algebraic.items():
        if isinstance(given, Equation):
            scale = number(given.scale, member.constants)
            if not scale > 0:
                place = ("algebraic", name, "scale")
                yield place, f"expected a scale above 0, found {scale:g}"


def _at_ends(scenario: ProblemScenario) -> Iterator[tuple[Place, str, str]]:
    """Yield (place, scope, text) of expressions at times without controls."""
    for key in ("initial_cost", "terminal_cost"):
        yield (key,), key, getattr(scenario, key)
    for index, one in enumerate(scenario.terminal):
        yield ("terminal", index, "expression"), "terminal", one.expression
