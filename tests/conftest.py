"""An empty cache of machine code, and the mark of tests that take long."""

import gc
import os
import signal
from pathlib import Path

# Matrices are small, and other workers use the other processors: threads of BLAS would
# wait for each other. It is read when NumPy is imported, here or in a worker.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# A machine may be busy: no test asserts times.
settings.register_profile("swarmstart", deadline=None)
settings.load_profile("swarmstart")

LONG = Path(__file__).with_name("long.txt")
"""Names of tests that `make test` leaves out: slow ones, and cases like others."""
FIRST = ("tests/system/test_replicate.py", "tests/system/", "tests/adversary/")
"""Files that are begun first: at the end one worker would wait for the other."""


def long_tests() -> list[str]:
    """Return the names of the tests that `make test` leaves out."""
    lines = LONG.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def pytest_configure() -> None:
    """Let Ctrl-C interrupt, which a shell has its background jobs ignore.

    Thousands of tests are kept to the end. To look through them for garbage, again and
    again, took a fifth of the time of `make test`.
    """
    gc.disable()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that take long, and put the longest files first."""
    names = set(long_tests())
    for item in items:
        if item.nodeid in names:
            item.add_marker(pytest.mark.long)

    def place(item: pytest.Item) -> int:
        starts = [item.nodeid.startswith(part) for part in FIRST]
        return starts.index(True) if any(starts) else len(starts)

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """Look for garbage among what the tests make, not among the tests themselves."""
    gc.freeze()
    gc.enable()


@pytest.fixture
def fresh_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache; the folder that code will be kept in."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "swarmstart" / "machine-code"
