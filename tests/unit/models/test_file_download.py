"""Downloads that were interrupted continue only in the same version of the file."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from helios_client.models.file_download import PART, VERSION, download
from helios_core.errors import Unavailable

from tests.unit.models.local_hub import ONNX_PATH, LocalHub, sha256

OLD, NEW = random.Random(1).randbytes(9000), random.Random(2).randbytes(9000)
CUT = 5000
DATE = {"Last-Modified": "Wed, 21 Oct 2015 07:28:00 GMT"}
LATER = {"Last-Modified": "Thu, 22 Oct 2015 07:28:00 GMT"}


@pytest.fixture
def hub() -> Iterator[LocalHub]:
    with closing(LocalHub(onnx=OLD)) as hub:
        yield hub


@pytest.fixture
def to(tmp_path: Path) -> Path:
    return tmp_path / "models" / "yolox_nano.onnx"


def fetch(hub: LocalHub, to: Path) -> None:
    download(hub.url + ONNX_PATH, to, lambda *_: None)


def interrupt(hub: LocalHub, to: Path) -> None:
    hub.cut_after = CUT
    with pytest.raises(Unavailable, match="run the command again"):
        fetch(hub, to)
    assert to.with_name(to.name + PART).read_bytes() == hub.onnx[:CUT]


def is_clean(to: Path) -> bool:
    """True if only the file itself is there."""
    return list(to.parent.iterdir()) == [to]


@pytest.mark.parametrize("version", [None, DATE])
def test_a_download_continues_in_the_same_version(
    version: dict[str, str] | None, hub: LocalHub, to: Path
) -> None:
    hub.onnx_version = version
    interrupt(hub, to)
    fetch(hub, to)
    assert hub.ranges == [f"bytes={CUT}-"]
    assert hub.if_ranges == [version["Last-Modified"] if version else f'"{sha256(OLD)}"']
    assert to.read_bytes() == OLD
    assert is_clean(to)


@pytest.mark.parametrize("ignores_if_range", [False, True])
@pytest.mark.parametrize(("before", "after"), [(None, None), (DATE, LATER), (DATE, {"ETag": "1"})])
@pytest.mark.parametrize("changed", [NEW, NEW[: CUT - 1], NEW[:CUT]])
def test_a_new_version_is_never_joined_to_the_old_one(
    changed: bytes,
    before: dict[str, str] | None,
    after: dict[str, str] | None,
    ignores_if_range: bool,
    hub: LocalHub,
    to: Path,
) -> None:
    hub.onnx_version = before
    interrupt(hub, to)
    hub.onnx, hub.onnx_version, hub.ignores_if_range = changed, after, ignores_if_range
    fetch(hub, to)
    assert to.read_bytes() == changed
    assert is_clean(to)


@pytest.mark.parametrize("version", [{}, {"ETag": 'W/"1"'}, {"ETag": 'W/"1"'} | DATE])
def test_a_download_without_a_certain_version_starts_anew(
    version: dict[str, str], hub: LocalHub, to: Path
) -> None:
    hub.onnx_version = version
    interrupt(hub, to)
    hub.onnx = NEW
    fetch(hub, to)
    assert hub.ranges == []
    assert to.read_bytes() == NEW


@pytest.mark.parametrize("stored", [None, b"", b"\xff", b"a\nb", "é".encode()])
def test_a_partial_file_without_a_usable_version_is_not_continued(
    stored: bytes | None, hub: LocalHub, to: Path
) -> None:
    """Such as one that an earlier release of HELIOS left."""
    to.parent.mkdir()
    to.with_name(to.name + PART).write_bytes(NEW[:CUT])
    if stored is not None:
        to.with_name(to.name + VERSION).write_bytes(stored)
    fetch(hub, to)
    assert hub.ranges == []
    assert to.read_bytes() == OLD
    assert is_clean(to)


def test_a_complete_partial_file_is_kept_without_another_download(hub: LocalHub, to: Path) -> None:
    """As when the command was killed before it renamed the file."""
    interrupt(hub, to)
    to.with_name(to.name + PART).write_bytes(OLD)
    fetch(hub, to)
    assert hub.ranges == [f"bytes={len(OLD)}-"]
    assert len(hub.gets) == 2
    assert to.read_bytes() == OLD
    assert is_clean(to)


def test_a_partial_file_longer_than_the_file_is_fetched_anew(hub: LocalHub, to: Path) -> None:
    interrupt(hub, to)
    to.with_name(to.name + PART).write_bytes(OLD + b"more")
    fetch(hub, to)
    assert to.read_bytes() == OLD


def test_the_error_says_whether_the_next_attempt_continues(hub: LocalHub, to: Path) -> None:
    hub.cut_after = CUT
    with pytest.raises(Unavailable, match=f"it continues after {CUT} bytes"):
        fetch(hub, to)
    hub.onnx_version, hub.cut_after, hub.onnx = {}, CUT, NEW
    with pytest.raises(Unavailable, match="it starts anew"):
        fetch(hub, to)
