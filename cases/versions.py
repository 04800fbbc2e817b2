"""The versions that matter; imports nothing heavy, for `--version`."""

from importlib.metadata import PackageNotFoundError, version

RECORDED = ("swarmstart", "casadi", "numpy", "numba", "scipy", "control")


def package_version(name: str) -> str:
    """Return an installed package's version; "unknown" where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the versions that matter, as recorded with a run."""
    return {name: package_version(name) for name in RECORDED}
