"""Index of a recording's messages without their pixels, read once in the written order."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from google.protobuf.message import DecodeError, Message
from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.codec.frames import pose_from_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.recording_format import KEYFRAME_CHANNELS, channel_of
from helios_core.topics import (
    CONTEXT,
    OBSERVATION,
    PREVIEW,
    RETIRED,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
)
from helios_core.types import FrameId

from helios_replay.mcap_damage import Lost
from helios_replay.mcap_file import DataLocation, Found, McapFile

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class Where:
    """Location of a message in one of the files."""

    file: int
    place: DataLocation


@dataclass
class RecordedKeyframe:
    """A keyframe: its head message and the locations of its pixels."""

    head: pb.Frame
    log_time_ns: int
    color: Where | None = None
    depth: Where | None = None


@dataclass(frozen=True)
class RecordedContext:
    """A search context and the number of keyframes before it."""

    context: pb.SearchContext
    before: int


@dataclass(frozen=True)
class Answer:
    """The observation of a keyframe and the robot's latest state at that time."""

    where: Where
    context_id: str
    state: pb.RobotState | None


@dataclass(frozen=True)
class Retirement:
    """A removal from the object map and the index of the keyframe before it (-1: none)."""

    request: pb.RetireRequest
    after: int


@dataclass(frozen=True)
class Index:
    """All contents of a recording that a replay needs."""

    files: tuple[McapFile, ...]
    began_ns: int
    keys: list[RecordedKeyframe]
    contexts: list[RecordedContext] = field(default_factory=list)
    # Number of keyframes so far -> last state.
    states: dict[int, pb.RobotState] = field(default_factory=dict)
    observations: dict[FrameId, Answer] = field(default_factory=dict)
    previews: dict[FrameId, Where] = field(default_factory=dict)
    retired: list[Retirement] = field(default_factory=list)
    description: pb.RobotDescription | None = None
    left_out: int = 0  # keyframes without pixels, or without a pose

    def message(self, where: Where, kind: type[M]) -> M:
        """Read one message. Raises InvalidInput."""
        file = self.files[where.file]
        return _parse(kind, file.read(where.place), file.path)

    @property
    def cut(self) -> str:
        """Why reading stopped before the end of a file; empty if it did not."""
        return "; ".join(f"{f.path.name}: {f.cut}" for f in self.files if f.cut)

    @property
    def lost(self) -> list[Lost]:
        """Damaged stretches of all files."""
        return [lost for file in self.files for lost in file.lost]


def read_index(paths: Sequence[Path]) -> Index:
    """Index the files. Raises InvalidInput, in one sentence, when there is nothing to play."""
    files = tuple(McapFile(path) for path in paths)
    reader = _Reader()
    for number, file in enumerate(files):
        for found in file.walk():
            try:
                reader.take(number, file, found)
            except HeliosError as error:
                reader.refused = reader.refused or error.message
    shown = ", ".join(str(p) for p in paths[:3]) + (" …" if len(paths) > 3 else "")
    heard = len(reader.keys)
    why = _why(files, reader)
    reader.drop_broken()
    if not reader.keys:
        raise InvalidInput(f"{shown} holds no keyframe of HELIOS{why}")
    if any(f.lost for f in files):
        reader.forget_lost_searches()
    return Index(
        files,
        reader.began_ns,
        reader.keys,
        _as_needed(reader),
        reader.states,
        reader.observations,
        reader.previews,
        _retirements(reader),
        reader.description,
        heard - len(reader.keys),
    )


class _Reader:
    """Builder of an index, fed with the messages in order."""

    def __init__(self) -> None:
        self.began_ns = 0
        self.keys: list[RecordedKeyframe] = []
        self.contexts: list[RecordedContext] = []
        self.states: dict[int, pb.RobotState] = {}
        self.state: pb.RobotState | None = None  # latest state
        self.observations: dict[FrameId, Answer] = {}
        self.previews: dict[FrameId, Where] = {}
        self.retired: list[tuple[pb.Retired, int]] = []  # with the number of keyframes before it
        self.description: pb.RobotDescription | None = None
        self.refused = ""  # error of the first message that does not decode

    def take(self, number: int, file: McapFile, found: Found) -> None:
        self.began_ns = self.began_ns or found.log_time_ns
        where = Where(number, found.place)
        match found.topic, found.schema:
            case (KEYFRAME_CHANNELS.head, "helios.v1.Frame"):
                self.keys.append(RecordedKeyframe(_read(pb.Frame, file, found), found.log_time_ns))
            case (KEYFRAME_CHANNELS.color, "foxglove.CompressedImage"):
                if key := self._newest(found):
                    key.color = where
            case (KEYFRAME_CHANNELS.depth, "foxglove.RawImage"):
                if key := self._newest(found):
                    key.depth = where
            case (topic, "helios.v1.SearchContext") if topic == channel_of(CONTEXT):
                context = _read(pb.SearchContext, file, found)
                # The start of a file may repeat the context of the current search.
                again = found.publish_time_ns < found.log_time_ns and self.contexts
                if not (again and self.contexts[-1].context == context):
                    self.contexts.append(RecordedContext(context, len(self.keys)))
            case (topic, "helios.v1.RobotState") if topic == channel_of(ROBOT_STATE):
                self.state = self.states[len(self.keys)] = _read(pb.RobotState, file, found)
            case (topic, "helios.v1.RobotDescription") if topic == channel_of(ROBOT_DESCRIPTION):
                self.description = _read(pb.RobotDescription, file, found)
            case (topic, "helios.v1.Observation") if topic == channel_of(OBSERVATION):
                observation = _read(pb.Observation, file, found)
                id = frame_id_from_proto(observation.frame.id)
                self.observations[id] = Answer(where, observation.context_id, self.state)
            case (topic, "helios.v1.Preview") if topic == channel_of(PREVIEW):
                self.previews[frame_id_from_proto(_read(pb.Preview, file, found).id)] = where
            case (topic, "helios.v1.Retired") if topic == channel_of(RETIRED):
                self.retired.append((_read(pb.Retired, file, found), len(self.keys)))
            case _:
                pass

    def drop_broken(self) -> None:
        """Discard keyframes without pixels (such as the last one of a truncated file) or pose."""
        kept = [i for i, key in enumerate(self.keys) if _is_whole(key)]

        def moved(before: int) -> int:
            return bisect.bisect_left(kept, before)

        self.contexts = [RecordedContext(s.context, moved(s.before)) for s in self.contexts]
        self.states = {moved(before): state for before, state in self.states.items()}
        self.retired = [(retirement, moved(before)) for retirement, before in self.retired]
        self.keys = [self.keys[i] for i in kept]

    def forget_lost_searches(self) -> None:
        """Discard observations whose search context is lost; the maps would wait for it forever."""
        known = {sought.context.id for sought in self.contexts}
        self.observations = {
            id: answer for id, answer in self.observations.items() if answer.context_id in known
        }

    def _newest(self, found: Found) -> RecordedKeyframe | None:
        """The newest keyframe if `found` has its log time; pixels follow their head with it."""
        key = self.keys[-1] if self.keys else None
        return key if key is not None and key.log_time_ns == found.log_time_ns else None


def _is_whole(key: RecordedKeyframe) -> bool:
    try:
        pose_from_proto(key.head.T_world_cam, "T_world_cam")
    except HeliosError:
        return False
    return key.color is not None and key.depth is not None


def _as_needed(reader: _Reader) -> list[RecordedContext]:
    """Search contexts, each moved to no later than the first keyframe answered with it; the
    recorder may have received them in another order."""
    first: dict[str, int] = {}
    for i, key in enumerate(reader.keys):
        answered = reader.observations.get(frame_id_from_proto(key.head.id))
        if answered is not None:
            first.setdefault(answered.context_id, i)
    out: list[RecordedContext] = []
    latest = len(reader.keys)
    for sought in reversed(reader.contexts):
        latest = min(latest, sought.before, first.get(sought.context.id, latest))
        out.append(RecordedContext(sought.context, latest))
    return out[::-1]


def _retirements(reader: _Reader) -> list[Retirement]:
    """Retirements in order. The object map's message names the keyframe before each; if that one is
    not recorded, the last recorded keyframe counts."""
    order = {frame_id_from_proto(key.head.id): i for i, key in enumerate(reader.keys)}
    out: list[Retirement] = []
    for retirement, before in reader.retired:
        after = order.get(frame_id_from_proto(retirement.after), before - 1)
        out.append(Retirement(retirement.request, max(after, out[-1].after if out else -1)))
    return out


def _read(kind: type[M], file: McapFile, found: Found) -> M:
    return _parse(kind, file.read(found.place), file.path)


def _parse(kind: type[M], data: bytes, path: Path) -> M:
    try:
        return kind.FromString(data)
    except DecodeError as error:
        raise InvalidInput(
            f"{path} holds {len(data)} bytes that are no {kind.DESCRIPTOR.full_name}; "
            "record it again"
        ) from error


def _why(files: Sequence[McapFile], reader: _Reader) -> str:
    damage = [why for f in files for why in (*(lost.why for lost in f.lost), f.cut) if why]
    if damage:
        undeclared = sum(f.undeclared for f in files)
        channels = (
            f"; the list of channels was lost with it, so {undeclared} whole "
            f"chunk{'s' if undeclared > 1 else ''} cannot be read either"
        )
        return f": {'; '.join(damage[:3])}{channels if undeclared else ''}"
    if reader.refused:
        return f": {reader.refused}"
    topics = sorted({t for f in files for t in f.topics})
    if reader.keys:
        return ": the pixels of its keyframes are missing"
    if any(name.endswith("/msg/Image") for f in files for name in f.topics.values()):
        return ": it is a ROS 2 bag; give its folder, the one with metadata.yaml"
    if not topics:
        return ": it is empty"
    return f" (channel {KEYFRAME_CHANNELS.head}); it holds {', '.join(topics[:5])}" + (
        f" and {len(topics) - 5} more" if len(topics) > 5 else ""
    )
