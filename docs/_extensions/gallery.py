"""The gallery: the scripts of `examples`, run when the site is built, with pictures.

Made pages lie in `docs/gallery` and are kept until the code changes: their scripts or
the package itself. `SWARMSTART_GALLERY=0` makes the pages without running anything.
"""

import hashlib
import os
import shutil
from pathlib import Path
from typing import Any

import matplotlib as mpl

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "gallery"
KEPT = PAGES / ".made_of"
"""File with the hash of the code that the pages were made by."""
FOLDERS = (
    "ocp", "heuristics", "terminal_set", "machine_code", "export", "simulators",
    "cases",
)  # fmt: skip
SECTIONS = ("plans", "processes", "vehicles", "uncertainty", "proofs", "doors")
IS_RUN = os.environ.get("SWARMSTART_GALLERY", "1") != "0"


def settings() -> dict[str, Any]:
    """Return the settings of sphinx-gallery."""
    return {
        "examples_dirs": "../examples",
        "gallery_dirs": "gallery",
        "backreferences_dir": "gallery/backreferences",
        "filename_pattern": r"\.py$",
        "subsection_order": [f"../examples/{s}" for s in SECTIONS],
        "within_subsection_order": "FileNameSortKey",
        "plot_gallery": IS_RUN,
        "abort_on_example_error": True,
        "reset_modules": ("matplotlib", f"{__name__}.dressed"),
        "notebook_extensions": set(),
        "copyfile_regex": r".*\.yaml",
        "remove_config_comments": True,
        "show_memory": False,
        "show_signature": False,
        "min_reported_time": 1e9,
        "download_all_examples": False,
        "write_computation_times": False,
        "thumbnail_size": (400, 280),
    }


def dressed(_configuration: dict[str, Any], _file: str) -> None:
    """Set the style of the pictures."""
    mpl.rcParams.update(
        {
            "figure.figsize": (6.4, 3.8),
            "figure.constrained_layout.use": True,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.alpha": 0.3,
            "animation.html": "jshtml",
        }
    )


def dropped_if_old() -> None:
    """Remove pages of other code, or without pictures if these are due."""
    now, kept = code_hash(), ""
    if KEPT.exists():
        kept = KEPT.read_text(encoding="utf-8")
    if kept == f"{now} run" or (not IS_RUN and kept == f"{now} not run"):
        return
    shutil.rmtree(PAGES, ignore_errors=True)
    PAGES.mkdir()
    KEPT.write_text(f"{now} {'run' if IS_RUN else 'not run'}", encoding="utf-8")


def code_hash() -> str:
    """Return a hash of the package's code."""
    found = hashlib.sha256()
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")]
    for file in sorted([*ROOT.glob("*.py"), *files]):
        found.update(file.read_bytes())
    return found.hexdigest()
