"""Machine code that is translated in another thread."""

import os
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import OptimalControlProblem, solve
from swarmstart.ocp.compiled import simd
from swarmstart.ocp.compiled.engine import NoCompilerError, translate
from swarmstart.ocp.compiled.simd import SimdBatch, compile_flat
from swarmstart.ocp.compiled.threads import aside, code_of
from swarmstart.tests.ocp.lanes.problems import cart

pytestmark = pytest.mark.usefixtures("compiler")


@pytest.fixture
def translators(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Return the names of the threads in which code is translated, from now on."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    names: list[str] = []

    def told(ir: str, *, quickly: bool) -> bytes:
        names.append(threading.current_thread().name)
        return translate(ir, quickly=quickly)

    monkeypatch.setattr(simd, "translate", told)
    return names


def squares(factor: float) -> SimdBatch:
    x = ca.SX.sym("x")
    return compile_flat(ca.Function("squares", [x], [factor * x**2]), (True,))


def test_code_is_translated_in_another_thread_and_does_the_same(
    translators: list[str],
) -> None:
    with aside():
        batch = squares(3.0)
    values = np.arange(5.0)[None, :]
    np.testing.assert_array_equal(batch.evaluate([values])[0], 3 * values**2)
    assert len(translators) == 1
    assert translators[0] != threading.current_thread().name
    squares(4.0)
    assert translators[1] == threading.current_thread().name


def test_code_made_aside_is_kept(translators: list[str]) -> None:
    with aside():
        first = squares(5.0).address
    assert first
    assert squares(5.0).address
    assert len(translators) == 1


def test_what_llvm_refuses_is_told_when_it_is_used(
    monkeypatch: pytest.MonkeyPatch, translators: list[str]
) -> None:
    def refused(ir: str, *, quickly: bool) -> bytes:
        raise NoCompilerError("refused")

    monkeypatch.setattr(simd, "translate", refused)
    with aside():
        batch = squares(6.0)
    with pytest.raises(NoCompilerError, match="refused"):
        batch.prepare(8)
    assert not translators


def test_lanes_are_translated_while_the_cold_starts_are_polished(
    translators: list[str],
) -> None:
    def answer(problem: OptimalControlProblem) -> list[str]:
        before = len(translators)
        found = solve(problem, [0.0, 1.0], search=None, lanes=8, seed=0)
        assert found.plan.starts is not None
        assert found.plan.starts.lanes is not None
        return translators[before:]

    own = threading.current_thread().name
    names = answer(cart(intervals=31))
    assert any(name != own for name in names)
    assert answer(cart(intervals=31)) == []


def test_lanes_that_llvm_refuses_leave_the_other_starts(
    monkeypatch: pytest.MonkeyPatch, translators: list[str]
) -> None:
    def refused(ir: str, *, quickly: bool) -> bytes:
        if threading.current_thread() is threading.main_thread():
            return translate(ir, quickly=quickly)
        raise NoCompilerError("refused")

    monkeypatch.setattr(simd, "translate", refused)
    found = solve(cart(intervals=33), [0.0, 1.0], search=None, lanes=8, seed=0)
    assert found.status.is_confirmed
    assert found.plan.starts is not None
    assert found.plan.starts.lanes is None
    assert found.plan.starts.without_lanes == "refused"


def test_code_is_ready_when_the_process_is_copied() -> None:
    """A copy has no thread that would finish it, and would wait forever."""

    def slow() -> bytes:
        time.sleep(0.2)
        return b"code"

    with aside():
        code = code_of(slow)
    assert isinstance(code, Future)
    process = os.fork()
    if not process:
        os._exit(0 if code.done() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0
