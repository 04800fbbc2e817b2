"""The fingerprint changes with all that a function's machine code is made from."""

import collections
import importlib.metadata
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from swarmstart.machine_code.fingerprints import UnknownValueError, fingerprint, sources
from swarmstart.machine_code.numba_kernels import ieee_kernel, kernel
from swarmstart.tests.processes import python

CALLEE = """
def inner(x):
    return {inner}
"""
CALLER = """
import math
import numpy as np
from callee import inner

FACTOR = {factor}
TABLE = np.array({table})
PAIR = {pair}

def outer(x, y={default}):
    \"\"\"{doc}\"\"\"
    # {comment}
    z = {inner_most}
    return FACTOR * inner(x) + TABLE[0] + PAIR[1] + math.{function}(x) + y + z
"""
PLAIN = {
    "inner": "x + 1",
    "factor": "2.0",
    "table": "[1.0, 2.0]",
    "pair": "(1, 2)",
    "default": "0",
    "doc": "Something.",
    "comment": "why",
    "inner_most": "1",
    "function": "sin",
}


def made(folder: Path, **changes: str) -> Callable[..., object]:
    """The function `outer` of two modules written to a folder, with changes."""
    folder.mkdir(exist_ok=True)
    texts = {**PLAIN, **changes}
    modules = {}
    for name, text in (("callee", CALLEE), ("caller", CALLER)):
        path = folder / f"{name}.py"
        path.write_text(text.format(**texts))
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None and spec.loader is not None
        modules[name] = importlib.util.module_from_spec(spec)
        sys.modules[name] = modules[name]
        spec.loader.exec_module(modules[name])
        path.unlink()  # Only what was loaded counts.
    for name in modules:
        del sys.modules[name]
    function: Callable[..., object] = modules["caller"].outer
    return function


@pytest.mark.parametrize(
    "change",
    [
        {"inner": "x - 1"},
        {"inner": "x + 2"},
        {"factor": "-2.0"},
        {"factor": "2"},
        {"factor": "2.0000000000000004"},
        {"table": "[1.0, 3.0]"},
        {"table": "[1, 2]"},
        {"table": "[[1.0, 2.0]]"},
        {"pair": "(1, 3)"},
        {"default": "1"},
        {"inner_most": "(lambda: 2)()"},
        {"function": "cos"},
    ],
)
def test_it_changes_with_whatever_the_function_calls_or_reads(
    tmp_path: Path, change: dict[str, str]
) -> None:
    assert fingerprint(made(tmp_path, **change)) != fingerprint(made(tmp_path))


@pytest.mark.parametrize("change", [{"doc": "Else."}, {"comment": "else"}])
def test_it_stays_with_docstrings_comments_and_the_folder(
    tmp_path: Path, change: dict[str, str]
) -> None:
    there = made(tmp_path / "there", **change)
    assert fingerprint(there) == fingerprint(made(tmp_path / "here"))


def test_it_changes_with_a_function_in_a_function(tmp_path: Path) -> None:
    one = made(tmp_path, inner_most="(lambda: inner(1))()")
    other = made(tmp_path, inner_most="(lambda: inner(2))()")
    assert fingerprint(one) != fingerprint(other)


def test_a_global_read_only_in_an_inner_function_counts(tmp_path: Path) -> None:
    inner_most = {"inner_most": "(lambda: SECRET)()"}
    one, other = made(tmp_path, **inner_most), made(tmp_path, **inner_most)
    one.__globals__["SECRET"] = 1
    other.__globals__["SECRET"] = 2
    assert fingerprint(one) != fingerprint(other)


def counted_down(n: int) -> int:
    return n if n == 0 else counted_up(n - 1)


def counted_up(n: int) -> int:
    return n if n == 0 else counted_down(n - 1)


def test_functions_that_call_each_other_have_one() -> None:
    assert fingerprint(counted_down) == fingerprint(counted_down)
    assert fingerprint(counted_down) != fingerprint(counted_up)


def closure(value: object) -> Callable[[], object]:
    return lambda: value


def test_a_closure_s_values_count() -> None:
    assert fingerprint(closure(1)) == fingerprint(closure(1))
    assert fingerprint(closure(1)) != fingerprint(closure(2))
    assert fingerprint(closure(1)) != fingerprint(closure(1.0))


class Point(NamedTuple):
    x: float
    y: float


def test_the_fields_of_a_record_count() -> None:
    turned = collections.namedtuple("turned", ["y", "x"])
    turned.__qualname__, turned.__module__ = Point.__qualname__, Point.__module__
    assert fingerprint(closure(Point)) != fingerprint(closure(turned))


def test_a_kernel_has_that_of_its_function_and_options() -> None:
    plain, ieee = kernel(counted_up), ieee_kernel(counted_up)
    assert fingerprint(plain) == fingerprint(kernel(counted_up))
    assert fingerprint(plain) != fingerprint(ieee)


@pytest.mark.parametrize("value", [object(), np.array([object()]), {"a": 1}, [1]])
def test_a_value_whose_content_is_not_known_is_refused(value: Any) -> None:
    with pytest.raises(UnknownValueError):
        fingerprint(closure(value))


def test_another_process_finds_the_same() -> None:
    names = ("lshade", "accept"), ("cma", "propose")
    code = "import importlib\n"
    code += "from swarmstart.machine_code.fingerprints import fingerprint\n"
    searches = "swarmstart.heuristics.searches"
    for module, name in names:
        code += f"module = importlib.import_module('{searches}.{module}')\n"
        code += f"print(fingerprint(module.{name}))\n"
    printed = [
        python("-c", code, variables={"PYTHONHASHSEED": seed}).stdout
        for seed in ("1", "2")
    ]
    assert printed[0] == printed[1]
    assert len(set(printed[0].split())) == len(names)


def test_sources_are_those_of_all_modules_imported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    texts = {
        "swarmstart.a": b"import numpy\nfrom swarmstart import (\n    b,\n)\n",
        "swarmstart.b": b"def f():\n    import swarmstart.errors\n",
        "swarmstart.errors": b"",
        "swarmstart": b"",
        "swarmstart.other": b"",
    }
    monkeypatch.setattr(
        "swarmstart.machine_code.fingerprints.source", lambda name: texts[name]
    )
    monkeypatch.setattr(
        "swarmstart.machine_code.fingerprints._is_module", texts.__contains__
    )
    before = sources("swarmstart.a")
    assert sources("swarmstart.a") == before
    for name, text in texts.items():
        changed = {**texts, name: text + b"# changed"}
        monkeypatch.setattr(
            "swarmstart.machine_code.fingerprints.source",
            lambda name, now=changed: now[name],
        )
        assert (sources("swarmstart.a") != before) == (name != "swarmstart.other")


def test_the_version_of_an_installed_package_does_not_stand_for_its_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is also that of a checkout that is edited, and calls code of this package."""
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "1.0")
    first, second = made(tmp_path, inner="x - 1"), made(tmp_path, inner="x + 1")
    assert fingerprint(first) != fingerprint(second)
