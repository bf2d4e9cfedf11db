"""Examination of the input of a replay, before any process starts."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from helios_core.errors import InvalidInput
from rich.console import Console
from rich.markup import escape

if TYPE_CHECKING:
    from helios_client.replay.run import ReplayJob


@dataclass(frozen=True)
class CheckedInput:
    """Properties of the input of a replay."""

    frames: int
    longest_wait_s: float  # between two frames, at the requested speed
    searches: tuple[frozenset[str], ...]  # class names of each search
    lost: dict[str, Any]  # damage: chunks, bytes, seconds


def examine(job: ReplayJob, console: Console) -> CheckedInput:
    """Open the input and print which parts are not played. Raises InvalidInput if nothing can be
    played, or if the input is damaged and `strict` is set."""
    from helios_replay.format_detection import open_source  # late import: loads OpenCV
    from helios_replay.replay_source import PlaybackRange

    playback = job.playback
    to_s = math.inf if playback.to_s is None else playback.to_s
    source = open_source(
        job.source, PlaybackRange(playback.limit, playback.from_s, to_s, playback.topics)
    )
    lost = _damage(job, getattr(source, "lost", ()), console)
    if cut := getattr(source, "cut", ""):
        if playback.strict:
            raise InvalidInput(
                f"{job.source} is cut off: {cut}; without --strict the part before it is played"
            )
        console.print(
            f"[yellow]cut off, so only the part before the cut is played[/]: {escape(cut)}",
            soft_wrap=True,
        )
    for sentence in (getattr(source, "assumed", ""), source.left_out):
        if sentence:
            console.print(f"[yellow]{escape(sentence)}[/]", soft_wrap=True)
    if job.context is not None:
        searches = (frozenset(c.name for c in job.context.classes),)
    else:
        begun = (c for i in range(len(source.shots)) for c in source.contexts_before(i))
        searches = tuple(frozenset(c.name for c in context.classes) for context in begun)
        if not searches:
            raise InvalidInput(
                f"{job.source} contains no search; name the classes to find with --classes, and a "
                "detector with --detector"
            )
    waits_s = [b.time_s - a.time_s for a, b in itertools.pairwise(source.shots)]
    longest_s = max(waits_s, default=0.0) / playback.rate if playback.rate else 0.0
    return CheckedInput(len(source.shots), longest_s, searches, lost)


def _damage(job: ReplayJob, lost: Any, console: Console) -> dict[str, Any]:
    """Sums over `lost` (`helios_replay.mcap_damage.Lost`), also printed. Raises InvalidInput if
    `strict` is set."""
    out = {
        "chunks": sum(one.chunks for one in lost),
        "bytes": sum(one.size for one in lost),
        "seconds": round(sum(one.seconds for one in lost), 3),
    }
    if not lost:
        return out
    what = (
        f"{out['chunks']} damaged chunk{'s' if out['chunks'] > 1 else ''} "
        f"({out['bytes']} bytes, about {out['seconds']:.1f} s)"
    )
    if job.playback.strict:
        raise InvalidInput(
            f"{job.source} has {what}: {lost[0].why}; without --strict the rest is played"
        )
    console.print(f"[yellow]{what} skipped[/]; the first: {escape(lost[0].why)}", soft_wrap=True)
    return out
