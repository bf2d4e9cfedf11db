"""Compile every kernel before the first frame: cold compilation takes seconds, cached ones none."""

from __future__ import annotations

import numpy as np
from helios_core.geometry import Pinhole
from helios_core.types import (
    Detection,
    Frame,
    FrameId,
    Observation,
    Role,
    SearchClass,
    SearchContext,
)

from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.view import View


def warm_up(settings: ObjectMapSettings) -> None:
    """Run a made-up observation and a what-if through a map that is thrown away."""
    camera = Pinhole(60.0, 60.0, 31.5, 23.5, 64, 48)
    mask = np.zeros((48, 64), bool)
    mask[16:32, 16:32] = True
    frame = Frame(
        FrameId("warm-up", 0, 0),
        0,
        True,
        np.zeros((48, 64, 3), np.uint8),
        np.full((48, 64), 1.0, np.float32),
        camera,
        np.eye(4),
        np.eye(4),
    )
    context = SearchContext("warm-up", (SearchClass("thing", Role.OBJECT, 0.0),))
    seen = Detection("thing", 1.0, (16, 16, 32, 32), mask)
    observation = Observation(frame, context.id, (seen,), {}, "warm-up")
    scratch = ObjectMap(settings)
    scratch.update(observation, context)
    view = View(60.0, 60.0, 31.5, 23.5, 64, 48, np.eye(4))
    for instance in scratch.objects():
        scratch.what_if(instance.id, instance.class_name, [view])
