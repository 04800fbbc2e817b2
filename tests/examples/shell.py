"""Pages as a reader follows them: their code and their commands, in a folder."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from swarmstart.tests.processes import environment

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "docs" / "tutorial"
SAVED = r"[Ss]ave this as `(?P<file>[\w.]+)`:\n\n```yaml\n(?P<text>.*?)^```"
BLOCK = r"^```(?P<kind>python|sh)\n(?P<body>.*?)^```"


def blocks(page: Path, kind: str) -> list[str]:
    """Return the blocks of code of a kind, "python" or "sh", in their order."""
    found = re.finditer(BLOCK, page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    return [block["body"] for block in found if block["kind"] == kind]


def commands(page: Path) -> Iterator[str]:
    """Yield the lines of the page's shell blocks, without comments."""
    for block in blocks(page, "sh"):
        for line in block.splitlines():
            command = re.sub(r"\s{2,}#.*", "", line).strip()
            if command and not command.startswith("#"):
                yield command


def save_files(page: Path, folder: Path) -> None:
    """Write the files that the page tells the reader to save."""
    text = page.read_text("utf-8")
    for saved in re.finditer(SAVED, text, re.MULTILINE | re.DOTALL):
        (folder / saved["file"]).write_text(saved["text"], encoding="utf-8")


class Terminal:
    """A folder in which `swarmstart` and `python` are those that are tested.

    Attributes:
        folder: Where commands are run.
    """

    def __init__(self, folder: Path) -> None:
        """Make the two programs in a folder of their own."""
        self.folder = folder / "work"
        programs = folder / "bin"
        self.folder.mkdir()
        programs.mkdir()
        for name, arguments in (("swarmstart", "-m swarmstart "), ("python", "")):
            program = programs / name
            program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}"$@"\n')
            program.chmod(0o755)
        found = environment()
        path = f"{programs}:{found['PATH']}"
        # `swarmstart open` is to print the path, and to open no window.
        self._variables = {**found, "PATH": path, "DISPLAY": "", "WAYLAND_DISPLAY": ""}

    def __call__(self, command: str) -> str:
        """Return what a command prints; it must end well."""
        done = subprocess.run(
            ["/bin/sh", "-c", command],
            cwd=self.folder,
            env=self._variables,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
        return done.stdout
