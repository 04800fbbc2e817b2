"""The first plan of a record, or a saved solution, as a guess for another run."""

from pathlib import Path

import numpy as np

from swarmstart.cases.record.files import read_arrays
from swarmstart.cases.record.partial import UNREADABLE
from swarmstart.cases.record.record import TRAJECTORY
from swarmstart.cases.record.results import SOLUTION

LARGEST_FILE = 100 * 2**20
"""Largest size of a file that is read [B]."""


def recorded_plan(folder: object) -> tuple[list[float], list[list[float]]]:
    """Return the starts of the intervals [s] and a row of values for each control.

    For linear controls these are knots, the last one at the end of the plan.

    Args:
        folder: The folder of a run of one problem, or of a saved Solution.

    Raises:
        ValueError: If no plan can be read, with the reason.
    """
    if not isinstance(folder, str):
        raise ValueError(f"expected guess.record to be a folder, found {folder!r}")
    saved, flown = Path(folder) / SOLUTION, Path(folder) / TRAJECTORY
    file = saved if saved.exists() else flown
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise ValueError("the file is too large")
        arrays = read_arrays(file)
        plan = arrays["controls"] if file == saved else arrays["plan_controls"][0, 0]
        rows = np.atleast_2d(np.asarray(plan, dtype=np.float64))
        steps = arrays["controls"].shape[1] - int("knots" in arrays)
        if "control_ends" in arrays:  # A plan keeps the ends of linear controls.
            rows = np.hstack([arrays["controls"][:, :1], rows])
        dt = float(arrays["times"][-1] - arrays["times"][0]) / steps
    except (*UNREADABLE, ArithmeticError) as error:
        raise ValueError(
            f"expected guess.record to be the folder of a run, found {folder!r}: "
            f"{error}"
        ) from None
    if not (np.isfinite(rows).all() and 0 < dt < np.inf):
        raise ValueError(f"expected a plan of finite numbers in {folder!r}")
    return (dt * np.arange(rows.shape[1])).tolist(), rows.tolist()
