"""`swarmstart new` and `swarmstart schema`: help for writing a scenario.

The first writes a commented scenario to start from, the second prints the JSON Schema
with which an editor completes and checks a scenario.
"""

import argparse
import importlib.resources
import json
import re
import shlex
from collections.abc import Mapping
from pathlib import Path

from swarmstart.cases.commands.terminal import DONE, answer
from swarmstart.cases.format.document import printable, shown
from swarmstart.cases.format.registry import BEST_KNOWN, KINDS, words_of
from swarmstart.cases.format.scenario import LONGEST_NAME, shipped
from swarmstart.cases.record.files import RecordError, require_new, write_text
from swarmstart.errors import SwarmstartError

ENDINGS = (".yaml", ".yml")
_NAME = re.compile(rf"[A-Za-z0-9_][A-Za-z0-9_-]{{0,{LONGEST_NAME - 1}}}")


class NoTemplateError(SwarmstartError, ValueError):
    """A kind has no scenario to start from."""


class InvalidNameError(SwarmstartError, ValueError):
    """A name is invalid for a new scenario."""


def new_command(options: argparse.Namespace) -> int:
    """Write the files, and print them with the next two commands; return the exit code.

    Raises:
        InvalidNameError: If the name has other characters than letters, digits, "_" and
            "-", or is that of a shipped scenario.
        NoTemplateError: If the kind has no template.
        RecordError: If a file exists, and --force is not given, or cannot be written.
    """
    texts = new_files(options.name, kind=options.kind)
    if not options.force:
        require_new(texts, "choose another name, or replace it with --force")
    for file, text in texts.items():
        _write(file, text)
    file = next(iter(texts))
    written = " and ".join(printable(str(name)) for name in texts)
    typed = shlex.quote(str(file))
    run = f"{typed} --allow-code" if words_of(options.kind).runs_code else typed
    answer(
        f"Wrote {written}. Next:\n  swarmstart check {typed}\n  swarmstart run {run}"
    )
    return DONE


def schema_command(options: argparse.Namespace) -> int:
    """Print the JSON Schema of a kind, or of a file; return the exit code."""
    # Here, since a new scenario is written without pydantic.
    from swarmstart.cases.format.parts import scenario_schema
    from swarmstart.cases.hard.best_known import best_known_schema

    of_file = options.kind == BEST_KNOWN
    schema = best_known_schema() if of_file else scenario_schema(options.kind)
    answer(json.dumps(schema, indent=2))
    return DONE


def new_files(name: str, *, kind: str) -> Mapping[Path, str]:
    """Return the files of a new scenario, the scenario itself first: file -> text.

    Args:
        name: The name of the scenario, or the path of its file.
        kind: A kind of scenario.

    Raises:
        InvalidNameError: As in `new_command`.
        NoTemplateError: As in `new_command`.
    """
    words = words_of(kind)
    if not words.templates:
        known = ", ".join(name for name in KINDS if words_of(name).templates)
        start = words.example or "SCENARIO"
        raise NoTemplateError(
            f"expected --kind {known}; found {kind}, without a template; "
            f"start from: swarmstart run {start} --print-config > NAME.yaml"
        )
    file = Path(name)
    if file.suffix not in ENDINGS:
        # Not with_suffix, which would cut the end off a name such as a.b; with_name
        # raises for a path without a name, which is refused below.
        file = file.with_name(f"{file.name}.yaml") if file.name else file
    stem = file.stem
    # A path forgets the slash at its end.
    if not _NAME.fullmatch(stem) or name.endswith(("/", "\\")):
        raise InvalidNameError(
            "expected NAME of letters, digits, _ and -, at most "
            f"{LONGEST_NAME} characters, perhaps after a folder; found {shown(name)}"
        )
    # `swarmstart run NAME` takes the shipped scenario first.
    if stem in shipped():
        raise InvalidNameError(
            f"expected a NAME that no shipped scenario has, found {shown(stem)}; "
            "swarmstart list scenarios shows them"
        )
    # The folder of the module that states the words of the kind.
    folder = KINDS[kind].partition(":")[0].rpartition(".")[0]
    templates = importlib.resources.files(folder) / "templates"
    return {
        file.with_suffix(ending) if ending else file: (templates / template)
        .read_text(encoding="utf-8")
        .replace("NAME", stem)
        for template, ending in words.templates.items()
    }


def _write(file: Path, text: str) -> None:
    """Write a file into a folder that exists.

    Raises:
        RecordError: If that is not possible.
    """
    if not file.parent.is_dir():
        raise RecordError(
            f"{file.parent}: expected a folder to write to; there is no such folder"
        )
    write_text(file, text)
