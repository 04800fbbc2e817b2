"""The description of the machine has no data about its owner."""

from __future__ import annotations

import getpass
import json
import os
import platform
import socket
from pathlib import Path

import pytest

from swarmstart.cases.campaign.engine import cell_work as told
from swarmstart.cases.campaign.engine.cell_work import load, machine


def test_the_machine_says_nothing_personal() -> None:
    found = machine()
    assert set(found) == {"processor", "cores", "system", "python"}
    assert found["cores"] == os.cpu_count()
    assert found["python"] == platform.python_version()
    text = json.dumps(found)
    assert found["processor"] and "/" not in found["system"]
    for personal in (socket.gethostname(), getpass.getuser(), str(Path.home())):
        assert personal not in text.split('"') and f"{personal}/" not in text


@pytest.mark.parametrize("content", ["", "model name\n", "flags : a b", "\x00\n:"])
def test_a_processor_without_a_name_is_told_by_its_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str
) -> None:
    file = tmp_path / "cpuinfo"
    file.write_text(content)
    for place in (file, tmp_path / "missing"):
        monkeypatch.setattr(told, "CPU_INFO", place)
        assert told._processor() in (platform.processor(), platform.machine())


def test_a_system_without_loads_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert load() is None or load() >= 0.0  # type: ignore[operator]
    monkeypatch.delattr(os, "getloadavg", raising=False)
    assert load() is None
