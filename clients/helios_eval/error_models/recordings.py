"""Things of recordings: every format that `helios replay` plays, with any detector."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helios_core.codec.frames import detection_from_proto
from helios_core.errors import InvalidInput
from helios_core.household_names import HOUSEHOLD_NAMES
from helios_core.types import Detection, Frame, FrameId, SearchContext
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import open_detector
from helios_objectmap.settings import ObjectMapSettings
from helios_replay.format_detection import open_source
from helios_replay.mcap_recording import Recording
from helios_replay.replay_source import Source

from helios_eval.error_models.named_things import KnownPlace, NamedThing, SceneLog, with_places
from helios_eval.studies.detector_errors.__main__ import arm_of
from helios_eval.studies.detector_errors.repeat_rates import (
    LoggedImage,
    RepeatRates,
    logged,
    nothing,
    repeat_rates,
)

RECORDED = "recorded"  # the detections that the recording itself has
MOST_COMPARED = 300  # views of a recording that are compared with one another
LARGEST_M = 1e5


@dataclass(frozen=True)
class RecordedSightings:
    """What a detector said in recordings."""

    detector: str  # name that the detector gives itself
    asked: tuple[str, ...]  # empty for the recorded detections
    things: tuple[NamedThing, ...]
    repeats: RepeatRates
    views: int


def look_at_recordings(
    paths: Sequence[Path],
    detector: str,
    places: Sequence[KnownPlace],
    threads: int,
    settings: ObjectMapSettings,
    say: Callable[[str], None],
) -> RecordedSightings:
    """Detect in all recordings; each is a scene of its own. places: of the things of all of them.

    Raises InvalidInput, in one sentence, and Unavailable.
    """
    opened, asked, name, context = None, (), "", SearchContext("calibrate", ())
    things: list[NamedThing] = []
    views, repeats = 0, nothing()
    with ExitStack() as at_end:
        if detector != RECORDED:
            options = DetectorOptions(threads=threads)
            opened = at_end.enter_context(closing(open_detector(detector, options)))
            opened.warm_up()
            context = arm_of(detector, HOUSEHOLD_NAMES, opened.vocabulary()).context
            asked, name = tuple(c.name for c in context.classes), opened.name
        for scene, path in enumerate(paths):
            source = open_source(path)
            log, images = SceneLog(settings), list[LoggedImage]()
            if opened is None:
                name = _same_detector(name, _recorded_detector(source, path), path)
            every = max(1, len(source.shots) // MOST_COMPARED)
            for n, frame in _frames(source, log):
                if opened is None:
                    found = _recorded(source, n, frame)
                else:
                    found = opened.detect(frame, context).detections
                log.add(frame, found)
                if n % every == 0:
                    images.append(logged(frame, found))
            repeats = repeats + repeat_rates(images)
            here = list(log.found_things(scene))
            things += with_places(here, places)
            views += len(log)
            say(f"{path}: {len(log)} views of {len(source.shots)} images, {len(here)} things")
    return RecordedSightings(name, asked, tuple(things), repeats, views)


def read_places(path: Path) -> list[KnownPlace]:
    """Places of a CSV file with the columns name, x, y, z (world, metres); "cup|mug" means either
    name is right. Raises InvalidInput, which names the line."""
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, csv.Error, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path} cannot be read as CSV: {error}") from error
    places = []
    for line, row in enumerate(rows, start=2):
        try:
            at = [float(row[key]) for key in ("x", "y", "z")]
            names = tuple(n.strip() for n in row["name"].split("|") if n.strip())
        except (KeyError, TypeError, ValueError, AttributeError):
            names, at = (), [math.nan]
        if not names or not all(abs(v) <= LARGEST_M for v in at):
            raise InvalidInput(
                f"{path} line {line} is no place; wanted the columns name,x,y,z with metres in the "
                "recording's world frame, as in mug,1.80,0.72,0.80"
            )
        places.append(KnownPlace(names, (at[0], at[1], at[2])))
    if not places:
        raise InvalidInput(f"{path} names no place; wanted the columns name,x,y,z")
    return places


def _frames(source: Source, log: SceneLog) -> Iterator[tuple[int, Frame]]:
    """Frames of the views that count; only these are decoded."""
    for n, shot in enumerate(source.shots):
        if log.takes(shot.T_world_cam):
            pixels = source.read(n)
            yield n, Frame(
                FrameId("calibrate", 0, n + 1), shot.stamp_ns, True, pixels.color, pixels.depth_m,
                pixels.camera, shot.T_world_cam, np.eye(4),
            )  # fmt: skip


def _recorded_detector(source: Source, path: Path) -> str:
    """Detector whose observations a recording has. Raises InvalidInput without one."""
    if isinstance(source, Recording):
        for n in range(len(source.shots)):
            if (message := source.found(n)) is not None and message.detector:
                return message.detector
    raise InvalidInput(
        f"{path} holds nothing that a detector found; name one, --detector onnx:FILE"
    )


def _same_detector(known: str, found: str, path: Path) -> str:
    if known and known != found:
        raise InvalidInput(
            f"{path} has detections of {found}, the others have those of {known}; fit a model for "
            "each of them"
        )
    return found


def _recorded(source: Source, index: int, frame: Frame) -> tuple[Detection, ...]:
    assert isinstance(source, Recording)
    message = source.found(index)
    if message is None:
        return ()
    both = (*message.detections, *message.others)
    return tuple(detection_from_proto(d, frame.depth_m.shape) for d in both)
