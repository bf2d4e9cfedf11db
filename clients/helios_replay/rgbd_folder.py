"""Reader of a folder of posed RGB-D images, with validation.

meta.json        width, height, fx, fy, cx, cy, depth_scale_m; max_depth_m if known
poses.csv        frame, t_s, r00 r01 r02 tx r10 ...: camera to world; OpenCV, world z up
frames/N.jpg     colour, N the frame's number in six digits
frames/N.png     depth, 16 bit, in units of depth_scale_m; 0 is invalid; registered
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from helios_core.codec.frames import LATEST_S
from helios_core.codec.images import decode_image
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, Pinhole, is_rigid
from numpy.typing import NDArray

from helios_replay.replay_source import DEFAULT_MAX_DEPTH_M, Images, PlaybackRange, Shot, ShotPixels

LARGEST = 1e6  # limit of the numbers in meta.json and of frame numbers
POSE_TOLERANCE = 1e-2  # recorded rotations carry few digits
_ROTATION = [f"r{row}{column}" for row in range(3) for column in range(3)]
_TRANSLATION = ["tx", "ty", "tz"]


@dataclass(frozen=True)
class PosedImage:
    """Files and camera pose of one image."""

    stamp_ns: int
    color_path: Path
    depth_path: Path
    T_world_cam: Matrix  # [4, 4]


@dataclass(frozen=True)
class Dataset:
    """A validated folder of images; the images themselves are read one by one."""

    folder: Path
    camera: Pinhole
    depth_scale_m: float
    max_depth_m: float
    images: tuple[PosedImage, ...]


class ImageFolder(Images):
    """Image folder as a replay source."""

    def __init__(self, folder: Path, part: PlaybackRange) -> None:
        """Raises InvalidInput, which names the file, for missing or invalid data."""
        data = read_dataset(folder)
        began_ns = data.images[0].stamp_ns
        times_s = [(image.stamp_ns - began_ns) / 1e9 for image in data.images]
        self._data, self._part = data, part.of(times_s, str(folder))
        shots = [
            Shot(times_s[i], data.images[i].stamp_ns, data.images[i].T_world_cam)
            for i in self._part
        ]
        super().__init__(folder.name, shots, data.camera, data.max_depth_m)

    def read(self, index: int) -> ShotPixels:
        color, depth_m = read_image(self._data, self._part[index])
        return ShotPixels(color, depth_m, self._data.camera)


def read_dataset(folder: Path) -> Dataset:
    """The data set in a folder.

    Raises InvalidInput, which names the file, for missing or invalid data.
    """
    meta = _read_meta(folder)
    camera = Pinhole(
        *(_number(meta, key, folder) for key in ("fx", "fy", "cx", "cy")),
        width=int(_number(meta, "width", folder)),
        height=int(_number(meta, "height", folder)),
    )
    images = _read_poses(folder)
    for image in images:
        for path in (image.color_path, image.depth_path):
            if not path.is_file():
                raise InvalidInput(f"{path} is missing, but poses.csv names its frame")
    return Dataset(
        folder=folder,
        camera=camera,
        depth_scale_m=_number(meta, "depth_scale_m", folder),
        max_depth_m=_number({"max_depth_m": DEFAULT_MAX_DEPTH_M} | meta, "max_depth_m", folder),
        images=images,
    )


def read_image(dataset: Dataset, index: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """(colour [h, w, 3] RGB, depth [h, w] in metres). Raises InvalidInput with the file's name."""
    image = dataset.images[index]
    shape = (dataset.camera.height, dataset.camera.width)
    color = decode(image.color_path, cv2.IMREAD_COLOR)
    depth = decode(image.depth_path, cv2.IMREAD_UNCHANGED)
    if color.shape[:2] != shape:
        raise InvalidInput(_wrong_size(image.color_path, color, shape))
    if depth.shape != shape or depth.dtype != np.uint16:
        raise InvalidInput(
            f"{_wrong_size(image.depth_path, depth, shape)}; depth is one channel of 16 bit"
        )
    rgb = cv2.cvtColor(color, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
    return rgb, depth.astype(np.float32) * np.float32(dataset.depth_scale_m)


def _read_meta(folder: Path) -> dict[str, Any]:
    path = folder / "meta.json"
    try:
        meta = json.loads(path.read_text())
    except (FileNotFoundError, NotADirectoryError):
        raise InvalidInput(
            f"there is no data set at {folder}; give a recording (.mcap), a ROS bag, or a folder "
            "with meta.json, poses.csv and frames/, or with groundtruth.txt, rgb/ and depth/"
        ) from None
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{path} is no JSON: {error}") from error
    if not isinstance(meta, dict):
        raise InvalidInput(f"{path} holds no JSON object; wanted width, height, fx, fy, cx, cy ...")
    return meta


def _number(meta: dict[str, Any], key: str, folder: Path) -> float:
    value = meta.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= LARGEST:
        raise InvalidInput(
            f"{folder / 'meta.json'} has {key} = {str(value)[:40]}; wanted a number above 0, at "
            f"most {LARGEST:g}"
        )
    return float(value)


def _read_poses(folder: Path) -> tuple[PosedImage, ...]:
    """Images of poses.csv by ascending time, for any order of the rows."""
    path = folder / "poses.csv"
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path} is no CSV: {error}") from error
    if not rows:
        raise InvalidInput(f"{path} names no frame")
    images = [_posed_image(folder, row, line) for line, row in enumerate(rows, start=2)]
    return tuple(sorted(images, key=lambda image: image.stamp_ns))


def _posed_image(folder: Path, row: dict[str, str], line: int) -> PosedImage:
    where = f"{folder / 'poses.csv'} line {line}"
    T_world_cam = np.eye(4)
    try:
        number, stamp_s = int(row["frame"]), float(row["t_s"])
        T_world_cam[:3, :3] = np.reshape([float(row[c]) for c in _ROTATION], (3, 3))
        T_world_cam[:3, 3] = [float(row[c]) for c in _TRANSLATION]
    except KeyError as error:
        raise InvalidInput(f"{where} has no column {error}; wanted frame, t_s, r00 … tz") from None
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{where} cannot be read: {error}") from None
    if not 0 <= number <= LARGEST:
        raise InvalidInput(f"{where} has a frame {str(number)[:40]}; number frames from 0")
    if not is_rigid(T_world_cam, POSE_TOLERANCE):
        raise InvalidInput(f"{where} is no pose: its rotation is not rigid or a number not finite")
    stem = folder / "frames" / f"{number:06d}"
    return PosedImage(
        stamp_ns=nanoseconds(stamp_s, where),
        color_path=stem.with_suffix(".jpg"),
        depth_path=stem.with_suffix(".png"),
        T_world_cam=T_world_cam,
    )


def nanoseconds(stamp_s: float, where: str) -> int:
    """Seconds as whole nanoseconds. Raises InvalidInput, with `where`, for an invalid time."""
    if not abs(stamp_s) <= LATEST_S:  # NaN too
        raise InvalidInput(f"{where} has the time {stamp_s:g}; wanted seconds, at most {LATEST_S}")
    return round(stamp_s * 1e9)


def decode(path: Path, flags: int) -> NDArray:
    """Pixels of an image file in OpenCV's layout. Raises InvalidInput with the file's name."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from error
    return decode_image(CompressedImage(data=data, format=path.suffix[1:]), flags, str(path))


def _wrong_size(path: Path, pixels: NDArray, shape: tuple[int, int]) -> str:
    came = "x".join(map(str, pixels.shape[1::-1]))
    return f"{path} is {came} {pixels.dtype}, meta.json says {shape[1]}x{shape[0]}"
