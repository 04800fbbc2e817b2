"""The library's face: what the root names, and that naming it imports nothing."""

import ast
import importlib
import inspect
from pathlib import Path

import pytest

import swarmstart
from swarmstart.errors import SwarmstartError

LAYERS = ("swarmstart.ocp", "swarmstart.heuristics", "swarmstart.terminal_set")


LAZY = ("swarmstart", "swarmstart.machine_code", *LAYERS)


@pytest.mark.parametrize("door", LAZY)
def test_what_type_checkers_read_is_what_is_imported(door: str) -> None:
    """The names are written twice, for type checkers and for the lazy import."""
    module = importlib.import_module(door)
    tree = ast.parse(Path(inspect.getfile(module)).read_text(encoding="utf-8"))
    (checked,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in checked.body if isinstance(node, ast.ImportFrom)]
    read = {(a.asname, n.module) for n in imports for a in n.names}
    inside = "" if module is swarmstart else f"{door}."
    assert read == {(name, inside + home) for name, home in module._HOMES.items()}
    assert all(hasattr(module, name) for name in module.__all__)


@pytest.mark.parametrize("name", swarmstart.__all__)
def test_a_public_name_can_be_imported(name: str) -> None:
    found = getattr(swarmstart, name)
    assert getattr(found, "__name__", name) == name


def test_dir_shows_public_names_and_nothing_else() -> None:
    shown = [name for name in dir(swarmstart) if not name.startswith("__")]
    assert shown == sorted(swarmstart.__all__)


@pytest.mark.parametrize("layer", LAYERS)
def test_every_error_of_a_layer_can_be_caught_by_its_public_name(layer: str) -> None:
    home = importlib.import_module(layer)
    raised = {
        name
        for name in home.__all__
        if isinstance(found := getattr(home, name), type)
        and issubclass(found, SwarmstartError | KeyboardInterrupt)
    }
    assert raised and raised <= {*swarmstart.__all__}


def test_a_name_that_there_is_not_is_refused() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'importlib_'"):
        _ = swarmstart.importlib_
