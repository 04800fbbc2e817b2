"""Statements of a file are read unchanged, and numbers must be within their limits."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import pytest

pytest.importorskip("flint")

from swarmstart.terminal_set.checker import certificate_file
from swarmstart.terminal_set.checker.certificate_file import Refuted
from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (
    Content,
    chen,
    formation,
    replaced,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import as_read


def rows(matrix: list[list[float]]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix))


def test_every_entry_is_read_as_it_stands() -> None:
    content = chen(
        reference={"x": [0.5, -0.25], "u": [0.125]}, Q_m=[[2.0, 0.5], [0.25, 1.0]],
        core={"level": 1e-9, "drift": 0.125}, P=[[3.0, 1.0], [0.5, 2.0]],
    )  # fmt: skip
    found = as_read(content)
    assert (found.nx, found.nu, found.dt, found.substeps) == (2, 1, None, None)
    assert (found.x_ref, found.u_ref) == ((0.5, -0.25), (0.125,))
    assert (found.K, found.P) == (((2.118, 2.118),), ((3.0, 1.0), (0.5, 2.0)))
    assert (found.Q_m, found.alpha) == (((2.0, 0.5), (0.25, 1.0)), content["alpha"])
    assert (found.core, found.drift) == (1e-9, 0.125)
    assert found.bounds == {
        "u_lower": (-2.0,), "u_upper": (2.0,), "x_lower": (None, None),
        "x_upper": (None, 1.0),
    }  # fmt: skip
    refuted = content["refuted"]
    assert found.refuted == Refuted(alpha=refuted["alpha"], e=tuple(refuted["e"]))
    assert found.tape[:4] == (
        ("x", (0,), 0.0), ("x", (1,), 0.0), ("u", (0,), 0.0), ("const", (), 0.5)
    )  # fmt: skip
    assert found.tape[5] == ("mul", (4, 0), 0.0) and found.xdot == (8, 14)
    assert (found.integrator, found.growth, found.growth_proven) == (None, None, False)


@pytest.mark.parametrize("grounds", ["proven", "measured"])
def test_margins_of_a_hold_are_read(grounds: str) -> None:
    between = {"growth": 2.5, "grounds": grounds}
    content = replaced(formation(), ("margins", "between_samples"), between)
    found = as_read(signed(replaced(content, ("substeps",), 7)))
    assert (found.dt, found.substeps, found.integrator) == (1.0, 7, 2.1e-4)
    assert (found.growth, found.growth_proven) == (2.5, grounds == "proven")


def held(path: tuple[Any, ...], value: object) -> Content:
    between = {"growth": 2.5, "grounds": "proven"}
    content = replaced(formation(), ("margins", "between_samples"), between)
    return signed(replaced(content, path, value))


ERROR, GROWTH = ("margins", "integrator"), ("margins", "between_samples")


@pytest.mark.parametrize(
    ("path", "allowed", "refused"),
    [
        (("version",), [2], [0, 1, 3, 1.0, True]),
        (("alpha",), [5e-324, 1e308], [0.0, -1.0, 10**400]),
        (("dt",), [5e-324, 2], [0.0, -0.5]),
        (("substeps",), [1, 10_000], [0, 10_001, None, 1.0]),
        (("core", "level"), [0.0, 1e-3], [-1e-9]),
        (("core", "drift"), [0.0, 1e-3], [-1e-9]),
        ((*ERROR, "relative_error"), [0.0, 1e-3], [-1e-9]),
        ((*ERROR, "samples"), [0, 10**15], [-1, 10**15 + 1, 0.5]),
        ((*ERROR, "grounds"), ["measured"], ["proven", "", 1]),
        ((*GROWTH, "growth"), [5e-324, 1e9], [0.0, -1.0]),
        ((*GROWTH, "grounds"), ["measured", "proven"], ["believed"]),
        (("proof", "boxes"), [0, 10**15], [-1, 10**15 + 1]),
        (("proof", "seconds"), [0.0, 1e9], [-1e-9]),
        (("dynamics", "nx"), [4], [0, 3, 5, 51, 4.0]),
        (("dynamics", "nu"), [2], [0, 1, 3, 51]),
        (("dynamics", "xdot", 0), [0, 7], [-1, 8]),
        (("dynamics", "tape", 4), [["cos", 0], ["cos", 3]], [["cos", 4], ["cos", -1]]),
        (("dynamics", "tape", 0), [["x", 0], ["x", 3]], [["x", 4], ["sin", 0], []]),
        (("dynamics", "tape", 2), [["u", 0], ["u", 1]], [["u", 2], ["u", 0, 0]]),
        (("dynamics", "tape", 6), [["mul", 5, 0], ["const", 2]], [["mul", 5, 6]]),
        (("reference", "x", 0), [9007199254740992, 0.1], [9007199254740993, "1", None]),
        (("bounds", "u_lower", 0), [None, -1.0], [True, "1"]),
        (("K", 0, 0), [-1.0, 0], [None]),
        (("refuted",), [None], [{}]),
        (("design", "name"), ["own"], [1, None]),
        (("design", "kappa"), [None, 0.5], ["0.5"]),
        (("design", "R"), [None, [[1, 0], [0, 1]]], [[[1]], 1]),
        (("design", "Q"), [None], [[[1, 0], [0, 1]]]),
    ],
)
def test_numbers_are_taken_within_their_limits(
    path: tuple[Any, ...], allowed: list[object], refused: list[object]
) -> None:
    for value in allowed:
        as_read(held(path, value))
    for value in refused:
        with pytest.raises(CertificateFileError):
            as_read(held(path, value))


@pytest.mark.parametrize("level", [1e-300, 1.0])
def test_refuted_level_is_above_zero(level: float) -> None:
    content = chen()
    as_read(signed(replaced(content, ("refuted", "alpha"), level)))
    for wrong in (0.0, -level):
        with pytest.raises(CertificateFileError, match="above 0"):
            as_read(signed(replaced(content, ("refuted", "alpha"), wrong)))


def large(states: int, inputs: int) -> Content:
    """x' = x_0 of many states and inputs."""
    content = copy.deepcopy(chen(refuted=None))
    content["dynamics"] = {
        "nx": states, "nu": inputs, "tape": [["x", 0]], "xdot": [0] * states
    }  # fmt: skip
    content["reference"] = {"x": [0.0] * states, "u": [0.0] * inputs}
    content["bounds"] = {
        f"{name}_{side}": [None] * size
        for name, size in (("x", states), ("u", inputs)) for side in ("lower", "upper")
    }  # fmt: skip
    content["P"] = content["Q_m"] = [[0.0] * states] * states
    content["K"] = [[0.0] * states] * inputs
    content["design"] = {"name": "own", "Q": None, "R": None, "kappa": None}
    return signed(content)


def test_sizes_are_limited() -> None:
    assert (as_read(large(50, 50)).nx, as_read(large(50, 50)).nu) == (50, 50)
    for states, inputs in ((51, 1), (1, 51)):
        with pytest.raises(CertificateFileError, match="an integer from 1 to 50"):
            as_read(large(states, inputs))


def test_tape_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    content = chen()
    tape = content["dynamics"]["tape"]
    assert certificate_file.LONGEST_TAPE == 100_000
    limited = dataclasses.replace(certificate_file._READ, longest_tape=len(tape))
    monkeypatch.setattr(certificate_file, "_READ", limited)
    as_read(content)
    longer = replaced(content, ("dynamics", "tape"), [*tape, ["neg", 0]])
    for wrong in (longer, replaced(content, ("dynamics", "tape"), [])):
        with pytest.raises(CertificateFileError, match=r"1 to 15 instructions"):
            as_read(signed(wrong))


@pytest.mark.parametrize("name", ["integrator", "between_samples"])
def test_inputs_that_move_have_no_margins_of_a_hold(name: str) -> None:
    margin = {
        "integrator": {"relative_error": 0.1, "grounds": "measured", "samples": 1},
        "between_samples": {"growth": 1.5, "grounds": "proven"},
    }[name]
    content = replaced(chen(), ("margins", name), margin)
    with pytest.raises(CertificateFileError, match="null if dt is null"):
        as_read(signed(content))


@pytest.mark.parametrize("proven", [True, False])
def test_statements_are_those_of_the_kind_of_set(proven: bool) -> None:
    content = held((*GROWTH, "grounds"), "proven" if proven else "measured")
    text = "e'Pe stays below the stated growth between samples"
    for grounds in ("proven", "measured"):
        stated = [{"statement": text, "grounds": grounds}]
        changed = signed(content | {"statements": stated})
        if (grounds == "proven") is proven:
            as_read(changed)
        else:
            with pytest.raises(CertificateFileError, match="with the margins stated"):
                as_read(changed)


@pytest.mark.parametrize("integrator", [True, False])
@pytest.mark.parametrize("growth", [True, False])
def test_states_between_samples_are_proven_only_with_error_and_growth(
    integrator: bool, growth: bool
) -> None:
    grounds = certificate_file.expected_statements(
        held=True, integrator_proven=integrator, growth_proven=growth
    )
    states = "the states stay within their bounds on the set, between samples too"
    proven = grounds[states] == certificate_file.TAKEN
    assert proven is (integrator and growth)
