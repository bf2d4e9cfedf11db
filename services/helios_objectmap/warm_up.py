"""Compilation of all kernels before the first frame: seconds if cold, nothing if cached."""

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

from helios_objectmap.camera import View
from helios_objectmap.instances.summary import MANY_POINTS, outline
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings


def warm_up(settings: ObjectMapSettings) -> None:
    """Run synthetic observations, a what-if and a removal through a temporary map."""
    camera = Pinhole(60.0, 60.0, 31.5, 23.5, 64, 48)
    mask = np.zeros((48, 64), bool)
    mask[16:32, 16:32] = True
    classes = (
        SearchClass("thing", Role.OBJECT, 0.0),
        SearchClass("table", Role.GOAL_RECEPTACLE, 0.0),
    )
    context = SearchContext("warm-up", classes)
    seen = tuple(Detection(c.name, 1.0, (16, 16, 32, 32), mask) for c in classes)
    scratch = ObjectMap(settings)
    color, depth_m = np.zeros((48, 64, 3), np.uint8), np.full((48, 64), 1.0, np.float32)
    for i in range(2):  # the second one re-observes the Gaussians of the first
        T_world_cam = np.eye(4)
        T_world_cam[0, 3] = 0.1 * i
        frame = Frame(
            FrameId("warm-up", 0, i), i, True, color, depth_m, camera, T_world_cam, np.eye(4)
        )
        scores = {c.name: 0.5 for c in classes}
        observation = Observation(frame, context.id, seen, {}, "warm-up", class_scores=scores)
        scratch.update(observation, context)
    view = View(60.0, 60.0, 31.5, 23.5, 64, 48, np.eye(4))
    for instance in scratch.objects():
        scratch.what_if(instance.id, instance.class_name, [view])
        scratch.retire(instance.id)
    outline(np.zeros((MANY_POINTS + 1, 2), np.float32))
