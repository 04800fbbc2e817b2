"""Colours that can be seen: contrast on both pages, and no two alike."""

import itertools

import numpy as np
import pytest

from swarmstart.cases.drawing import palette
from swarmstart.tests.cases.drawing.reading import contrast

TEXT = ("ink", "ink-soft", "accent", "good", "bad", "mid")
PAGES = [
    (palette.LIGHT, palette.LIGHT_PAGE),
    (palette.DARK, palette.DARK_PAGE),
]
# Machado et al. (2009), severity 1: protanopia, deuteranopia, tritanopia.
DEFICIENCIES = (
    np.eye(3),
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
     [-0.003882, -0.048116, 1.051998]],
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
     [-0.011820, 0.042940, 0.968881]],
    [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
     [0.004733, 0.691367, 0.303900]],
)  # fmt: skip


@pytest.mark.parametrize(("colours", "page"), PAGES)
def test_lines_and_text_stand_out_from_the_page(
    colours: tuple[str, ...], page: dict[str, str]
) -> None:
    assert len(set(colours)) == 12
    for colour in (*colours, page["line"]):
        assert contrast(colour, page["ground"]) >= 3
    for ground in (page["ground"], page["raised"]):
        assert all(contrast(page[name], ground) >= 4.5 for name in TEXT)


@pytest.mark.parametrize(("colours", "page"), PAGES)
def test_no_two_solvers_look_alike_with_any_colour_vision(
    colours: tuple[str, ...], page: dict[str, str]
) -> None:
    for matrix in DEFICIENCIES:
        seen = [_oklab(np.asarray(matrix) @ _linear(colour)) for colour in colours]
        pairs = itertools.combinations(seen, 2)
        # A just noticeable difference is about 0.02.
        assert min(np.linalg.norm(a - b) for a, b in pairs) > 0.09


def test_dashes_and_marks_differ_for_grey_print() -> None:
    assert len(set(palette.DASHES)) == len(set(palette.MARKS)) == 12


def _linear(colour: str) -> np.ndarray:
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def _oklab(rgb: np.ndarray) -> np.ndarray:
    first = [[0.4122214708, 0.5363325363, 0.0514459929],
             [0.2119034982, 0.6806995451, 0.1073969566],
             [0.0883024619, 0.2817188376, 0.6299787005]]  # fmt: skip
    second = [[0.2104542553, 0.7936177850, -0.0040720468],
              [1.9779984951, -2.4285922050, 0.4505937099],
              [0.0259040371, 0.7827717662, -0.8086757660]]  # fmt: skip
    cones = np.cbrt(np.asarray(first) @ np.clip(rgb, 0, 1))
    return np.asarray(np.asarray(second) @ cones)
