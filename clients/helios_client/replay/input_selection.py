"""Searches and detector of a replay, from its flags."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from helios_client.supervision.service_specs import RECORDED_DETECTOR
from helios_client.usage_errors import UsageError

if TYPE_CHECKING:
    from helios_core.types import SearchContext


def search_and_detector(
    source: Path, classes: str | None, thresholds: str, detector: str | None
) -> tuple[SearchContext | None, str]:
    """(search context, detector) of `helios replay`; context None: the searches of the recording.

    Raises UsageError if an omitted flag would need a recording.
    """
    from helios_replay.format_detection import is_recording

    from helios_client.replay.class_thresholds import search_context_from_flags

    recorded = is_recording(source)
    if classes is None:
        if not recorded:
            raise UsageError(
                f"{source} is not a recording, so --classes must name the classes to find"
            )
        if thresholds:
            raise UsageError("--thresholds is valid only with --classes")
        return None, detector or RECORDED_DETECTOR
    if detector is None or detector == RECORDED_DETECTOR:
        raise UsageError(
            "--classes starts a new search, which recorded detections do not cover; name a "
            "detector with --detector onnx:FILE"
        )
    return search_context_from_flags(classes, thresholds), detector
