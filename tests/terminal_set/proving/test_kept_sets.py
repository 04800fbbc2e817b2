"""Kept certificates: believed if all agrees, else proven again."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.machine_code import code_cache
from swarmstart.terminal_set import Reference, TerminalSet, Weights, certificate_text
from swarmstart.terminal_set.linear import kept, matrix_equations
from swarmstart.terminal_set.proving import certification, kept_sets
from swarmstart.terminal_set.proving.certification import certified_terminal_set

Content = dict[str, Any]

OTHER_PROCESS = """
from swarmstart.tests.terminal_set.proving.test_kept_sets import certified
print(repr(certified(0.05).alpha))
"""


def certified(dt: float | None, seed: int = 0) -> TerminalSet:
    """Certify a pendulum that is held upright by a motor with much room."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])
    room = np.array([50.0])
    upright = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1), u_lower=-room, u_upper=room
    )
    rng = np.random.default_rng(seed)
    weights = Weights(Q=np.eye(2), R=np.eye(1))
    found = certified_terminal_set(f, upright, weights, dt=dt, rng=rng)
    certified.after = rng.random()  # type: ignore[attr-defined]
    return found


def text_of(found: TerminalSet) -> str:
    assert found.certificate is not None
    return certificate_text(found.certificate)


def file_of_set(folder: Path) -> Path:
    """Return the file of the only certificate that is kept."""
    (found,) = [file for file in folder.iterdir() if b'"alpha"' in file.read_bytes()]
    return found


def forge(file: Path, change: Callable[[Content], object]) -> None:
    """Change a file's content, and give it the digest that belongs to it."""
    content = json.loads(file.read_bytes()[32:])
    change(content)
    seal(file, json.dumps(content).encode())


def seal(file: Path, text: bytes) -> None:
    file.write_bytes(hashlib.sha256(file.name.encode() + text).digest() + text)


class ProvesError(Exception):
    """A certificate is proven; tests that need no answer stop here."""


@pytest.fixture(scope="module")
def genuine(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, bytes]:
    """The file of a kept certificate: its name and its content."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("genuine")))
        certified(0.05)
        file = file_of_set(code_cache.folder())
        return file.name, file.read_bytes()


@pytest.fixture
def file(
    genuine: tuple[str, bytes], fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """The genuine file in an empty cache; a proof raises `ProvesError`."""
    fresh_cache.mkdir(mode=0o700, parents=True)
    (fresh_cache / genuine[0]).write_bytes(genuine[1])

    def prove(*_: object, **__: object) -> TerminalSet:
        raise ProvesError

    monkeypatch.setattr(certification, "_certified", prove)
    return fresh_cache / genuine[0]


@pytest.mark.parametrize("dt", [None, 0.05])
def test_a_kept_certificate_is_the_proven_one_to_the_last_bit(
    dt: float | None, fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, drawn = certified(dt), certified.after  # type: ignore[attr-defined]
    assert file_of_set(fresh_cache).stat().st_size < 1000
    monkeypatch.delattr(certification, "_certified")
    again = certified(dt)
    assert text_of(again) == text_of(first)
    # The caller's generator goes on as after a proof.
    assert certified.after == drawn  # type: ignore[attr-defined]
    with pytest.raises(NameError):
        certified(dt, seed=1)


def double_alpha(content: Content) -> None:
    content["alpha"] *= 2
    content["refutation"] = None


FORGERIES: dict[str, Callable[[Content], object]] = {
    "alpha doubled": double_alpha,
    "alpha doubled, with its counterexample": lambda c: c.update(alpha=2 * c["alpha"]),
    "alpha negative": lambda c: c.update(alpha=-1.0),
    "alpha not a number": lambda c: c.update(alpha=float("nan")),
    "alpha text": lambda c: c.update(alpha="much"),
    "no alpha": lambda c: c.pop("alpha"),
    "no integrator error": lambda c: (
        c.update(refutation=None),
        c["held"].__setitem__(0, 0.0),
    ),
    "growth below one": lambda c: c["held"].__setitem__(2, 0.5),
    "growth without end": lambda c: c["held"].__setitem__(2, float("inf")),
    "no margins": lambda c: c.update(held=None),
    "another counterexample": lambda c: c.update(refutation=[1e3, [0.1, 0.1], 1.0]),
    "counterexample of three": lambda c: c.update(refutation=[1e3, [1, 1, 1], 1.0]),
    "time not a number": lambda c: c["proof"].__setitem__(1, float("nan")),
    "generator of another kind": lambda c: c["rng"].update(bit_generator="MT19937"),
    "generator without numbers": lambda c: c["rng"].pop("state"),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_a_forged_entry_with_its_digest_is_proven_again(name: str, file: Path) -> None:
    certified(0.05)  # As long as it is genuine, it is believed.
    forge(file, FORGERIES[name])
    with pytest.raises(ProvesError):
        certified(0.05)


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"[" * 100_000, b"null", b"\xff"])
def test_what_is_no_entry_is_proven_again(text: bytes, file: Path) -> None:
    seal(file, text)
    with pytest.raises(ProvesError):
        certified(0.05)


@pytest.mark.parametrize("damage", ["cut", "short", "changed"])
def test_a_damaged_file_is_proven_again(damage: str, file: Path) -> None:
    content = file.read_bytes()
    damaged = {"cut": content[:-1], "short": content[:20]}
    file.write_bytes(damaged.get(damage, content.replace(b"alpha", b"alphA")))
    with pytest.raises(ProvesError):
        certified(0.05)


def test_a_new_proof_replaces_a_forged_entry(
    genuine: tuple[str, bytes], fresh_cache: Path
) -> None:
    fresh_cache.mkdir(mode=0o700, parents=True)
    file = fresh_cache / genuine[0]
    file.write_bytes(genuine[1])
    forge(file, double_alpha)
    found = certified(0.05)
    kept, first = (json.loads(one[32:]) for one in (file.read_bytes(), genuine[1]))
    assert found.alpha == kept["alpha"] == first["alpha"]


@pytest.mark.parametrize("other", ["source", "generator", "hold"])
def test_an_entry_of_something_else_is_not_used(
    other: str, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if other == "source":
        monkeypatch.setattr(kept_sets, "_code", lambda: ("another", "1", "2"))
    with pytest.raises(ProvesError):
        certified(0.1 if other == "hold" else 0.05, seed=int(other == "generator"))
    assert file.exists()


def test_two_processes_may_prove_at_once(fresh_cache: Path) -> None:
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", OTHER_PROCESS], stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    printed = [process.communicate(timeout=300)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert printed[0] == printed[1] == f"{certified(0.05).alpha!r}\n"
    assert json.loads(file_of_set(fresh_cache).read_bytes()[32:])["alpha"] > 0


def test_without_a_folder_each_call_proves(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    certified(0.05)
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    for value in (str(blocked), str(tmp_path / "missing")):
        monkeypatch.setenv("XDG_CACHE_HOME", value)
        with pytest.raises(ProvesError):
            certified(0.05)
    assert file.exists()


def test_a_kept_gain_that_does_not_solve_its_equation_is_designed_again(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "_stored", count())
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    first = matrix_equations.sampled_lqr(A, B, np.eye(2), np.eye(1))
    (file,) = fresh_cache.iterdir()
    written = file.read_bytes()
    K, P = json.loads(written[32:])
    forged = [[[2 * k for k in K[0]]], P], [K, (2 * np.array(P)).tolist()], [K], [P, K]
    for content in (*forged, [K, [[0.0, 0.0], [0.0, 0.0]]], [[["x"]], P], {"K": K}):
        seal(file, json.dumps(content).encode())
        again = matrix_equations.sampled_lqr(A, B, np.eye(2), np.eye(1))
        assert np.array_equal(again.K, first.K) and np.array_equal(again.P, first.P)
        assert file.read_bytes() == written
