"""Snapshot of a failed episode, from which a picture can be drawn later.

One small NPZ each: `<folder>/failed/<agent>-<semantics>-<seed>-<digest>.npz`. The digest is that of
the episode's key, so episodes under other noise or settings have files of their own.
"""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from helios_core.atomic_file import replacing
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

FAILED = "failed"
MOST_KEPT = 12  # per agent
_NAME = re.compile(r"(?P<agent>.+)-(noisy|ground-truth|detector)-(?P<seed>\d+)-[0-9a-f]{12}\.npz")


@dataclass(frozen=True)
class MarkedObject:
    """Object or receptacle of the home, or instance of the object map; world frame, metres."""

    label: str
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    score: float = 1.0  # Psi of a belief; 1 for ground truth
    class_score: float = 1.0  # S of a belief; 1 for ground truth


@dataclass(frozen=True)
class FailureSnapshot:
    """One failed episode.

    `occupancy` int8 [rows, columns] is -1 unknown, 0 free, 100 occupied; rows along y, columns
    along x; cell (0, 0) begins at `origin_m` (x, y). For an agent without a map it is the true
    floor plan. `trajectory_m` float64 [n, 2] holds the true positions of the base.
    """

    key: str  # as in the record
    agent: str
    semantics: str
    seed: int
    instruction: str
    cause: str
    message: str  # last message of the agent
    occupancy: NDArray[np.int8]
    origin_m: tuple[float, float]
    cell_m: float
    trajectory_m: NDArray[np.float64]
    start_pose: tuple[float, float, float]  # x, y (m), yaw (rad)
    candidates: tuple[
        MarkedObject, ...
    ]  # ground truth: matching objects, where they are at the end
    goals: tuple[MarkedObject, ...]  # ground truth: matching receptacles
    beliefs: tuple[MarkedObject, ...]  # the object map at the end, class score at least 0.3
    camera_jpeg: bytes  # last camera image; may be empty


def path_of(folder: Path, kept: FailureSnapshot) -> Path:
    """Path of a failure snapshot."""
    digest = hashlib.sha256(kept.key.encode()).hexdigest()[:12]
    return folder / FAILED / f"{kept.agent}-{kept.semantics}-{kept.seed}-{digest}.npz"


def keep(folder: Path, kept: FailureSnapshot) -> None:
    """Write the snapshot if it is among the `MOST_KEPT` of its agent with the lowest seeds, and
    delete the one that it displaces: which remain does not depend on the order of the episodes."""
    save(folder, kept)
    several = sorted(all_of(folder, kept.agent), key=_order)
    for path in several[MOST_KEPT:]:
        path.unlink(missing_ok=True)


def _order(path: Path) -> tuple[int, str]:
    named = _NAME.fullmatch(path.name)
    assert named is not None  # `all_of` gives only such names
    return int(named["seed"]), path.name


def save(folder: Path, kept: FailureSnapshot) -> Path:
    """Write the snapshot atomically; return its path."""
    path = path_of(folder, kept)
    path.parent.mkdir(parents=True, exist_ok=True)
    words = {name: value for name, value in asdict(kept).items() if name not in _ARRAYS}
    with replacing(path) as temporary:
        np.savez_compressed(
            temporary,
            allow_pickle=False,
            words=np.array(json.dumps(words)),
            occupancy=kept.occupancy.astype(np.int8),
            trajectory_m=kept.trajectory_m.astype(np.float64).reshape(-1, 2),
            camera_jpeg=np.frombuffer(kept.camera_jpeg, np.uint8),
        )
    return path


def load(path: Path) -> FailureSnapshot:
    """Read a snapshot. Raises InvalidInput for a file that is not a snapshot."""
    try:
        with np.load(path, allow_pickle=False) as file:
            words = json.loads(str(file["words"]))
            for name in ("candidates", "goals", "beliefs"):
                words[name] = tuple(_marked(raw) for raw in words[name])
            words["origin_m"] = tuple(words["origin_m"])
            words["start_pose"] = tuple(words["start_pose"])
            return FailureSnapshot(
                occupancy=file["occupancy"],
                trajectory_m=file["trajectory_m"],
                camera_jpeg=file["camera_jpeg"].tobytes(),
                **words,
            )
    except _UNREADABLE as error:
        raise InvalidInput(
            f"{path} is no failure snapshot of an episode ({type(error).__name__}: {error}); "
            "delete it"
        ) from error


def all_of(folder: Path, agent: str | None = None) -> list[Path]:
    """Paths of a run's failure snapshots, of one agent or of all, sorted by name."""
    found = ((path, _NAME.fullmatch(path.name)) for path in (folder / FAILED).glob("*.npz"))
    return sorted(path for path, named in found if named and agent in (None, named["agent"]))


def _marked(raw: dict[str, Any]) -> MarkedObject:
    center_m, size_m = tuple(raw["center_m"]), tuple(raw["size_m"])
    return MarkedObject(raw["label"], center_m, size_m, raw["score"], raw["class_score"])


_UNREADABLE = (  # raised by numpy and zipfile for a damaged file
    OSError,
    EOFError,
    KeyError,
    TypeError,
    ValueError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)
_ARRAYS = frozenset({"occupancy", "trajectory_m", "camera_jpeg"})
