"""Makes small recordings for the tests of the replay."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_core import proto as pb

from tests.unit.recorder.recorder_bus import Recorded


def record(folder: Path, frames: int = 4, **chosen: float | str) -> tuple[Path, list[pb.Frame]]:
    """Records some frames; returns (the file, its keyframes)."""
    recorded = Recorded(folder, **chosen)
    sent = recorded.tour(frames)
    recorded.close()
    (path,) = folder.glob("*.mcap")
    return path, sent


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[pb.Frame]]:
    return record(tmp_path_factory.mktemp("recording"), chunk_mb=0.02)
