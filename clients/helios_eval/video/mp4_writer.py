"""Writer of frames into an MP4 file."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
from helios_core.atomic_file import replacing
from helios_core.errors import InvalidInput, Unavailable

from helios_eval.video.drawing import Picture

CODEC = "vp09"  # VP9: plays in every browser, free to write (docs/decisions)


class VideoFile:
    """Context manager that writes a video atomically.

    However the block ends, the frames written so far become a complete video. Until then a file of
    that name stays unchanged.
    """

    def __init__(self, path: Path, width: int, height: int, fps: float) -> None:
        """Raises InvalidInput for a name without .mp4, Unavailable if no video can be written."""
        if path.suffix.lower() != ".mp4":
            raise InvalidInput(f"a video is written as .mp4; {path} is no such name")
        self._path, self._size = path, (width, height)
        self.frames = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._replacing = ExitStack()
            self._temporary = self._replacing.enter_context(replacing(path))
        except OSError as error:
            raise self._unwritable(error.strerror) from error
        code = cv2.VideoWriter.fourcc(*CODEC)
        self._writer = cv2.VideoWriter(str(self._temporary), cv2.CAP_FFMPEG, code, fps, self._size)
        if not self._writer.isOpened():
            self._discard()
            raise Unavailable(
                "this OpenCV cannot write VP9 video, that of PyPI can; "
                "pip install --force-reinstall opencv-python-headless"
            )

    def write(self, picture: Picture, times: int = 1) -> None:
        """Add an RGB picture [height, width, 3] `times` times.

        Raises InvalidInput for another size.
        """
        rows, columns = picture.shape[:2]
        if (columns, rows) != self._size or picture.ndim != 3:
            wide, high = self._size
            raise InvalidInput(f"a frame is {columns} x {rows}; this video is {wide} x {high}")
        bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
        for _ in range(times):
            self._writer.write(bgr)
        self.frames += times

    def close(self) -> None:
        """Move the video to its path; without a frame nothing is written. Raises Unavailable if it
        is not complete."""
        self._writer.release()
        if not self.frames:
            self._discard()
            return
        if not _is_whole(self._temporary):  # the codec reports no errors
            self._discard()
            raise self._unwritable("what was written cannot be read again; is the disk full?")
        try:
            self._replacing.close()
        except OSError as error:
            raise self._unwritable(error.strerror) from error

    def _discard(self) -> None:
        """Remove the written frames; a file of that name stays unchanged."""
        self._temporary.unlink(missing_ok=True)
        self._replacing.pop_all()

    def _unwritable(self, why: str | None) -> Unavailable:
        return Unavailable(f"{self._path} cannot be written: {why}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _is_whole(path: Path) -> bool:
    """True if a player finds a frame in the file; the frame index is written last."""
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        return bool(video.isOpened() and video.grab())
    finally:
        video.release()
