"""Beliefs of object maps over posed real frames, each map with settings of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from helios_core.types import Frame, FrameId, Observation, SearchContext
from helios_detector.backend import DetectorBackend
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_replay.rgbd_folder import Dataset, read_image
from numpy.typing import NDArray

NEAR_M = 0.15  # an instance with its centre this near to a place is the object there


@dataclass(frozen=True)
class Place:
    """True or assumed location of an object."""

    name: str
    class_name: str
    center_m: NDArray[np.float64]  # [3] world


@dataclass(frozen=True)
class Seen:
    """Belief about one object after one frame."""

    class_name: str
    psi: float
    probabilities: dict[str, float]  # class -> mean over its Gaussians, with "other"
    center_m: tuple[float, ...]  # [3] world


@dataclass
class EpisodeProgress:
    """State of one map over the frames; lists have one entry per frame."""

    frames: list[int] = field(default_factory=list)  # frame numbers in the data set
    gaussians: list[int] = field(default_factory=list)
    seen: list[dict[str, Seen]] = field(default_factory=list)  # by place, or by class elsewhere
    is_full: bool = False  # the last frame created more Gaussians than the limit

    def ended(self, name: str) -> float:
        """Psi after the last frame; 0 without such an object."""
        return self.seen[-1][name].psi if name in self.seen[-1] else 0.0

    def highest(self, name: str) -> float:
        """Highest Psi at any frame; 0 without such an object."""
        return max((row[name].psi for row in self.seen if name in row), default=0.0)

    def title(self, arm: str) -> str:
        """Title of the map of an arm."""
        return f"{arm} (full at frame {self.frames[-1]})" if self.is_full else arm


def names_in(found: dict[str, EpisodeProgress]) -> list[str]:
    """Names of all objects that some map had at some frame, sorted."""
    return sorted({name for course in found.values() for row in course.seen for name in row})


def frames_of(data: Dataset) -> Iterator[Frame]:
    """All images as keyframes of a robot whose base is at the origin."""
    for index, image in enumerate(data.images):
        color, depth_m = read_image(data, index)
        number = int(image.color_path.stem)
        yield Frame(
            FrameId("dataset", 0, number),
            image.stamp_ns,
            True,
            color,
            depth_m,
            data.camera,
            image.T_world_cam,
            np.eye(4),
        )


def belief_progress(
    data: Dataset,
    detector: DetectorBackend,
    context: SearchContext,
    places: Sequence[Place],
    arms: dict[str, ObjectMapSettings],
) -> dict[str, EpisodeProgress]:
    """State of each arm's map over the frames; a full map takes no more. Raises HeliosError."""
    maps = {name: ObjectMap(chosen) for name, chosen in arms.items()}
    out = {name: EpisodeProgress() for name in arms}
    for frame in frames_of(data):
        found = detector.detect(frame, context).detections
        for name, built in maps.items():
            course = out[name]
            if course.is_full:
                continue
            size = len(built)
            report = built.update(Observation(frame, context.id, found, {}, "detector"), context)
            size += report.created - report.carved  # before removal down to the limit
            course.frames.append(frame.id.seq)
            course.gaussians.append(size)
            course.seen.append(_believed(built, places))
            course.is_full = size > arms[name].max_gaussians
    return out


def _believed(built: ObjectMap, places: Sequence[Place]) -> dict[str, Seen]:
    """Best instance by Psi at each place, and of each class elsewhere."""
    best: dict[str, Seen] = {}
    for o in built.objects():
        alike = [p for p in places if p.class_name == o.class_name]
        elsewhere = f"other {o.class_name}" if alike else o.class_name
        name = next((p.name for p in alike if _near(o.center_m, p)), elsewhere)
        if name not in best or o.score > best[name].psi:
            best[name] = Seen(o.class_name, o.score, o.probabilities, tuple(o.center_m.tolist()))
    return best


def _near(center_m: NDArray[np.float64], place: Place) -> bool:
    return float(np.linalg.norm(center_m - place.center_m)) < NEAR_M
