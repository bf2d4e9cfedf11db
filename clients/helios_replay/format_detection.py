"""Detection of the format at a path, and opening of the matching replay source."""

from __future__ import annotations

import logging
import re
from pathlib import Path

from helios_core.errors import Unavailable

from helios_replay.replay_source import PlaybackRange, Source

log = logging.getLogger(__name__)


def open_source(path: Path, part: PlaybackRange | None = None) -> Source:
    """The source for the format at `path`; logs the number of images left out. Raises InvalidInput,
    in one sentence, when it cannot be played, and Unavailable without the required library."""
    source = _opened(path, part or PlaybackRange())
    if source.left_out:
        log.warning("%s: %s", path, source.left_out)
    return source


def _opened(path: Path, part: PlaybackRange) -> Source:
    if is_recording(path):
        try:
            from helios_replay.mcap_recording import Recording
        except ImportError as error:
            raise Unavailable(
                f"a recording needs the library mcap ({error}); pip install 'helios-ovmm[recorder]'"
            ) from error

        return Recording(mcap_files(path), part)
    if _is_bag(path):
        from helios_replay.rosbag import RosBag

        return RosBag(path, part)
    if (path / "groundtruth.txt").is_file():
        from helios_replay.tum_dataset import TumFolder

        return TumFolder(path, part)
    from helios_replay.rgbd_folder import ImageFolder

    return ImageFolder(path, part)


def is_recording(path: Path) -> bool:
    """True for a HELIOS recording: an MCAP file, or a folder of them."""
    if path.is_dir():
        return not _is_bag(path) and bool(mcap_files(path))
    return path.suffix == ".mcap"


def mcap_files(path: Path) -> list[Path]:
    """The files of a recording in order; empty files of a folder are left out."""
    if not path.is_dir():
        return [path]
    return sorted((f for f in path.glob("*.mcap") if f.stat().st_size > 0), key=_by_number)


def _by_number(file: Path) -> tuple[list[str], list[int]]:
    """Sort key that puts file 1000 after file 999."""
    return re.split(r"\d+", file.name), [int(n) for n in re.findall(r"\d+", file.name)]


def _is_bag(path: Path) -> bool:
    return path.suffix == ".bag" or (path / "metadata.yaml").is_file()
