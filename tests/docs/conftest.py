"""The documentation site, built once for all tests."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import swarmstart

ROOT = Path(swarmstart.__file__).resolve().parent
DOCS = ROOT / "docs"
BUILT = "SWARMSTART_SITE"
"""Environment variable with the folder of a site that is built already."""


class Site(NamedTuple):
    """A built site.

    Attributes:
        folder: The folder with its pages.
        said: What the build said, a line for each warning.
    """

    folder: Path
    said: str


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    """Return the site, built by the first test process that needs it."""
    if BUILT in os.environ:
        return Site(ROOT / os.environ[BUILT], "")
    if not DOCS.exists():
        pytest.skip("the documentation is not beside an installed package")
    for package in ("sphinx", "myst_parser", "furo", "sphinx_gallery"):
        pytest.importorskip(package)
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    folder = shared / "site"
    with (shared / "site.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        said = shared / "site.said"
        if not said.exists():
            said.write_text(_built(folder), encoding="utf-8")
    return Site(folder, said.read_text(encoding="utf-8"))


def _built(folder: Path) -> str:
    """Build the site; return what Sphinx says, which is nothing if all is well."""
    arguments = ["-q", "-j", "auto", "-b", "html"]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *arguments, str(DOCS), str(folder)],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "SWARMSTART_GALLERY": "0",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout + done.stderr
