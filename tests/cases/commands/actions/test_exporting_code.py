"""`swarmstart export c` and `fmu` write the controller of a scenario."""

import zipfile
from pathlib import Path

import pytest

from swarmstart.cases.commands.front.cli import main

CART = """\
schema: 1
kind: problem
title: Cart
states: {x: {start: 1.0, rate: v}, v: {start: 0.0, rate: f}}
controls: {f: {bounds: [-1, 1]}}
prediction: {horizon_s: 2.0, intervals: 8}
stage_cost: x**2 + v**2 + 0.1*f**2
search: {name: lshade, when: needed}
budget: {evaluations: 200}
polish: ipopt
"""


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    """Return the file of a small scenario."""
    file = tmp_path / "cart.yaml"
    file.write_text(CART)
    return file


def exported(*words: str | Path) -> int:
    return main(["export", "c", *map(str, words)])


def test_the_files_have_the_name_of_the_scenario(
    cart: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Or the one that is given; a second call replaces none."""
    out = tmp_path / "out"
    assert exported(cart, "--out", out, "--starts", "1") == 0
    names = sorted(file.name for file in out.iterdir())
    assert names == ["CMakeLists.txt", "cart.c", "cart.h"]
    told = capsys.readouterr().out.splitlines()
    assert sorted(told) == [f"file  {out / name}" for name in names]
    before = (out / "cart.c").read_bytes()
    # Before anything is computed: 2000 starts are refused later.
    assert exported(cart, "--out", out, "--starts", "2000") == 5
    assert "expected a new file" in capsys.readouterr().err
    assert (out / "cart.c").read_bytes() == before
    more = ("--name", "wagon", "--main", "--precision", "single")
    assert exported(cart, "--out", out / "more", "--starts", "0", *more) == 0
    assert (out / "more" / "wagon_main.c").exists()
    assert "NO RESCUE" in (out / "more" / "wagon.c").read_text()
    assert "typedef float" in (out / "more" / "wagon.h").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--format", "csv"), "--format: expected export trajectory with it"),
        (("--height", "1"), "--height: expected export trajectory with it"),
        (("--vehicle", "2"), "--vehicle: expected a number from 1 to 1, found 2"),
        (("--vehicle", "x"), "--vehicle: expected one number from 1 to 1"),
        (("--name", "a-b"), "name: expected letters, digits and _"),
        (("--name", "a" * 300), "name: expected at most"),
        (("--starts", "257"), "starts must be"),
        (("--iterations", "1001"), "iterations must be"),
        (("--set", "search.when=always"), "take when='needed'"),
        (("--set", "prediction.intervals=x"), "intervals"),
        (("--variant", "fast"), "variant"),
        (("--fmi", "2.0"), "--fmi: expected export fmu with it"),
    ],
)
def test_options_that_do_not_fit_have_exit_code_2(
    cart: Path, tmp_path: Path, words: tuple[str, ...], message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """One sentence each, and no file."""
    assert exported(cart, "--out", tmp_path / "out", *words) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_options_of_c_are_refused_with_a_trajectory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They would have no effect."""
    for words in (["--main"], ["--starts", "3"], ["--set", "a=1"]):
        assert main(["export", "trajectory", str(tmp_path), *words]) == 2
        assert f"{words[0]}: expected export c with it" in capsys.readouterr().err


def test_signals_that_the_code_takes_as_ramps_are_named(
    cart: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    price = "signals: {price: {times: [0, 0.3], values: [1, 3], between: hold}}\n"
    cart.write_text(price + CART.replace("0.1*f**2", "0.1*price*f**2"))
    assert exported(cart, "--out", tmp_path / "out", "--starts", "0") == 0
    assert "cart: price jumps or bends between 0.25 s and 0.5 s" in (
        capsys.readouterr().err
    )


def test_a_member_of_a_team_is_exported_with_the_plans_it_sees(tmp_path: Path) -> None:
    """UAV 3 plans past the plans of two others, which are its signals."""
    words = ("--set", "search.when=needed", "--starts", "0", "--out", tmp_path / "out")
    assert exported("formation_obstacle_uav3", "--vehicle", "1", *words) == 0
    header = (tmp_path / "out" / "formation_obstacle_uav3.h").read_text()
    assert "_NS " in header


def test_a_swarm_has_no_receding_horizon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its vehicles commit themselves to plans."""
    assert exported("swarm_20", "--out", tmp_path / "out") == 2
    assert "expected a receding-horizon controller" in capsys.readouterr().err


def test_an_fmu_has_the_version_that_is_asked_for(
    cart: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By default 3.0; a program in C is for C only."""
    for words, version in (((), b"3.0"), (("--fmi", "2.0"), b"2.0")):
        out = tmp_path / version.decode()
        call = ["export", "fmu", cart, "--out", out, "--starts", "0", *words]
        assert main([*map(str, call)]) == 0
        with zipfile.ZipFile(out / "cart.fmu") as archive:
            described = archive.read("modelDescription.xml")
        assert b'fmiVersion="' + version in described
    assert main(["export", "fmu", str(cart), "--main"]) == 2
    assert "--main: expected export c with it" in capsys.readouterr().err
