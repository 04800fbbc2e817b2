"""Recorded PNG figures as data: addresses, small enough for one page.

The size of a page is limited. Figures have few colours: with a palette of 256 at the
width that a page shows they take about a third of the bytes that matplotlib writes. The
palette is that of an octree, which keeps the colours of thin lines; a median cut, which
counts pixels, makes them grey. The caption comes from the kind of the scenario that
draws a figure.
"""

import base64
import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePath

from swarmstart.cases.format.registry import words_of
from swarmstart.cases.record.record import FIGURES

PAGE_BYTES = 3_000_000
"""Largest size of a page [bytes]."""
MOST_FILE_BYTES = 20_000_000
"""Largest size of the file of a figure that is opened [bytes]."""
MOST_PIXELS = 40_000_000
WIDTH = 960
"""Width of a figure [pixels]: twice that at which figures are shown side by side."""
SMALL_WIDTH = 640
SHEET = "a_sheet"
"""Name of the sheet, which has twice that width."""
_COLOURS = 256


@dataclass(frozen=True, kw_only=True, slots=True)
class Picture:
    """A figure in a page.

    Attributes:
        caption: Sentence on the subject of the figure.
        data: PNG file in base64; empty if the figure is left out.
        width: Width of the image [pixels].
        height: Height of the image [pixels].
        missing: Sentence on why the figure is left out; empty if it is shown.
        is_wide: Whether the figure takes a whole row, such as a sheet of several parts.
    """

    caption: str
    data: str = ""
    width: int = 0
    height: int = 0
    missing: str = ""
    is_wide: bool = False


def pictures_of(
    folder: Path, names: Iterable[str], kind: str, *, room: int, width: int = WIDTH
) -> list[Picture]:
    """Return a record's figures, as many as there is room for.

    If a figure has several formats, only the PNG file is shown.

    Args:
        folder: Folder of the record.
        names: Names of files in the record's folder of figures; no other file is read.
        kind: Kind of the scenario, for the captions.
        room: Number of bytes that the figures may take in the page.
        width: Largest width of a figure [pixels].
    """
    found = []
    listed = [*names]
    drawn = {Path(name).stem for name in listed if _is_png(name)}
    for name in listed:
        if not _is_png(name) and Path(name).stem in drawn:
            continue
        # Only the last part of a name: no record leads out of its folder.
        picture = _picture(folder / FIGURES / Path(name).name, kind, width)
        if len(picture.data) > room:
            picture = Picture(
                caption=picture.caption,
                missing="It is left out to keep the page small; it is among the "
                "record's figures.",
            )
        room -= len(picture.data)
        found.append(picture)
    return found


def caption_of(kind: str, file: str) -> str:
    """Return the caption of a figure; for an unknown figure its name in words.

    Args:
        kind: Kind of the scenario.
        file: Name of the figure's file.

    Example:
        >>> caption_of("problem", "b_states.png")
        'States over time; dotted: their bounds.'
        >>> caption_of("problem", "z_own_figure.png")
        'Own figure.'
    """
    stem = PurePath(file).stem
    known = words_of(kind).captions.get(stem)
    if known is not None:
        return known
    letter, _, rest = stem.partition("_")
    words = (rest if len(letter) == 1 and rest else stem).replace("_", " ")
    return words[:1].upper() + words[1:] + "."


def _is_png(name: str) -> bool:
    return Path(name).suffix.casefold() == ".png"


def _picture(file: Path, kind: str, width: int) -> Picture:
    caption, is_wide = caption_of(kind, file.name), file.stem == SHEET
    width *= 1 + is_wide
    if file.suffix.casefold() != ".png":
        return Picture(
            caption=caption, missing=f"{file.name} is no PNG file: open it by itself."
        )
    try:
        if file.stat().st_size > MOST_FILE_BYTES:
            return Picture(caption=caption, missing="Its file is too large for a page.")
        content, size = _shrunk(file.read_bytes(), width)
    # Pillow raises any of these on a damaged file: SyntaxError for a broken chunk.
    except (OSError, ValueError, SyntaxError, ArithmeticError, LookupError):
        return Picture(caption=caption, missing="Its file cannot be read as an image.")
    data = base64.b64encode(content).decode("ascii")
    return Picture(
        caption=caption, data=data, width=size[0], height=size[1], is_wide=is_wide
    )


def _shrunk(content: bytes, width: int) -> tuple[bytes, tuple[int, int]]:
    """Return a PNG file of at most some width with few colours, and its size.

    Raises:
        ValueError: If it is too large.
        OSError: If it is no image.
    """
    from PIL import Image

    # No other decoder than that of PNG sees a user's file.
    with Image.open(io.BytesIO(content), formats=("PNG",)) as opened:
        # Before it is decoded: a small file can hold a huge image.
        if opened.width * opened.height > MOST_PIXELS:
            raise ValueError("too many pixels")
        image = opened.convert("RGBA")
    if image.getchannel("A").getextrema() != (255, 255):
        # What is transparent is paper: figures are drawn in dark ink.
        image = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image)
    image = image.convert("RGB")
    if image.width > width:
        height = max(1, round(image.height * width / image.width))
        image = image.resize((width, height), Image.Resampling.LANCZOS)
    octree = Image.Quantize.FASTOCTREE
    few = image.quantize(_COLOURS, method=octree, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    # 9, the smallest, takes three times as long for 4 % fewer bytes.
    few.save(buffer, format="PNG", compress_level=8)
    return buffer.getvalue(), few.size
