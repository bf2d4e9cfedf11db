"""Folder in the format of TUM's RGB-D SLAM data sets: images by time stamp, poses in one file.

rgb.txt, depth.txt    time file; both optional if associations.txt exists
associations.txt      time rgb-file time depth-file; optional
groundtruth.txt       time tx ty tz qx qy qz qw: camera to world; OpenCV, world z up
rgb/, depth/          the images; depth is 16 bit, 5000 per metre, 0 is invalid; registered
calibration.txt       fx fy cx cy; optional, the data sets' default otherwise

Lines that start with # are comments. Images without a depth image or a pose within 20 ms are left
out, as in the data sets' own tools.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, Pinhole, rotation_from_quaternion

from helios_replay.replay_source import (
    DEFAULT_MAX_DEPTH_M,
    Images,
    PlaybackRange,
    Shot,
    ShotPixels,
    left_out_of,
)
from helios_replay.rgbd_folder import decode, nanoseconds

CLOSE_S = 0.02  # as in `associate.py` of the data sets
DEPTH_PER_M = 5000.0
DEFAULT_INTRINSICS = (525.0, 525.0, 319.5, 239.5)  # "ROS default" of the data sets' page
FARTHEST_M = 1e6


@dataclass(frozen=True)
class _Pair:
    time_s: float
    color: Path
    depth: Path


class TumFolder(Images):
    """TUM folder as a replay source."""

    def __init__(self, folder: Path, part: PlaybackRange) -> None:
        """Raises InvalidInput, which names the file, for missing or invalid data."""
        path = _read_path(folder / "groundtruth.txt")
        times = [t for t, _ in path]
        posed: list[tuple[_Pair, Matrix]] = []
        pairs, images = _read_pairs(folder)
        for pair in pairs:
            nearest = _nearest(times, pair.time_s)
            if nearest is not None:
                posed.append((pair, path[nearest][1]))
        if not posed:
            raise InvalidInput(
                f"{folder} has no image with a depth image and a pose within {CLOSE_S:g} s"
            )
        began_s = posed[0][0].time_s
        inside = part.of([pair.time_s - began_s for pair, _ in posed], str(folder))
        self._pairs = [posed[i][0] for i in inside]
        color = decode(self._pairs[0].color, cv2.IMREAD_COLOR)
        camera = _camera(folder / "calibration.txt", color.shape[1], color.shape[0])
        shots = [
            Shot(pair.time_s - began_s, nanoseconds(pair.time_s, str(folder)), T_world_cam)
            for pair, T_world_cam in (posed[i] for i in inside)
        ]
        self._camera_read = camera
        why = f"no depth or no pose within {CLOSE_S:g} s"
        left_out = left_out_of(images, len(posed), why)
        super().__init__(folder.name, shots, camera, DEFAULT_MAX_DEPTH_M, left_out)

    def read(self, index: int) -> ShotPixels:
        pair, camera = self._pairs[index], self._camera_read
        color = decode(pair.color, cv2.IMREAD_COLOR)
        depth = decode(pair.depth, cv2.IMREAD_UNCHANGED)
        size = (camera.height, camera.width)
        if color.shape[:2] != size or depth.shape != size or depth.dtype != np.uint16:
            raise InvalidInput(
                f"{pair.color} is {color.shape[1]}x{color.shape[0]} and {pair.depth} "
                f"{'x'.join(map(str, depth.shape[1::-1]))} {depth.dtype}; wanted "
                f"{camera.width}x{camera.height} and 16 bit"
            )
        rgb = cv2.cvtColor(color, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
        return ShotPixels(rgb, depth.astype(np.float32) / np.float32(DEPTH_PER_M), camera)


def _read_pairs(folder: Path) -> tuple[list[_Pair], int]:
    """(pairs of colour and depth images by ascending time, number of colour images)."""
    associations = folder / "associations.txt"
    if associations.is_file():
        rows = _rows(associations, 4)
        pairs = [_Pair(_number(r[0], associations), folder / r[1], folder / r[3]) for r in rows]
        return sorted(pairs, key=lambda pair: pair.time_s), len(pairs)
    colors = _listed(folder, "rgb")
    depths = _listed(folder, "depth")
    times = [t for t, _ in depths]
    out: list[_Pair] = []
    for time_s, color in colors:
        nearest = _nearest(times, time_s)
        if nearest is not None:
            out.append(_Pair(time_s, color, depths[nearest][1]))
    return out, len(colors)


def _listed(folder: Path, kind: str) -> list[tuple[float, Path]]:
    """(time, file) of each image, from `<kind>.txt` or from the file names, by ascending time."""
    names = folder / f"{kind}.txt"
    if names.is_file():
        return sorted((_number(r[0], names), folder / r[1]) for r in _rows(names, 2))
    files = sorted((folder / kind).glob("*.png")) + sorted((folder / kind).glob("*.jpg"))
    if not files:
        raise InvalidInput(f"{folder} has neither {kind}.txt nor images in {kind}/")
    return sorted((_number(file.stem, file), file) for file in files)


def _read_path(file: Path) -> list[tuple[float, Matrix]]:
    out: list[tuple[float, Matrix]] = []
    for row in _rows(file, 8):
        time_s, x, y, z, *quaternion = (_number(v, file) for v in row[:8])
        if abs(float(np.linalg.norm(quaternion)) - 1) > 0.01 or max(map(abs, (x, y, z))) > (
            FARTHEST_M
        ):
            raise InvalidInput(f"{file} has a line that is no pose: {' '.join(row[:8])}")
        T_world_cam = np.eye(4)
        T_world_cam[:3, :3] = rotation_from_quaternion(*quaternion)
        T_world_cam[:3, 3] = (x, y, z)
        out.append((time_s, T_world_cam))
    if not out:
        raise InvalidInput(f"{file} holds no pose")
    return sorted(out, key=lambda pose: pose[0])


def _camera(file: Path, width: int, height: int) -> Pinhole:
    fx, fy, cx, cy = DEFAULT_INTRINSICS
    if file.is_file():
        rows = _rows(file, 4)
        if not rows:
            raise InvalidInput(f"{file} is empty; wanted fx fy cx cy")
        fx, fy, cx, cy = (_number(v, file) for v in rows[0][:4])
    elif (width, height) != (640, 480):
        raise InvalidInput(
            f"{file.parent} has images of {width}x{height} and no calibration.txt; write "
            "fx fy cx cy into it"
        )
    if not (fx > 0 and fy > 0):
        raise InvalidInput(f"{file} has fx {fx}, fy {fy}; wanted positive numbers")
    return Pinhole(fx, fy, cx, cy, width, height)


def _rows(file: Path, columns: int) -> list[list[str]]:
    try:
        lines = file.read_text().splitlines()
    except OSError as error:
        raise InvalidInput(f"{file} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{file} is no text: {error.reason}") from error
    out = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    for row in out:
        if len(row) < columns:
            raise InvalidInput(f"{file} has a line {' '.join(row)!r}; wanted {columns} columns")
    return out


def _number(text: str, file: Path) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InvalidInput(f"{file} has {text[:40]!r} where a number is wanted")
    return value


def _nearest(times_s: Sequence[float], time_s: float) -> int | None:
    """Index of the nearest time in an ascending sequence; None if none is within `CLOSE_S`."""
    at = bisect.bisect_left(times_s, time_s)
    near = [i for i in (at - 1, at) if 0 <= i < len(times_s)]
    best = min(near, key=lambda i: abs(times_s[i] - time_s), default=None)
    return best if best is not None and abs(times_s[best] - time_s) <= CLOSE_S else None
