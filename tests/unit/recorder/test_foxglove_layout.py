"""The Foxglove layout: it places every panel and shows only recorded channels."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from helios_core.recording_format import (
    ANNOTATIONS,
    CALIBRATION,
    CANDIDATES,
    FRONTIERS,
    GAUSSIANS,
    KEYFRAME_CHANNELS,
    LOG,
    OBJECTS,
    OBSTACLES,
    OCCUPANCY,
    PATH,
    PLAN,
    STREAM_CHANNELS,
    TRAJECTORY,
    TRANSFORMS,
    VALUES,
    channel_of,
)
from helios_core.topics import TOPICS

LAYOUT = json.loads(
    (Path(__file__).resolve().parents[3] / "deploy/viewers/foxglove-layout.json").read_text()
)
LAYERS = ("pick", "place")  # of a task that moves an object
RECORDED = {channel_of(t) for t in TOPICS} | {ANNOTATIONS, CALIBRATION, LOG, TRANSFORMS}
MAP = {OCCUPANCY, OBSTACLES, GAUSSIANS, FRONTIERS, TRAJECTORY, OBJECTS, PLAN, CANDIDATES, PATH}
RECORDED |= MAP | {VALUES + layer for layer in LAYERS}
for channels in (KEYFRAME_CHANNELS, STREAM_CHANNELS):
    RECORDED |= {channels.color, channels.depth}


def panels(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        yield from panels(layout["first"])
        yield from panels(layout["second"])


def words(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from words(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from words(inner)
    elif isinstance(value, str):
        yield value


def test_every_panel_is_laid_out_once() -> None:
    shown = list(panels(LAYOUT["layout"]))
    assert sorted(shown) == sorted(LAYOUT["configById"])


def test_every_channel_of_the_layout_is_recorded() -> None:
    named = {m.group() for w in words(LAYOUT["configById"]) if (m := re.match(r"/[\w/]+", w))}
    assert named
    assert named <= RECORDED


def test_the_3d_panel_shows_all_map_channels() -> None:
    topics = LAYOUT["configById"]["3D!world"]["topics"]
    assert set(topics) >= MAP
    shown = {name for name, settings in topics.items() if settings["visible"]}
    assert shown >= MAP - {PATH, OBSTACLES}  # already drawn by plan and occupancy
    for grid in (OCCUPANCY, *(VALUES + layer for layer in LAYERS)):
        assert topics[grid]["colorMode"] == "rgba-fields"
