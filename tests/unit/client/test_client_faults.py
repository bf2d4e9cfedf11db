"""`helios faults --save` writes only where the user says, and prints JSON if asked to."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_client.answer_types import FaultList, FaultRecording
from helios_client.sdk import Helios as Sdk

from tests.client_command import Helios

NAME = "20260102T030405Z-map2d-restarted.mcap"
CONTENT = b"an mcap file"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Present folder, of a user whose gateway has one recording."""
    out = tmp_path / "here"
    out.mkdir()
    monkeypatch.chdir(out)
    monkeypatch.setattr(Sdk, "fault_recording", lambda _, name: CONTENT)
    name_the_recording(monkeypatch, NAME)
    return out


def name_the_recording(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    found = FaultList(recordings=[FaultRecording(name, bytes=len(CONTENT))])
    monkeypatch.setattr(Sdk, "faults", lambda _: found)


def test_the_last_recording_is_saved_under_its_name_or_in_the_given_file(
    helios: Helios, folder: Path
) -> None:
    assert helios("faults", "--save", "last") == f"{NAME}\n"
    assert (folder / NAME).read_bytes() == CONTENT
    assert helios("faults", "--save", NAME, "--out", "mine.mcap") == "mine.mcap\n"
    assert (folder / "mine.mcap").read_bytes() == CONTENT


@pytest.mark.parametrize(
    "name", ["../out.mcap", "/nowhere/out.mcap", ".bashrc", "..", "", "a\n.mcap"]
)
@pytest.mark.parametrize("out", [(), ("--out", ".")])
def test_a_recording_that_the_gateway_names_like_a_path_is_refused_and_not_written(
    helios: Helios,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    out: tuple[str, ...],
) -> None:
    name_the_recording(monkeypatch, name)
    helios("faults", "--save", "last", *out, status=2)
    assert f"no recording has the name {name!r}; wanted one such as" in helios.error
    assert list(folder.iterdir()) == []
    assert not (folder.parent / "out.mcap").exists()


def test_a_saved_recording_is_told_as_json_if_asked_to(helios: Helios, folder: Path) -> None:
    assert helios.json("faults", "--save", "last") == {"file": NAME, "bytes": len(CONTENT)}
    assert (folder / NAME).read_bytes() == CONTENT
