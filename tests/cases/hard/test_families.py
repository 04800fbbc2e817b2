"""Draws: the same from a seed, possible, valid, and shipped as files."""

import re

import numpy as np
import pytest

from swarmstart.cases.commands.actions.checking import check
from swarmstart.cases.format.scenario import hard_problems, read_document
from swarmstart.cases.format.yaml_reader import parse_yaml
from swarmstart.cases.hard import (
    FAMILIES,
    SHIPPED,
    ImpossibleDrawError,
    draw,
    shipped_text,
)
from swarmstart.cases.hard.draws import first_possible
from swarmstart.errors import InvalidArgumentError


@pytest.mark.parametrize("name", [*SHIPPED])
def test_a_shipped_file_is_what_its_seed_draws(name: str) -> None:
    """This fails if NumPy changes its streams; the files then stay."""
    assert hard_problems()[f"hard/{name}"].read_text() == shipped_text(name)


def test_every_family_is_shipped_in_three_sizes_at_least() -> None:
    families = [family for family, _, _ in SHIPPED.values()]
    assert len(FAMILIES) == 8 and len(SHIPPED) >= 24
    assert all(families.count(family) >= 3 for family in FAMILIES)
    assert hard_problems().keys() == {f"hard/{name}" for name in SHIPPED}


@pytest.mark.parametrize("name", [*SHIPPED])
def test_a_shipped_problem_is_valid(name: str) -> None:
    assert check(f"hard/{name}") == f"hard/{name}.yaml: valid"


@pytest.mark.parametrize("family", [*FAMILIES])
def test_a_seed_gives_one_problem_and_another_seed_another(family: str) -> None:
    _, sizes, seed = next(one for one in SHIPPED.values() if one[0] == family)
    assert draw(family, seed=seed, **sizes) == draw(family, seed=seed, **sizes)
    assert draw(family, seed=seed, **sizes) != draw(family, seed=seed + 1, **sizes)


def test_an_impossible_draw_is_drawn_again_from_the_same_stream() -> None:
    stream = np.random.default_rng(7).random(20)
    wanted = int(np.argmax(stream > 0.9))
    assert 0 < wanted

    def attempt(rng: np.random.Generator) -> float | None:
        number = rng.random()
        return number if number > 0.9 else None

    assert first_possible(attempt, 7) == (
        stream[wanted],
        f"draw {wanted + 1} of seed 7",
    )


def test_the_title_says_the_draw() -> None:
    titles = [str(parse_yaml(shipped_text(n), name=n).data["title"]) for n in SHIPPED]
    assert all(re.search(r"\(draw \d+ of seed 1\)$", title) for title in titles)
    assert any("draw 1 " not in title for title in titles)


def test_a_size_that_fits_in_no_draw_is_an_error() -> None:
    with pytest.raises(ImpossibleDrawError, match="draw among 10000 of seed 0, found"):
        draw("walls", walls=1, gaps=9, seed=0)


@pytest.mark.parametrize(
    ("family", "sizes", "message"),
    [
        ("wals", {"seed": 0}, "family must be one of walls, discs, .* got 'wals'"),
        ("walls", {"walls": 2, "seed": 0}, "the 2 sizes walls, gaps of walls, got"),
        ("discs", {"discs": 0, "seed": 0}, "discs must be an integer of at least 1 "),
        ("discs", {"discs": 101, "seed": 0}, "and at most 100, got 101"),
        ("discs", {"discs": 8.5, "seed": 0}, "discs must be an integer"),
        ("discs", {"discs": 8, "seed": -1}, "seed must be an integer of at least 0"),
    ],
)
def test_bad_sizes_are_refused(
    family: str, sizes: dict[str, int], message: str
) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        draw(family, **sizes)


def test_a_misspelt_name_is_answered_by_the_nearest_hard_problem() -> None:
    with pytest.raises(LookupError, match=r"did you mean hard/walls_4\? .* --hard"):
        read_document("hard/walsl_4")
