"""Files that are no FMU for this machine are refused before anything of them runs."""

from pathlib import Path

import pytest

import swarmstart as ss
from swarmstart.simulators import archive
from swarmstart.tests.simulators import pendulum

fmpy = pytest.importorskip("fmpy")
TEXT = pendulum.description("2.0").encode()


def refusal(file: Path) -> str:
    with pytest.raises(ss.SimulatorError) as caught:
        ss.FmuPlant(file, states=["angle"], controls=["torque"])
    return str(caught.value)


def test_no_archive(tmp_path: Path) -> None:
    """No file, a text, a folder."""
    assert "found no file" in refusal(tmp_path / "none.fmu")
    (tmp_path / "text.fmu").write_text("a text")
    assert "ZIP archive" in refusal(tmp_path / "text.fmu")
    assert "ZIP archive" in refusal(tmp_path)


@pytest.mark.parametrize(
    "name", ["../away.txt", "/etc/away", "a/../../away", "C:/away", "..\\away"]
)
def test_names_that_leave_the_archive(tmp_path: Path, name: str) -> None:
    """None is unpacked."""
    file = pendulum.archived(
        tmp_path / "one.fmu", {"modelDescription.xml": TEXT, name: b"x"}
    )
    assert "expected names within the archive" in refusal(file)
    assert not (tmp_path / "away.txt").exists()


def test_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its files together have a limit, which is looked up, not unpacked."""
    monkeypatch.setattr(archive, "MOST_BYTES", 100)
    file = pendulum.archived(tmp_path / "one.fmu", {"modelDescription.xml": TEXT})
    assert "expected at most 100 bytes" in refusal(file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"<fmiModelDescription", "expected a valid modelDescription.xml"),
        (TEXT.replace(b"CoSimulation", b"ModelExchange").replace(
            b' canHandleVariableCommunicationStepSize="true"', b""),
         "found one for model exchange only"),
        (TEXT.replace(b'fmiVersion="2.0"', b'fmiVersion="1.0"'), "expected"),
        (TEXT.replace(b'modelIdentifier="pendulum"', b'modelIdentifier="../p"'),
         "expected a C identifier"),
    ],
    ids=["broken", "model exchange", "old", "path"],
)  # fmt: skip
def test_a_description_that_does_not_fit(
    tmp_path: Path, text: bytes, message: str
) -> None:
    """Broken XML, model exchange, FMI 1, a path in place of a name."""
    file = pendulum.archived(tmp_path / "one.fmu", {"modelDescription.xml": text})
    assert message in refusal(file)


@pytest.mark.parametrize(
    ("inside", "found"),
    [
        ("binaries/win64/pendulum.dll", "found win64"),
        ("sources/pendulum.c", "found sources only"),
        ("resources/nothing", "found none"),
    ],
)
def test_no_library_for_this_machine(tmp_path: Path, inside: str, found: str) -> None:
    """The message names what there is."""
    file = pendulum.archived(
        tmp_path / "one.fmu", {"modelDescription.xml": TEXT, inside: b"x"}
    )
    assert found in refusal(file)


def test_a_library_that_is_none(tmp_path: Path) -> None:
    """The message has the words of the system."""
    inside = f"binaries/{fmpy.platform}/pendulum{fmpy.sharedLibraryExtension}"
    file = pendulum.archived(
        tmp_path / "one.fmu", {"modelDescription.xml": TEXT, inside: b"no library"}
    )
    assert "failed to load" in refusal(file)
