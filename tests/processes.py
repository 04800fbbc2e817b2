"""Other processes with the package that is tested, and with a cache of their own."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import swarmstart.ocp

ROOT = Path(swarmstart.ocp.__path__[0]).parents[1]
"""Folder that must be on the path for the package to be found."""


NOTHING: Mapping[str, str] = {}


def environment(
    root: Path = ROOT, variables: Mapping[str, str] = NOTHING
) -> dict[str, str]:
    """Return the environment of a process that finds the package under a folder.

    Args:
        root: The folder.
        variables: What is set besides.
    """
    return {**os.environ, "PYTHONPATH": str(root), **variables}


def python(
    *arguments: str, root: Path = ROOT, variables: Mapping[str, str] = NOTHING
) -> subprocess.CompletedProcess[str]:
    """Run Python to its end, which must be a good one.

    Args:
        arguments: Of Python, as -c and a program.
        root: Where the package is; the process begins there.
        variables: What is set in its environment besides.
    """
    done = ended(*arguments, root=root, variables=variables)
    assert done.returncode == 0, done.stderr
    return done


def ended(
    *arguments: str, root: Path = ROOT, variables: Mapping[str, str] = NOTHING
) -> subprocess.CompletedProcess[str]:
    """Run Python to its end, good or bad; see `python`."""
    return subprocess.run(
        [sys.executable, *arguments],
        env=environment(root, variables),
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )


def installed_beside(folder: Path) -> Mapping[str, str]:
    """Return the variables of a process that also finds what lies in a folder."""
    return {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


def announced(folder: Path, name: str, entry_points: str) -> Path:
    """Write what installation writes beside a package; return the entry points' file.

    Args:
        folder: The folder of the package.
        name: Its name.
        entry_points: Text of its entry points.
    """
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
    (info / "METADATA").write_text(metadata)
    file = info / "entry_points.txt"
    file.write_text(entry_points)
    return file
