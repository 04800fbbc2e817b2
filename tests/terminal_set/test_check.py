"""The independent checker: what holds is proven again, what was changed is refused."""

from __future__ import annotations

import itertools
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from swarmstart.terminal_set.check import main
from swarmstart.terminal_set.checker.file_content import digest
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (
    CHEN_REFUTED,
    MU,
    Content,
    chen,
    formation,
    refuted_chen,
    replaced,
    signed,
)

flint = pytest.importorskip("flint")

Check = Callable[..., tuple[int, str]]


def numbers(value: object, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from numbers(entry, (*path, key))
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from numbers(entry, (*path, i))
    elif isinstance(value, int | float):
        yield path


def looked_up(content: Content, path: tuple[Any, ...]) -> Any:
    for key in path:
        content = content[key]
    return content


def test_chen_allgoewer_is_proven_up_to_one_percent_below_its_refutation(
    check: Check,
) -> None:
    code, said = check(chen())
    assert code == 0
    assert "re-proved: V decreases on 0 < V(e) <= 0.941569" in said
    assert "refused" not in said


def test_a_rate_of_decrease_is_proven_to_the_published_level(check: Check) -> None:
    # V' <= -e'(Q + K'RK)e holds to 0.73201 (the paper: 0.7).
    K = np.array([[2.118, 2.118]])
    Q_m = (0.5 * np.eye(2) + K.T @ K).tolist()
    assert check(chen(Q_m=Q_m, alpha=0.724, refuted=None))[0] == 0
    code, said = check(chen(Q_m=Q_m, alpha=0.74, refuted=None))
    assert code == 3
    assert "decrease" in said


@pytest.mark.parametrize("R", [(1.0, 1.0), (1.0, 100.0), (1.0, 1000.0)])
def test_the_formation_held_one_second_is_proven_at_its_whole_input_bound(
    check: Check, R: tuple[float, float]
) -> None:
    code, said = check(formation(R))
    assert code == 0
    assert "re-proved: V decreases over a hold of 1 s" in said
    assert "sampled only: the flow is within 0.00021" in said


def test_growth_that_is_only_measured_is_only_sampled(check: Check) -> None:
    margins = formation()["margins"]
    margins["between_samples"] = {"growth": 4.0, "grounds": "measured"}
    code, said = check(formation(margins=margins))
    assert code == 0
    assert "sampled only: V grows by less than 4" in said


def test_growth_between_samples_is_proven_for_every_instant(check: Check) -> None:
    margins = formation((1.0, 1.0))["margins"]
    margins["between_samples"] = {"growth": 2.4, "grounds": "proven"}
    code, said = check(formation((1.0, 1.0), margins=margins))
    assert code == 0
    assert "re-proved: V stays below 2.4 V(e) between samples" in said


@pytest.mark.parametrize("growth", [1.0, 1.9])
def test_growth_that_is_exceeded_is_refused(check: Check, growth: float) -> None:
    # The set grows to 1.998 of its level between samples, at 0.44 s.
    margins = formation()["margins"]
    margins["between_samples"] = {"growth": growth, "grounds": "proven"}
    code, said = check(formation((1.0, 1.0), margins=margins))
    assert code == 3
    assert f"{growth:.6g}" in said


def test_states_need_room_for_the_growth_between_samples(check: Check) -> None:
    content = formation((1.0, 1.0))
    margins = content["margins"]
    reach = math.sqrt(content["alpha"] * np.linalg.inv(np.array(content["P"]))[0, 0])
    bounds = replaced(content, ("bounds", "x_upper", 0), 15 + 1.2 * reach)["bounds"]
    assert check(formation((1.0, 1.0), bounds=bounds))[0] == 0
    margins["between_samples"] = {"growth": 2.4, "grounds": "measured"}
    code, said = check(formation((1.0, 1.0), bounds=bounds, margins=margins))
    assert code == 3
    assert "x[0] (if V grows no more than was measured) leaves its bounds" in said


def test_every_number_changed_is_refused_by_the_digest(check: Check) -> None:
    for content in (chen(), formation()):
        paths = list(numbers(content))
        assert len(paths) > 40
        for path in paths:
            old = looked_up(content, path)
            new = old + 1 if isinstance(old, int) else math.nextafter(old, math.inf)
            code, said = check(replaced(content, path, new))
            assert (code, "digest" in said) == (3, True), path


def test_the_digest_is_the_one_of_the_format() -> None:
    content = chen()
    assert digest(content) == content["sha256"]


def swapped_lyapunov() -> list[list[float]]:
    """P of the transposed Lyapunov equation, whose V does not fall for the loop."""
    closed = np.array([[0.0, 1.0], [1.0, 0.0]]) - MU * np.array(
        [[1.0], [1.0]]
    ) @ np.array([[4.0, 0.5]])
    P = scipy.linalg.solve_continuous_lyapunov(closed, -np.eye(2))
    return ((P + P.T) / 2).tolist()  # type: ignore[no-any-return]


FALSE = {
    "level past the refuted one": {"alpha": 1.02 * CHEN_REFUTED, "refuted": None},
    "level past its own counterexample": {"alpha": 1.02 * CHEN_REFUTED},
    "level past the input bound": {
        "bounds": {
            "u_lower": [-0.5],
            "u_upper": [2.0],
            "x_lower": [None, None],
            "x_upper": [None, None],
        }
    },
    "level past a state bound": {
        "bounds": {
            "u_lower": [-2.0],
            "u_upper": [2.0],
            "x_lower": [-0.3, None],
            "x_upper": [None, None],
        }
    },
    "gain that does not contract": {"K": [[0.2118, 0.2118]], "refuted": None},
    "gain of the other sign": {"K": [[-2.118, -2.118]], "refuted": None},
    "indefinite P": {"P": [[16.5926, 18.0], [18.0, 16.5926]], "refuted": None},
    "asymmetric P": {"P": [[16.5926, 11.0], [12.0, 16.5926]], "refuted": None},
    "indefinite Q_m": {"Q_m": [[-1.0, 0.0], [0.0, 0.0]], "refuted": None},
    "Q_m that the loop does not reach": {
        "Q_m": [[90.0, 0.0], [0.0, 90.0]],
        "refuted": None,
    },
    "refuted point off its level": {"refuted": refuted_chen() | {"alpha": 0.96}},
    "refuted point that decreases": {
        "refuted": {
            "alpha": 16.5926 * 0.25**2,
            "e": [0.25, 0.0],
            "change": 0.0,
        }
    },
    "reference that is no equilibrium": {"reference": {"x": [0.0, 0.0], "u": [0.1]}},
    "reference outside the bounds": {"reference": {"x": [0.0, 0.0], "u": [3.0]}},
}


@pytest.mark.parametrize("changes", FALSE.values(), ids=FALSE)
def test_what_is_false_is_refused_with_a_recomputed_digest(
    check: Check, changes: Content
) -> None:
    code, said = check(chen(**changes))
    assert code == 3
    assert "digest" not in said
    assert said.splitlines()[-1] == "verdict: refused"


def test_a_changed_constant_of_the_dynamics_is_refused(check: Check) -> None:
    dynamics = replaced(chen(), ("dynamics", "tape", 10, 1), 40.0)["dynamics"]
    code, said = check(chen(dynamics=dynamics, refuted=None))
    assert code == 3
    assert "does not decrease" in said


def test_p_of_the_transposed_lyapunov_equation_is_refused(check: Check) -> None:
    # A gain far from symmetric, so that transposing matters.
    code, said = check(
        chen(P=swapped_lyapunov(), K=[[4.0, 0.5]], alpha=1e-3, refuted=None)
    )
    assert code == 3
    assert "V does not decrease at e = " in said


def test_the_continuous_gain_held_one_second_is_refused(check: Check) -> None:
    K = [[1.7321, 0.0, 1.0, 0.0], [0.0, 5.5678, 0.0, 1.0]]
    code, _ = check(formation(K=K, alpha=0.005))
    assert code == 3


def test_a_smaller_error_of_the_integrator_is_refused(check: Check) -> None:
    margins = formation()["margins"]
    margins["integrator"]["relative_error"] = 1e-8
    code, said = check(formation(margins=margins))
    assert code == 3
    assert "the flow leaves the Runge-Kutta map" in said


def test_a_margin_that_uses_up_the_decrease_is_refused(check: Check) -> None:
    margins = formation()["margins"]
    margins["integrator"]["relative_error"] = 0.5
    code, said = check(formation(margins=margins))
    assert code == 3
    assert "decrease" in said


def test_an_equality_in_the_linear_part_is_never_proven(check: Check) -> None:
    # x' = u = -x with P = 3: V' = -6 e^2, and all of it is claimed as reserve.
    content = chen(
        dynamics={"nx": 1, "nu": 1, "tape": [["u", 0]], "xdot": [0]},
        reference={"x": [0.0], "u": [0.0]},
        bounds={"u_lower": [None], "u_upper": [None]}
        | {"x_lower": [None], "x_upper": [None]},
        K=[[1.0]],
        P=[[3.0]],
        Q_m=[[6.0]],
        refuted=None,
        design={"name": "by hand", "Q": None, "R": None, "kappa": None},
    )
    code, said = check(content)
    assert code == 4
    assert "the linear part has no margin" in said
    assert check(signed(content | {"Q_m": [[5.999]]}))[0] == 0


@pytest.mark.parametrize("size", [1e150, 1e200, -1e300])
def test_numbers_that_overflow_prove_nothing(check: Check, size: float) -> None:
    """A power of floats raised an error."""
    dynamics = replaced(chen(), ("dynamics", "tape", 3, 1), size)["dynamics"]
    assert check(chen(dynamics=dynamics, refuted=None))[0] in (3, 4)


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock on which every look takes a second."""
    ticks = itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: float(next(ticks)))


@pytest.mark.usefixtures("looks")
def test_too_little_time_leaves_it_undecided_and_says_how_far_it_came(
    check: Check,
) -> None:
    code, said = check(chen(), "--seconds", "30")
    assert code == 4
    assert "boxes left in the queue" in said
    assert "verdict: undecided within 30 s" in said


@pytest.mark.usefixtures("looks")
@pytest.mark.parametrize("substeps", [1, 10_000])
def test_samples_and_closed_forms_end_at_the_deadline_too(
    check: Check, substeps: int
) -> None:
    """Ten thousand substeps were integrated at 200 points, whatever the time."""
    code, said = check(formation(substeps=substeps), "--seconds", "100")
    assert code == 4
    assert "undecided: the rest: time was up before it could be judged" in said


UNUSABLE = {
    "a missing key": (("alpha",), None, 'the file: expected the key "alpha"'),
    "an unknown key": (("beta",), 1.0, "found 'beta'"),
    "an unknown version": (("version",), 3, "version: expected 1 or 2, found 3"),
    "a forward reference": (
        ("dynamics", "tape", 5),
        ["mul", 4, 5],
        "dynamics.tape[5][2]: expected an integer from 0 to 4, found 5",
    ),
    "an unknown operation": (
        ("dynamics", "tape", 5),
        ["eval", 4],
        "dynamics.tape[5][0]: expected a known operation, found 'eval'",
    ),
    "an unknown state": (("dynamics", "tape", 0), ["x", 2], "from 0 to 1, found 2"),
    "a wrong shape": (("K",), [[1.0]], "K[0]: expected a list of 2"),
    "a text for a number": (("alpha",), "1", "alpha: expected a number, found '1'"),
    "a negative level": (("alpha",), -1.0, "alpha: expected a number above 0"),
    "a truth value": (("alpha",), True, "alpha: expected a number, found True"),
    "substeps without dt": (("substeps",), 1, "null if dt is null"),
    "other grounds": (
        ("statements", 0, "grounds"),
        "believed",
        'statements[0].grounds: expected "proven" with the margins stated',
    ),
    "a statement in other words": (
        ("statements", 0, "statement"),
        "safe in every weather",
        "statements[0].statement: expected a statement of the format",
    ),
    "a statement twice": (
        ("statements", 1),
        chen()["statements"][0],
        "statements[1].statement: expected each statement once",
    ),
    "a statement of held inputs": (
        ("statements", 0),
        formation()["statements"][0],
        "statements[0].statement: expected a statement of the format",
    ),
    "a digest that is text": (
        ("sha256",),
        "\x1b[2J\x1b]0;owned\x07",
        "sha256: expected 64 hexadecimal digits",
    ),
}


@pytest.mark.parametrize(("path", "value", "words"), UNUSABLE.values(), ids=UNUSABLE)
def test_an_unusable_file_is_named_with_place_expectation_and_find(
    check: Check, path: tuple[Any, ...], value: object, words: str
) -> None:
    content = replaced(chen(), path, value)
    if value is None:
        del content[path[0]]
    code, said = check(content if path == ("sha256",) else signed(content))
    assert code == 2
    assert words in said
    assert len(said.splitlines()) == 1
    assert said.rstrip("\n").isprintable()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not valid JSON"),
        ("[]", "is no"),
        ('{"format": NaN}', "NaN is no number"),
        ('{"a": 1, "a": 2}', "a key is given twice"),
        (json.dumps(chen(alpha=77.0)).replace("77.0", "1e999"), "not finite"),
    ],
)
def test_what_is_no_certificate_is_not_judged(
    check: Check, text: str, words: str
) -> None:
    code, said = check(text)
    assert code == 2
    assert words in said


def test_a_file_that_cannot_be_read_has_its_own_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "none.json")]) == 5
    assert "cannot be read" in capsys.readouterr().err


def test_without_python_flint_one_sentence_says_what_to_install(
    check: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "flint", None)
    code, said = check(chen())
    assert code == 2
    assert said == (
        "python-flint is needed to check a certificate: pip install python-flint\n"
    )


def test_an_interrupt_ends_with_130(
    check: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("swarmstart.terminal_set.check.findings", interrupt)
    assert check(chen())[0] == 130


def test_an_independent_evaluation_agrees_that_v_falls_on_the_proven_set() -> None:
    P = np.array(chen()["P"])
    rng = np.random.default_rng(0)
    z = rng.standard_normal((2, 100_000))
    z *= np.sqrt(chen()["alpha"] * rng.random(100_000)) / np.linalg.norm(z, axis=0)
    e = np.linalg.solve(np.linalg.cholesky(P).T, z)
    u = -2.118 * (e[0] + e[1])
    rate = np.vstack(
        [
            e[1] + u * (MU + (1 - MU) * e[0]),
            e[0] + u * (MU - 4 * (1 - MU) * e[1]),
        ]
    )
    assert np.max(np.sum(e * (P @ rate), axis=0)) < 0
