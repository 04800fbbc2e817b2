"""Kernels: old machine code never runs, and only the user's own is loaded.

The package is copied and edited, and run in processes that share one cache.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

import swarmstart.machine_code.numba_kernels as kernel_module
import swarmstart.ocp
from swarmstart.arrays import Array
from swarmstart.tests.processes import environment, python

pytestmark = pytest.mark.skipif(os.name == "nt", reason="modes of files are POSIX's")

ROOT = Path(swarmstart.ocp.__path__[0]).parent

COUNTING = """
import numba
compiled = []
class Listener(numba.core.event.Listener):
    def on_start(self, event): pass
    def on_end(self, event): compiled.append(event.data["dispatcher"])
numba.core.event.register("numba:compile", Listener())
"""
BETTER = """
from swarmstart.heuristics.laws.order import precedes
print(precedes(0, 0.0, 0.0, 1.0, 0.0, 2.0, 0.0))
"""
CALLER = """
from swarmstart.heuristics.laws.order import best_index, static_penalty
import numpy as np
order = static_penalty(0.0).running()
print(best_index(order, np.array([2.0, 1.0, 3.0]), np.zeros(3)))
"""


def copied(folder: Path) -> Path:
    """A copy of the modules that kernels need; the folder to import it from."""
    package = folder / "swarmstart"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text('__version__ = "0.1.0"\n')
    for module in ("arguments.py", "arrays.py", "doors.py", "errors.py"):
        shutil.copy(ROOT / module, package / module)
    for room in ("machine_code", "heuristics"):
        skipped = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / room, package / room, ignore=skipped)
    return folder


def negate_costs(folder: Path) -> None:
    """Turn the order round, in a function that kernels of other modules call."""
    file = folder / "swarmstart" / "heuristics" / "laws" / "order.py"
    text = file.read_text(encoding="utf-8")
    line = "        return penalised_a < cost_b + weight * violation_b\n"
    assert line in text
    turned = line.replace("penalised_a < ", "penalised_a > ")
    file.write_text(text.replace(line, turned), encoding="utf-8")


def ran(code: str, folder: Path, cache: Path, **variables: str) -> str:
    """Return the output of code that imports the package of a folder."""
    variables["XDG_CACHE_HOME"] = str(cache)
    done = python("-c", code, root=folder, variables=variables)
    return done.stdout.strip()


def test_an_edited_checkout_runs_its_new_code(tmp_path: Path) -> None:
    folder, cache = copied(tmp_path / "checkout"), tmp_path / "cache"
    assert ran(CALLER, folder, cache) == "1"
    negate_costs(folder)
    assert ran(CALLER, folder, cache) == "2"


def wheel_of(folder: Path, version: str) -> Path:
    """Pack the package of a folder as a wheel; return its path."""
    info = f"swarmstart-{version}.dist-info"
    path = folder / f"swarmstart-{version}-py3-none-any.whl"
    files = sorted((folder / "swarmstart").rglob("*.py"))
    names = [file.relative_to(folder).as_posix() for file in files]
    about = f"Name: swarmstart\nVersion: {version}\n"
    texts = {
        "METADATA": f"Metadata-Version: 2.1\n{about}",
        "WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "RECORD": "".join(f"{name},,\n" for name in names),
    }
    with zipfile.ZipFile(path, "w") as wheel:
        for file, name in zip(files, names, strict=True):
            wheel.write(file, name)
        for name, text in texts.items():
            wheel.writestr(f"{info}/{name}", text)
    return path


def test_a_wheel_that_is_installed_over_another_runs_its_own_code(
    tmp_path: Path,
) -> None:
    """One of a new version, and one of the same; and the first again."""
    old, new = copied(tmp_path / "old"), copied(tmp_path / "new")
    negate_costs(new)
    wheels = [
        (wheel_of(old, "0.1.0"), "1"),
        (wheel_of(new, "0.2.0"), "2"),
        (wheel_of(old, "0.2.0"), "1"),
        (wheel_of(new, "0.2.0"), "2"),
    ]
    installed, cache = tmp_path / "installed", tmp_path / "cache"
    installed.mkdir()
    quietly = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-index"]
    over = ["--upgrade", "--force-reinstall", "--target", str(installed)]
    for wheel, expected in wheels:
        python("-m", "pip", "install", *quietly, *over, str(wheel))
        assert ran(CALLER, installed, cache) == expected


def test_two_versions_share_one_cache(tmp_path: Path) -> None:
    old, new = copied(tmp_path / "old"), copied(tmp_path / "new")
    negate_costs(new)
    cache = tmp_path / "cache"
    for _ in range(2):
        assert ran(CALLER, old, cache) == "1"
        assert ran(CALLER, new, cache) == "2"


def test_code_is_compiled_once_for_equal_copies(tmp_path: Path) -> None:
    one, other = copied(tmp_path / "one"), copied(tmp_path / "other")
    cache, code = tmp_path / "cache", COUNTING + CALLER + "print(len(compiled))\n"
    assert int(ran(code, one, cache).split()[-1]) > 0
    before = sorted(os.listdir(cache / "swarmstart" / "machine-code"))
    assert ran(code, other, cache).split()[-1] == "0"
    assert sorted(os.listdir(cache / "swarmstart" / "machine-code")) == before


def test_nothing_is_written_beside_the_source(tmp_path: Path) -> None:
    folder = copied(tmp_path / "installed")
    ran(CALLER, folder, tmp_path / "cache", PYTHONDONTWRITEBYTECODE="1")
    assert not list(folder.rglob("*.nb?"))
    assert not list(folder.rglob("__pycache__"))


def test_kernels_work_where_nothing_can_be_kept(tmp_path: Path) -> None:
    folder, in_the_way = copied(tmp_path / "installed"), tmp_path / "file"
    in_the_way.write_text("in the way")
    loud = "import logging, sys\nlogging.basicConfig(level=20, stream=sys.stdout)\n"
    *_, said, answer = ran(loud + CALLER, folder, in_the_way).split("\n")
    assert answer == "1"
    assert "as in each process, since no cache can be used" in said


@pytest.mark.parametrize("part", [0, 1, 2])
def test_damaged_code_is_compiled_anew(tmp_path: Path, part: int) -> None:
    folder, cache = copied(tmp_path / "checkout"), tmp_path / "cache"
    assert ran(BETTER, folder, cache) == "True"
    for file in (cache / "swarmstart" / "machine-code").iterdir():
        content = bytearray(file.read_bytes())
        if part == 0:
            content = content[: len(content) // 2]
        elif part == 1:
            content[len(content) // 2] ^= 1
        else:
            file.chmod(0o666)  # Another user could have written it.
        mode = file.stat().st_mode & 0o777
        file.write_bytes(bytes(content))
        assert file.stat().st_mode & 0o777 == mode
    code = COUNTING + BETTER + "print(len(compiled))\n"
    assert ran(code, folder, cache).split()[0] == "True"
    assert int(ran(code, folder, cache).split()[1]) == 0  # Kept again, and mended.


def test_two_processes_may_compile_at_once(tmp_path: Path) -> None:
    folder, cache = copied(tmp_path / "checkout"), tmp_path / "cache"
    running = [
        subprocess.Popen(
            [sys.executable, "-c", BETTER],
            env=environment(folder, {"XDG_CACHE_HOME": str(cache)}),
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    assert [process.communicate()[0].strip() for process in running] == ["True"] * 2
    assert ran(BETTER, folder, cache) == "True"


RECORD = """
from typing import NamedTuple
from swarmstart.machine_code.numba_kernels import kernel
Point = NamedTuple("Point", [(name, int) for name in "{fields}"])
@kernel
def first(point):
    return point.x / 2
print(first(Point(**dict(x=1, y=3))))
"""


def test_types_of_one_name_are_told_apart(tmp_path: Path) -> None:
    folder, cache = copied(tmp_path / "checkout"), tmp_path / "cache"
    for fields in ("xy", "yx"):
        code = RECORD.format(fields=fields)
        assert ran(code, folder, cache) == "0.5"


class Record(NamedTuple):
    """A record of arrays and numbers, as kernels take them."""

    array: object
    number: object


def test_arguments_of_one_key_are_of_one_type() -> None:
    plain = np.zeros((3, 4))
    locked = plain.copy()
    locked.setflags(write=False)
    unaligned = np.frombuffer(bytes(81), dtype=np.uint8)[1:].view(np.float64)
    arrays = plain, plain.T, plain[:, 1], plain[0], locked, plain.astype(int), unaligned
    numbers = 1, 1.0, True, np.int64(1), np.random.default_rng(0)
    values = [*arrays, *numbers, *(Record(a, n) for a in arrays for n in numbers)]
    values += [(value, Record(value, 1)) for value in values]
    types: dict[object, object] = {}
    for value in values * 2:
        kind = numba.typeof(value)
        assert types.setdefault(kernel_module._key_of(value), kind) == kind
    assert len(types) > len(arrays) * len(numbers)


@kernel_module.kernel
def put(into: Array, value: float) -> None:
    into[0] = value


@kernel_module.kernel
def put_at(address: int, given: tuple[object, ...]) -> None:
    kernel_module.call_at(address, given)


def test_an_address_is_of_the_kernel_for_these_types() -> None:
    reals, whole = np.zeros(1), np.zeros(1, dtype=np.int64)
    for into, value in ((reals, 2.5), (whole, 3), (reals, 4.5)):
        put_at(kernel_module.address_of(put, into, value), (into, value))
        assert into[0] == value
        assert kernel_module.is_kept(put, into, value, for_kernel=True)
    assert kernel_module.address_of(put, reals, 2.5) != kernel_module.address_of(
        put, whole, 3
    )
