"""Balls of the precision that the checker's command sets."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator

import pytest

from swarmstart.terminal_set.check import PRECISION


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    """Work with the command's precision; nothing to do without python-flint."""
    if importlib.util.find_spec("flint") is None:
        yield
        return
    flint = importlib.import_module("flint")
    before = flint.ctx.prec
    flint.ctx.prec = PRECISION
    yield
    flint.ctx.prec = before
