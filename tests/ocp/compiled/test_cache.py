import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import swarmstart.machine_code.code_cache as cache
from swarmstart.machine_code import fingerprints
from swarmstart.ocp.compiled import simd
from swarmstart.ocp.compiled.engine import machine, translate
from swarmstart.ocp.compiled.simd import compile_flat, compile_rollout
from swarmstart.tests.processes import environment

pytestmark = [
    pytest.mark.usefixtures("compiler"),
    pytest.mark.skipif(os.name == "nt", reason="modes of files are POSIX's"),
]
KEY, CODE = "0123abcd", b"machine code"


@pytest.fixture
def translated(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The modules translated, that is not loaded from the cache."""
    modules: list[str] = []

    def spied(ir: str, *, quickly: bool) -> bytes:
        modules.append(ir)
        return translate(ir, quickly=quickly)

    monkeypatch.setattr(simd, "translate", spied)
    return modules


def function(factor: float = 2.0) -> ca.Function:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    return ca.Function("f", [x, p], [factor * ca.sin(x) + p])


def build_and_check() -> None:
    """Compile the function and check what it returns."""
    values = np.linspace(-1, 1, 9)
    got = compile_flat(function(), (True, False)).bind((np.ones(1),))(values[None])
    np.testing.assert_allclose(got[0], 2 * np.sin(values) + 1, rtol=1e-15)


def test_second_build_is_loaded(fresh_cache: Path, translated: list[str]) -> None:
    build_and_check()
    build_and_check()
    assert len(translated) == 1
    assert len(list(fresh_cache.iterdir())) == 1


def test_folder_and_file_are_the_user_s_own_only(fresh_cache: Path) -> None:
    before = os.umask(0)
    try:
        build_and_check()
    finally:
        os.umask(before)
    (file,) = fresh_cache.iterdir()
    assert fresh_cache.stat().st_mode & 0o777 == 0o700
    assert file.stat().st_mode & 0o777 == 0o600


def link_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = folder.with_name("elsewhere")
    folder.rename(real)
    folder.symlink_to(real, target_is_directory=True)


def open_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.chmod(0o770)


def give_folder_away(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: other)


@pytest.mark.parametrize("spoil", [link_folder, open_folder, give_folder_away])
def test_folder_that_others_could_write_is_not_used(
    fresh_cache: Path,
    translated: list[str],
    monkeypatch: pytest.MonkeyPatch,
    spoil: Callable[[Path, pytest.MonkeyPatch], None],
) -> None:
    build_and_check()
    spoil(fresh_cache, monkeypatch)
    before = sorted(os.listdir(fresh_cache))
    build_and_check()
    build_and_check()
    assert len(translated) == 3
    assert sorted(os.listdir(fresh_cache)) == before
    cache.store_code(KEY, CODE)
    assert cache.load_code(KEY) is None


def link_file(file: Path) -> None:
    real = file.with_name("moved")
    file.rename(real)
    file.symlink_to(real)


def flip_bits(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x10
    file.write_bytes(bytes(content))


def flip_digest(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[0] ^= 1
    file.write_bytes(bytes(content))


@pytest.mark.parametrize(
    "spoil",
    [
        link_file,
        flip_bits,
        flip_digest,
        lambda file: file.chmod(0o620),
        lambda file: file.chmod(0o602),
        lambda file: file.write_bytes(file.read_bytes()[:-1]),
        lambda file: file.write_bytes(file.read_bytes()[:10]),
        lambda file: file.write_bytes(b""),
    ],
)
def test_file_that_cannot_be_trusted_is_built_anew(
    fresh_cache: Path, translated: list[str], spoil: Callable[[Path], object]
) -> None:
    build_and_check()
    (file,) = fresh_cache.iterdir()
    spoil(file)
    build_and_check()
    assert len(translated) == 2
    assert not file.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o600
    build_and_check()
    assert len(translated) == 2


def test_file_of_another_user_is_not_loaded(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.store_code(KEY, CODE)
    assert cache.load_code(KEY) == CODE
    monkeypatch.setattr(cache, "_is_private", lambda where: True)
    give_folder_away(fresh_cache, monkeypatch)
    assert cache.load_code(KEY) is None


def test_folder_in_the_place_of_a_file_is_left_alone(fresh_cache: Path) -> None:
    cache.store_code(KEY, CODE)
    (fresh_cache / "other").mkdir()
    cache.store_code("other", CODE)
    assert cache.load_code("other") is None
    assert sorted(os.listdir(fresh_cache)) == [KEY, "other"]


def test_code_under_another_s_key_is_not_loaded(fresh_cache: Path) -> None:
    cache.store_code(KEY, CODE)
    (fresh_cache / KEY).rename(fresh_cache / "another")
    assert cache.load_code("another") is None


def test_home_that_cannot_be_written_does_no_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, translated: list[str]
) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(in_the_way))
    build_and_check()
    build_and_check()
    assert len(translated) == 2
    assert in_the_way.read_text() == "in the way"


def test_relative_cache_home_is_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache.folder() == tmp_path / ".cache" / "swarmstart" / "machine-code"


def test_user_without_a_home_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    cache.store_code(KEY, CODE)
    assert cache.load_code(KEY) is None
    assert os.listdir(tmp_path) == []


def test_failed_write_leaves_no_file(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(source: object, target: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", fail)
    cache.store_code(KEY, CODE)
    assert os.listdir(fresh_cache) == []


BUILD = """
import sys
import casadi as ca
import numpy as np
from swarmstart.ocp.compiled.simd import compile_flat

sys.stdin.readline()
x = ca.SX.sym("x", 40)
kernel = compile_flat(ca.Function("f", [x], [ca.sin(x) + ca.exp(-x)]), (True,))
values = np.random.default_rng(1).normal(size=(40, 9))
got = kernel.bind(())(values)
np.testing.assert_allclose(got, np.sin(values) + np.exp(-values), atol=1e-15)
"""


def test_two_processes_may_build_at_once(fresh_cache: Path) -> None:
    running = [
        subprocess.Popen(
            [sys.executable, "-c", BUILD],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment(),
            text=True,
        )
        for _ in range(2)
    ]
    for process in running:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    for process in running:
        _, complaint = process.communicate(timeout=60)
        assert process.returncode == 0, complaint
    (file,) = fresh_cache.iterdir()
    assert cache.load_code(file.name) is not None


def key(
    functions: list[ca.Function], settings: tuple[object, ...] = (True, False)
) -> str:
    return simd.key_of(functions, settings)


def test_same_function_has_the_same_key() -> None:
    assert key([function()]) == key([function()])


def test_key_tells_functions_and_settings_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keys = [
        key([function()]),
        key([function(3.0)]),
        key([function(np.nextafter(2.0, 3.0))]),
        key([function(), function()]),
        key([function()], (True, True)),
        key([function()], (8, 3)),
        key([function()], (9, 3)),
        key([function()], ((True, False), "double")),
        key([function()], ((True, False), "single")),
    ]
    here = machine()
    for other in (
        replace(here, features=f"{here.features},-avx"),
        replace(here, cpu="generic"),
        replace(here, triple="aarch64-unknown-linux-gnu"),
        replace(here, llvm="1.2.3"),
        replace(here, lanes=2),
        replace(here, register_bits=64),
        replace(here, has_scale=not here.has_scale),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(simd, "machine", lambda other=other: other)
            keys.append(key([function()]))
    with monkeypatch.context() as patch:
        patch.setattr(simd, "_sources", lambda _: "another emitter")
        keys.append(key([function()]))
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize(
    "module",
    [
        "swarmstart.tape",
        f"{simd.HERE}.vectors.vector_ir",
        f"{simd.HERE}.vectors.coefficients",
        f"{simd.HERE}.vectors.elementary",
        f"{simd.HERE}.vectors.exponentials",
        f"{simd.HERE}.vectors.operations",
        f"{simd.HERE}.frame",
        f"{simd.HERE}.emitter",
        f"{simd.HERE}.engine",
        f"{simd.HERE}.simd",
    ],
)
def test_key_changes_with_what_makes_the_code(
    monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    assert sources_after_a_change(module, monkeypatch) != simd._sources(simd.__name__)


@pytest.mark.parametrize("module", ["batch", "backend"])
def test_key_does_not_change_with_what_only_calls_the_code(
    monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    assert sources_after_a_change(
        f"{simd.HERE}.{module}", monkeypatch
    ) == simd._sources(simd.__name__)


def sources_after_a_change(module: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The hash of the makers after a line is added to a module."""
    as_it_is = fingerprints.source

    def changed(name: str) -> bytes:
        return as_it_is(name) + (b"\n# changed" if name == module else b"")

    assert as_it_is(module)
    with monkeypatch.context() as patch:
        patch.setattr(fingerprints, "source", changed)
        patch.setattr(simd, "source", changed)
        return simd._sources.__wrapped__(simd.__name__)


def test_rollouts_of_different_horizons_are_kept_apart(
    fresh_cache: Path, translated: list[str]
) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    p, s = ca.SX.sym("p", 0), ca.SX.sym("s", 0)
    stage = ca.Function("stage", [x, u, p, s], [x + u, u**2, 0])
    end = ca.Function("end", [x, p, s], [x, 0])
    population = np.ones((4, 8))
    for intervals, cost in ((3, 6.0), (4, 8.0), (3, 6.0)):
        kernel = compile_rollout(
            stage, end, intervals=intervals, signals_per_interval=0
        )
        bound = kernel.bind((np.zeros(1), np.empty(0), np.empty(0)))
        assert bound(population[:intervals])[0, 0] == cost
    assert len(translated) == 2
    assert len(list(fresh_cache.iterdir())) == 2
