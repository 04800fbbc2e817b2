"""The first use of an algorithm: compiled once, in two processes, and said."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from swarmstart.heuristics import ParticleSwarm
from swarmstart.heuristics.running import ahead
from swarmstart.heuristics.running.ahead import compiled_ahead
from swarmstart.tests.processes import ROOT, python

FIRST_USE = """
import logging, sys
logging.basicConfig(level=logging.INFO, stream=sys.stdout, format="%(message)s")
import numba
from swarmstart.heuristics import Budget, RandomSearch, minimize
compiled = []
class Listener(numba.core.event.Listener):
    def on_start(self, event): pass
    def on_end(self, event): compiled.append(event.data["dispatcher"].__name__)
numba.core.event.register("numba:compile", Listener())
found = minimize(
    lambda x: (x**2).sum(axis=0), bounds=[(-1, 2)] * 3,
    algorithm=RandomSearch(size=10), budget=Budget(seconds=0.2), seed=0,
)
print(found.compile_seconds > found.seconds, *compiled)
"""


def first_use(cache: Path, **variables: str) -> list[str]:
    """Return the log, and the kernels that this process compiles."""
    variables["XDG_CACHE_HOME"] = str(cache)
    done = python("-c", FIRST_USE, variables=variables)
    return done.stdout.split("\n")


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two processors")
def test_a_helper_compiles_what_this_process_does_not(tmp_path: Path) -> None:
    said, last, *_ = first_use(tmp_path)
    assert said == "compiling the search for this machine, once, about 10 s"
    slower, *compiled = last.split()
    assert slower == "True"  # A budget of 0.2 s: all the compiling stands apart.
    assert "propose" in compiled and "collect" not in compiled
    last, *_ = first_use(tmp_path)  # From the cache: nothing to say.
    assert not {"propose", "accept", "collect"} & set(last.split())


def test_without_a_helper_all_is_compiled_here(tmp_path: Path) -> None:
    _, last, *_ = first_use(tmp_path, **{ahead._IN_HELPER: "1"})
    assert {"propose", "accept", "collect"} <= set(last.split())


def test_a_helper_that_fails_is_no_harm(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        f"import os, sys\nif '{ahead._IN_HELPER}' in os.environ: os._exit(1)\n"
    )
    path = f"{tmp_path}{os.pathsep}{ROOT}"
    _, last, *_ = first_use(tmp_path, PYTHONPATH=path)
    assert {"propose", "accept", "collect"} <= set(last.split())


def test_a_helper_ends_with_its_context_and_starts_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ahead, "_is_possible", lambda: True)
    monkeypatch.setattr(ahead, "_CODE", "import time; time.sleep(60)")
    started = []
    popen = subprocess.Popen

    def spied(*arguments: object, **options: object) -> object:
        started.append(popen(*arguments, **options))  # type: ignore[call-overload]
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", spied)
    with (
        pytest.raises(KeyboardInterrupt),
        compiled_ahead(ParticleSwarm(), compiled=True),
    ):
        with compiled_ahead(ParticleSwarm(), compiled=True):
            pass
        assert started[0].poll() is None
        raise KeyboardInterrupt
    assert len(started) == 1
    assert started[0].poll() is not None


def test_an_algorithm_that_cannot_be_sent_is_compiled_here() -> None:
    class Local(ParticleSwarm):
        """A class that another process cannot find."""

    with compiled_ahead(Local(), compiled=True) as helper:
        helper.wait()
        assert helper.part == ()
