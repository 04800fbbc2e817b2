"""The versions that matter; imports nothing heavy, for `--version`."""

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

RECORDED = ("swarmstart", "casadi", "numpy", "numba", "scipy")


def package_version(name: str) -> str:
    """Return an installed package's version; "unknown" where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the versions that matter, as recorded with a run."""
    return {name: package_version(name) for name in RECORDED}


@cache
def environment() -> dict[str, Any]:
    """Return what determines a result besides its settings: versions, and this code."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for folder in ("cases", "ocp", "heuristics", "terminal_set"):
        for file in sorted((root / folder).rglob("*")):
            if file.suffix in (".py", ".yaml"):
                digest.update(file.read_bytes())
    for file in sorted(root.glob("*.py")):
        digest.update(file.read_bytes())
    return {"versions": versions(), "code": digest.hexdigest()}
