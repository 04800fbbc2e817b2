"""Code on the pages: Python runs, commands parse, scenarios are valid."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.checking import check
from swarmstart.cases.commands.front.cli import parser
from swarmstart.tests.docs.blocks import Block, blocks_of
from swarmstart.tests.docs.comparing import differences
from swarmstart.tests.docs.conftest import DOCS, ROOT
from swarmstart.tests.docs.printed import PRINTED

PAGES = {
    path.relative_to(DOCS if path.is_relative_to(DOCS) else ROOT).as_posix(): path
    for path in [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
    if path.is_file()
}
READ = {name: blocks_of(path) for name, path in PAGES.items()}
MEASURED = "measured/"
MOST_EXCLUDED = 6
COMMAND = re.compile(
    r"^(?:\$ )?(?:[A-Z_]+=\S+ )*(?:\S*bin/)?(?:python -m )?swarmstart (?=[a-z-])"
)
INLINE = re.compile(r"`swarmstart ([a-z]+)( [^`]*)?`")


def having(language: str) -> list[str]:
    """Return the pages that have a block of a language to run."""
    return [
        name
        for name, blocks in READ.items()
        if not name.startswith(MEASURED)
        and any(b.language == language and not b.excluded for b in blocks)
    ]


def save_files(blocks: list[Block], folder: Path) -> None:
    """Write the blocks that a page asks to save."""
    for block in blocks:
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")


@pytest.mark.parametrize("name", having("python"))
def test_the_python_of_a_page_runs_and_prints_what_is_shown(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    save_files(READ[name], tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    printed, everything, wrong = "", "", []
    for block in READ[name]:
        if block.language == "python" and not block.excluded:
            # Blank lines before make the line numbers those of the page.
            text = "\n" * block.line + block.text
            # Not with this file's `from __future__`, which a reader does not have.
            code = compile(text, str(PAGES[name]), "exec", dont_inherit=True)
            exec(code, names)
            printed = capsys.readouterr().out
            everything += printed
        elif block.is_output and not block.excluded:
            found = differences(block.text, printed)
            wrong += [f"{name}:{block.line}: {one}" for one in found]
    if name in PRINTED:
        wrong += differences(PRINTED[name], everything)
    assert not wrong, "\n".join(wrong)


def commands(name: str) -> Iterator[tuple[int, str]]:
    """Yield the commands on a page with their line."""
    for block in READ[name]:
        if block.language not in ("", "sh", "console", "bash", "shell"):
            continue
        text = block.text.replace("\\\n", " ")
        has_prompt = "\n$ " in f"\n{text}"
        for line in text.splitlines():
            found = COMMAND.match(line)
            if found and (not has_prompt or line.startswith("$ ")):
                yield block.line, line[found.end() :]


def words(command: str) -> list[str]:
    """Return the words of a command up to a pipe or a redirection."""
    lexer = shlex.shlex(command, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    found = []
    for word in lexer:
        if not word.strip("();<>|&"):
            break
        found.append(word)
    return found


@pytest.mark.parametrize("name", READ)
def test_the_commands_of_a_page_are_known(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = []
    for line, command in commands(name):
        try:
            _, unknown = parser().parse_known_args(words(command))
        except SystemExit as leaving:
            unknown = [str(capsys.readouterr().err)] if leaving.code else []
        if unknown:
            wrong.append(f"{name}:{line}: {command}: {unknown}")
    assert not wrong, "\n".join(wrong)


def test_options_within_a_sentence_are_known() -> None:
    (action,) = (a for a in parser()._actions if a.metavar == "COMMAND")
    known = dict(action.choices or {})
    wrong = []
    for name, path in PAGES.items():
        for command, rest in INLINE.findall(path.read_text(encoding="utf-8")):
            if command not in known:
                wrong.append(f"{name}: swarmstart {command}")
                continue
            options = re.findall(r"(?<!\S)--?[a-z][a-z-]*", rest)
            there = known[command]._option_string_actions
            wrong += [f"{name}: {command} {one}" for one in options if one not in there]
    assert not wrong


@pytest.mark.parametrize("name", having("yaml"))
def test_the_scenarios_of_a_page_are_valid(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = [b for b in READ[name] if not b.excluded]
    save_files(blocks, tmp_path)
    for block in blocks:
        if block.language == "yaml" and re.search("^kind:", block.text, re.MULTILINE):
            file = tmp_path / (block.file or f"line_{block.line}.yaml")
            file.write_text(block.text, encoding="utf-8")
            assert "valid" in check(str(file)), f"{name}:{block.line}"


def test_the_page_of_the_command_line_lists_the_exit_codes() -> None:
    page = (DOCS / "reference" / "command_line.md").read_text(encoding="utf-8")
    told = (parser().epilog or "").partition("exit codes")[2]
    codes = re.findall(r"\b(\d+)\s+[a-z]", told)
    assert codes == re.findall(r"^\| (\d+) \|", page, re.MULTILINE) != []


def test_few_blocks_are_excluded(pytestconfig: pytest.Config) -> None:
    excluded = [
        f"{name}:{block.line}: {block.excluded}"
        for name, blocks in READ.items()
        for block in blocks
        if block.excluded
    ]
    reporter = pytestconfig.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None:  # Workers have none.
        reporter.write_line(f"\n{len(excluded)} blocks of the pages are not run")
    assert len(excluded) <= MOST_EXCLUDED, excluded
