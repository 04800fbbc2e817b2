"""Captions in words of figures, by the kind of the scenario that draws them."""

from pathlib import PurePath

from swarmstart.cases.format.registry import words_of


def caption_of(kind: str, file: str) -> str:
    """Return what a figure shows; of an unknown one its name in words.

    Args:
        kind: Of the scenario.
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
