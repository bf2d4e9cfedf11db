"""How the belief of object maps goes over posed real frames, each map with settings of its own."""

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

NEAR_M = 0.15  # an instance whose centre is this near to a place is the thing there


@dataclass(frozen=True)
class Place:
    """Where a thing is, or is said to be."""

    name: str
    class_name: str
    center_m: NDArray[np.float64]  # [3] world


@dataclass(frozen=True)
class Seen:
    """What is believed of one thing after one frame."""

    class_name: str
    psi: float
    probabilities: dict[str, float]  # class -> mean over its Gaussians, "other" too
    center_m: tuple[float, ...]  # [3] world


@dataclass
class EpisodeProgress:
    """How one map went; the lists have one entry a frame."""

    frames: list[int] = field(default_factory=list)  # their numbers in the data set
    gaussians: list[int] = field(default_factory=list)
    seen: list[dict[str, Seen]] = field(default_factory=list)  # of a place or a class elsewhere
    is_full: bool = False  # the last frame made more Gaussians than it may have

    def ended(self, name: str) -> float:
        """Psi after the last frame, 0 if there is no such thing."""
        return self.seen[-1][name].psi if name in self.seen[-1] else 0.0

    def highest(self, name: str) -> float:
        """Psi at its best, 0 if there was no such thing."""
        return max((row[name].psi for row in self.seen if name in row), default=0.0)

    def title(self, arm: str) -> str:
        """Of the map with some settings."""
        return f"{arm} (full at frame {self.frames[-1]})" if self.is_full else arm


def names_in(found: dict[str, EpisodeProgress]) -> list[str]:
    """All things that some map had at some frame, in order."""
    return sorted({name for course in found.values() for row in course.seen for name in row})


def frames_of(data: Dataset) -> Iterator[Frame]:
    """All images, as keyframes of a robot whose base is at the origin."""
    for index, image in enumerate(data.images):
        color, depth_m = read_image(data, index)
        number = int(image.color_path.stem)
        yield Frame(
            FrameId("dataset", 0, number), image.stamp_ns, True, color, depth_m, data.camera,
            image.T_world_cam, np.eye(4),
        )  # fmt: skip


def courses(
    data: Dataset,
    detector: DetectorBackend,
    context: SearchContext,
    places: Sequence[Place],
    arms: dict[str, ObjectMapSettings],
) -> dict[str, EpisodeProgress]:
    """Each arm's map after each frame; one that is full takes no more. Raises HeliosError."""
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
            size += report.created - report.carved  # before the limit took its share
            course.frames.append(frame.id.seq)
            course.gaussians.append(size)
            course.seen.append(_believed(built, places))
            course.is_full = size > arms[name].max_gaussians
    return out


def _believed(built: ObjectMap, places: Sequence[Place]) -> dict[str, Seen]:
    """The best of each place and of each class elsewhere, by Psi; those that there are."""
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
