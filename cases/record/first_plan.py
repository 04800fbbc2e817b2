"""The first plan of a record, as a guess for another run."""

from pathlib import Path

import numpy as np

from swarmstart.cases.record.record import TRAJECTORY

LARGEST_FILE = 100 * 2**20
"""Bytes of a trajectory that is read."""


def recorded_plan(folder: object) -> tuple[list[float], list[list[float]]]:
    """Return the beginnings of the intervals [s] and a row for each control.

    Args:
        folder: The folder of a run of one problem.

    Raises:
        ValueError: If there is no plan to be read, with the reason.
    """
    if not isinstance(folder, str):
        raise ValueError(f"expected guess.record to be a folder, found {folder!r}")
    file = Path(folder) / TRAJECTORY
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise ValueError("the file is too large")
        with np.load(file, allow_pickle=False) as arrays:
            times, plans = arrays["times"], arrays["plan_controls"]
        controls = np.asarray(plans[0, 0], dtype=np.float64)
        dt = float(times[1] - times[0])
    except (OSError, ValueError, LookupError, TypeError, EOFError) as error:
        raise ValueError(
            f"expected guess.record to be the folder of a run, found {folder!r}: "
            f"{error}"
        ) from None
    rows = np.atleast_2d(controls)
    if not (np.isfinite(rows).all() and dt > 0):
        raise ValueError(f"expected a plan of finite numbers in {folder!r}")
    return (dt * np.arange(rows.shape[1])).tolist(), rows.tolist()
