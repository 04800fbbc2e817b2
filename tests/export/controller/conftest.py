"""Fixtures of exported controllers, each made once."""

from collections.abc import Callable
from functools import cache

import pytest

from swarmstart.export import CExport, export_c
from swarmstart.export.controller.exported import NoCCompilerError, compiler_command
from swarmstart.tests.export.controller.controllers import CASES


@cache
def _made(name: str) -> CExport:
    controller, x0 = CASES[name]()
    return export_c(controller, x0, name=name, starts=2, main=True)


@pytest.fixture(scope="session")
def made() -> Callable[[str], CExport]:
    """Return the export of a case, by its name."""
    return _made


@pytest.fixture(scope="session")
def c_compiler() -> str:
    """Return the command of a C compiler; tests that need one are skipped without."""
    try:
        return compiler_command()
    except NoCCompilerError as error:
        pytest.skip(str(error))
