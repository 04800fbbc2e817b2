"""No public call ends in a bare error, or takes a value that it does not look at.

Every parameter of every public function, class and method gets each of WRONG in turn
while the others hold valid values. An own error must come of it, unless accepted.yaml
says why the value may be taken. The whole walk is long; the short one tries a few
values, which no parameter may take.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from enum import Enum
from fnmatch import fnmatchcase
from functools import cache
from importlib import import_module
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import yaml

import swarmstart as ss
from swarmstart.tests.system.walk.wrong_values import WRONG, Call, Calls, outcome

DOORS = ("ocp", "heuristics", "terminal_set", "")
ROOMS = (
    "searches", "problems", "answers", "loops", "simulators", "terminal_sets", "cases",
)  # fmt: skip
SHORT = ("bytes", "complex", "object")
TABLE = yaml.safe_load(Path(__file__).with_name("accepted.yaml").read_text("utf-8"))


@cache
def calls_of(room: str) -> Calls:
    calls: Calls = import_module(f"{__package__}.calls_of_{room}").calls()
    return calls


def accepted(name: str, parameter: str) -> set[str]:
    """Return the wrong values that a parameter may take."""
    if name in TABLE["records"]["names"]:
        return {*WRONG}
    place = f"{name}({parameter})"
    groups = [*TABLE["accepted"], *TABLE["not tried"], *TABLE["errors of users"]]
    return {
        value
        for group in groups
        if place in group["places"]
        for value in group["values"]
    }


def faults(room: str, values: tuple[str, ...]) -> list[str]:
    """Return what comes of wrong values in the calls of a room, if it is a fault."""
    found = []
    for name, call in calls_of(room).items():
        call.with_value(*next(iter(call.valid.items())))  # The valid call.
        for parameter in call.valid:
            allowed = accepted(name, parameter)
            for value in values:
                if value in allowed and _is_slow_or_foreign(name, parameter, value):
                    continue
                came = outcome(call, parameter, WRONG[value])
                if came != "refused" and not (came == "accepted" and value in allowed):
                    found.append(f"{name}({parameter}={value}): {came}")
    return found


def _is_slow_or_foreign(name: str, parameter: str, value: str) -> bool:
    place = f"{name}({parameter})"
    groups = [*TABLE["not tried"], *TABLE["errors of users"]]
    return any(place in g["places"] and value in g["values"] for g in groups)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder: some calls write what they are told to."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("room", ROOMS)
def test_wrong_values_end_in_own_errors_or_are_accepted_for_a_reason(room: str) -> None:
    assert faults(room, tuple(WRONG)) == []


@pytest.mark.parametrize("room", ["searches", "problems"])
def test_nonsense_ends_in_own_errors(room: str) -> None:
    assert faults(room, SHORT) == []


def test_every_public_call_is_walked_with_all_its_parameters() -> None:
    walked = {name: call for room in ROOMS for name, call in calls_of(room).items()}
    left_out = [name for group in TABLE["left out"] for name in group["names"]]
    missing = []
    for name, parameters in public_calls():
        if any(fnmatchcase(name, pattern) for pattern in left_out):
            continue
        own = {
            parameter
            for known, call in walked.items()
            if known == name or known.startswith(f"{name} ")
            for parameter in call.valid
        }
        missing += [f"{name}({one})" for one in parameters if one not in own]
    assert missing == []


def public_calls() -> Iterator[tuple[str, list[str]]]:
    """Yield the public functions, constructors and methods with their parameters."""
    seen: set[int] = set()
    for door in DOORS:
        module = import_module("swarmstart" + f".{door}" * bool(door))
        for name in module.__all__:
            thing = getattr(module, name)
            if id(thing) in seen or not _is_called(thing):
                continue
            seen.add(id(thing))
            yield name, _parameters(thing)
            if isinstance(thing, type):
                yield from _methods(name, thing)


def _is_called(thing: object) -> bool:
    if isinstance(thing, type):
        is_known = issubclass(thing, BaseException | Enum | str)
        return not is_known and not getattr(thing, "_is_protocol", False)
    return inspect.isfunction(thing)


def _methods(name: str, kind: type) -> Iterator[tuple[str, list[str]]]:
    for method in dir(kind):
        if method.startswith("_") and method != "__call__":
            continue
        thing = inspect.getattr_static(kind, method)
        thing = getattr(thing, "__func__", thing)
        if not inspect.isfunction(thing):
            continue
        if parameters := _parameters(thing)[0 if _is_static(kind, method) else 1 :]:
            yield f"{name}.{method}", parameters


def _is_static(kind: type, method: str) -> bool:
    return isinstance(inspect.getattr_static(kind, method), staticmethod)


def _parameters(thing: object) -> list[str]:
    parameters = inspect.signature(thing).parameters  # type: ignore[arg-type]
    return [
        name
        for name, one in parameters.items()
        if one.kind is not one.VAR_KEYWORD and not name.startswith("_")
    ]


def test_the_table_names_walked_parameters_only_and_each_value() -> None:
    walked = {
        f"{name}({parameter})"
        for room in ROOMS
        for name, call in calls_of(room).items()
        for parameter in call.valid
    }
    names = {place.partition("(")[0] for place in walked}
    assert {*TABLE["records"]["names"]} <= names
    for key in ("accepted", "not tried", "errors of users"):
        for group in TABLE[key]:
            assert group["reason"]
            assert {*group["values"]} <= {*WRONG}
            assert {*group["places"]} <= walked


def test_the_walk_sees_a_bare_error_and_a_value_that_is_taken() -> None:
    def careless(number: float) -> float:
        return number + 1

    call = Call(careless, {"number": 1.0})
    assert outcome(call, "number", "abc").startswith("bare TypeError")
    assert outcome(call, "number", 1 + 2j) == "accepted"


def test_what_was_taken_without_a_look_is_refused() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        bounds=ss.Bounds(controls=(-1, 1)),
    )
    with pytest.raises(ss.InvalidProblemError, match=r"lanes must be .*, got 'abc'"):
        ss.Planner(problem, search=None, lanes="abc")  # type: ignore[arg-type]
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    loop = ss.RecedingHorizon(planner=planner)
    plant = ss.Plant(problem.model, dt=problem.dt, substeps=1)
    # At the call, not with the first step.
    with pytest.raises(ss.InvalidProblemError, match=r"steps must be .*, got -1"):
        ss.fly(plant, loop, [0.0], steps=-1, rng=np.random.default_rng(0))
    with pytest.raises(ss.InvalidProblemError, match=r"x0 must be .* real numbers"):
        ss.solve(problem, np.array([1j]), seed=0)
    with pytest.raises(ss.InvalidSettingsError, match=r"size must be .* got 10000"):
        ss.LSHADE(size=10**30)
