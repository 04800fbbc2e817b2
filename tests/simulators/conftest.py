"""FMUs of the pendulum, built once; a compiler that is missing skips their tests."""

from collections.abc import Callable
from pathlib import Path

import pytest

from swarmstart.export.controller.exported import NoCCompilerError, compiler_command
from swarmstart.tests.simulators import pendulum

Built = Callable[..., Path]


@pytest.fixture(scope="session")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Return a function of version and `settable` to an FMU."""
    pytest.importorskip("fmpy")
    try:
        compiler = compiler_command()
    except NoCCompilerError as error:
        pytest.skip(str(error))
    known: dict[tuple[str, bool], Path] = {}

    def file(version: str = "2.0", *, settable: bool = True) -> Path:
        key = version, settable
        if key not in known:
            folder = tmp_path_factory.mktemp("fmu")
            known[key] = pendulum.built(folder, version, compiler, settable=settable)
        return known[key]

    return file
