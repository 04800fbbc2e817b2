"""The text of an exported controller, and what cannot be exported."""

import re
from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.export import CExport
from swarmstart.export.paths import ExportError
from swarmstart.tests.export.controller.controllers import (
    dual_mode,
    integrator,
    loop_of,
    pendulum,
)

Made = Callable[[str], CExport]


def test_the_text_has_no_heap_recursion_or_jumps(made: Made) -> None:
    """It says whose it is, which flags give equal bits, and its bound."""
    files = made("way_round").files
    source, header = files["way_round.c"], files["way_round.h"]
    words = set(re.findall(r"[a-z_]+", source.split("*/", 1)[1]))
    assert not words & {"malloc", "calloc", "free", "goto", "while", "do", "alloca"}
    assert "sin(" not in source.replace("_sin(", "")
    names = re.findall(r"^static \w+ (\w+)\(", source, flags=re.MULTILINE)
    for name, body in zip(
        names, re.split(r"^static \w+ \w+\(", source)[1:], strict=False
    ):
        assert f" {name}(" not in body.split("\n}", 1)[0]
    assert "#error" in source
    said = " ".join(header.split("#ifndef")[0].split())
    assert "The text is yours" in said
    assert "-ffp-contract=off" in said
    assert "2 seeded starts" in said
    assert f"NAME_MOST_OPERATIONS {made('way_round').most_operations}ull" in (
        header.replace("way_round", "NAME")
    )


def test_a_file_without_starts_says_so() -> None:
    """In the head of both files."""
    controller, x0 = dual_mode()
    made = ss.export_c(controller, x0, name="alone", starts=0)
    for file in ("alone.c", "alone.h"):
        assert "THERE IS NO RESCUE" in made.files[file]


def test_the_same_call_writes_the_same_text() -> None:
    """Byte for byte; another seed has other starts."""
    texts = []
    for seed in (0, 0, 1):
        controller, x0 = dual_mode()
        made = ss.export_c(controller, x0, name="same", seed=seed, main=True)
        texts.append(made.files)
    assert texts[0] == texts[1]
    assert texts[0]["same.c"] != texts[2]["same.c"]


def test_the_certificate_goes_along(made: Made) -> None:
    """With a proven set in double precision; single precision has rounded numbers."""
    assert "dual_mode.certificate.json" in made("dual_mode").files
    controller, x0 = dual_mode()
    single = ss.export_c(controller, x0, name="brief", precision="single")
    assert [*single.files] == ["brief.c", "brief.h", "CMakeLists.txt"]
    assert "typedef float" in single.files["brief.h"]


@pytest.mark.parametrize("name", ["", "1st", "a-b", "int", "x" * 41, "ä", "main"])
def test_names_are_identifiers(name: str) -> None:
    """Not words of C, and not too long."""
    controller, x0 = dual_mode()
    with pytest.raises(ExportError, match="name: expected"):
        ss.export_c(controller, x0, name=name)


def _free_end() -> ss.RecedingHorizon:
    problem = replace(integrator(), horizon=ss.Free(0.2, 4.0))
    return loop_of(problem, period=0.2)


def _stiff() -> ss.RecedingHorizon:
    return loop_of(replace(integrator(), integrator="stiff"))


def _searching() -> ss.RecedingHorizon:
    search = ss.SearchSettings(
        algorithm=ss.LSHADE(), budget=ss.Budget(evaluations=100), when="always"
    )
    planner = ss.Planner(integrator(), search=search, polish=ss.IpoptOptions())
    return ss.RecedingHorizon(planner=planner)


def _without_polish() -> ss.RecedingHorizon:
    return ss.RecedingHorizon(
        planner=ss.Planner(integrator(), search="lshade", polish=None)
    )


def _timed() -> ss.RecedingHorizon:
    return loop_of(integrator(), within=0.1)


def _unshifted() -> ss.RecedingHorizon:
    return loop_of(integrator(), shift=False)


def _knots() -> ss.RecedingHorizon:
    return loop_of(replace(integrator(), control_shape="linear"))


def _checks() -> ss.RecedingHorizon:
    problem = integrator()
    limit = ss.PathConstraint(expression=problem.model.states[1], upper=2.0)
    return loop_of(replace(problem, checks=2, constraints=[limit]))


def _of_one_interval() -> ss.RecedingHorizon:
    return loop_of(replace(integrator(), intervals=1))


def _from_near() -> ss.RecedingHorizon:
    return loop_of(replace(integrator(), features=[ss.CountedFrom({"x_0": 1e9})]))


def _held() -> ss.RecedingHorizon:
    price = ca.SX.sym("price")
    priced = replace(integrator(), signals=price, features=[ss.HeldSignals(["price"])])
    return loop_of(priced, reference=lambda times: np.ones((1, times.size)))


def _of_time() -> ss.RecedingHorizon:
    x, u, t = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("t")
    model = ss.Model(states=x, controls=u, ode=u + ca.sin(t), time=t)
    return loop_of(
        ss.OptimalControlProblem(
            model, horizon=1.0, intervals=4, stage_cost=x**2 + u**2,
            bounds=ss.Bounds(controls=(-1, 1)),
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (_free_end, "its end time is free: fix the horizon"),
        (_stiff, "its model is stiff|no fixed number of steps"),
        (_searching, "a C file has no population: take when='needed'"),
        (_without_polish, "it has no polish"),
        (_timed, "a C file counts operations instead"),
        (_unshifted, "take shift=True"),
        (_knots, "linear between knots: hold them"),
        (_checks, "constraints within an interval: take checks=1"),
        (_of_one_interval, "one interval: take two or more"),
        (_from_near, "far from zero"),
        (_held, "are held over intervals .*give them as linear"),
        (_of_time, "a feature that a C file has not"),
    ],
)
def test_what_cannot_be_written_is_named_with_a_way(
    make: Callable[[], ss.RecedingHorizon], words: str
) -> None:
    """Before anything is written."""
    with pytest.raises(ExportError, match=words):
        ss.export_c(make(), [1.0, 0.0][: make().planner.stated.model.nx], name="one")


def test_a_target_that_moves_is_refused() -> None:
    """The set's reference is a constant of the file."""
    controller, x0 = dual_mode()
    assert isinstance(controller, ss.DualMode)
    for target, words in (
        (lambda time: np.array([time, 0.0]), "the target of the terminal set moves"),
        (lambda time: np.array([1.0, 0.0]), "is not the reference"),
    ):
        moved = ss.DualMode(controller.team, sets=controller.sets, targets=[target])
        with pytest.raises(ExportError, match=words):
            ss.export_c(moved, x0, name="moved")


def test_a_law_does_not_remember_controls() -> None:
    """Its set is one of the stated states."""
    controller, x0 = dual_mode()
    assert isinstance(controller, ss.DualMode)
    before = ca.SX.sym("before")
    plain = integrator()
    costly = replace(
        plain, previous=before, step_cost=(plain.model.controls - before) ** 2
    )
    law = ss.DualMode(loop_of(costly), sets=controller.sets, targets=controller.targets)
    with pytest.raises(ExportError, match=r"remembers controls .*leave out one"):
        ss.export_c(law, x0, name="law")


def test_a_missing_state_is_refused() -> None:
    """The library says so in each of its calls."""
    controller, _ = pendulum()
    with pytest.raises(ss.InvalidProblemError, match="x0 must have shape"):
        ss.export_c(controller, [0.0], name="one")
    with pytest.raises(ss.InvalidProblemError, match="must be a RecedingHorizon or"):
        ss.export_c("pendulum", [0.0], name="one")  # type: ignore[arg-type]
