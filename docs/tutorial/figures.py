"""Draw the figures of the tutorial: `python docs/tutorial/figures.py`.

Each page's Python code is run in a temporary folder, and the figures that the page
shows are copied from there. The figure of `own_file.md` is that of a run of its YAML
file.
"""

import contextlib
import io
import os
import re
import shutil
import tempfile
from pathlib import Path

import matplotlib as mpl
from PIL import Image

import swarmstart as ss

HERE = Path(__file__).resolve().parent
WIDTH, COLOURS = 1100, 128
"""Largest size [px] and number of colours of the figures of a run."""
PAGES = ("swing_up", "obstacle", "closed_loop", "terminal_set", "compare")


def drawn(page: Path, folder: Path) -> None:
    """Run the Python code of a page in a folder."""
    names: dict[str, object] = {"__name__": page.stem}
    text = page.read_text(encoding="utf-8")
    os.chdir(folder)
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        with contextlib.redirect_stdout(io.StringIO()):
            exec(compile(block, str(page), "exec"), names)


def run_file(page: Path, folder: Path) -> None:
    """Run the YAML file that a page shows, and keep its sheet and its tracks."""
    text = page.read_text(encoding="utf-8")
    (file,) = re.findall(r"^```yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (folder / "vehicle.yaml").write_text(file, encoding="utf-8")
    finished = ss.run(folder / "vehicle.yaml", seed=0, out=folder / "vehicle")
    for figure in finished.figures:
        for part, ending in (("sheet", ""), ("tracks", "_way")):
            if part in figure.stem and figure.suffix == ".png":
                image = Image.open(figure).convert("RGB")
                image.thumbnail((WIDTH, WIDTH))
                image.quantize(COLOURS).save(folder / f"{page.stem}{ending}.png")


def main() -> None:
    """Draw every figure, and copy it beside its page."""
    mpl.use("Agg")
    for name in (*PAGES, "own_file"):
        with tempfile.TemporaryDirectory() as folder:
            draw = run_file if name == "own_file" else drawn
            draw(HERE / f"{name}.md", Path(folder))
            for figure in Path(folder).glob("*.png"):
                shutil.copy(figure, HERE)


if __name__ == "__main__":
    main()
