"""Storage of past views, so that later prompts can be scored on them.

A view consists of its cone on the ground, its image embedding, its detected classes and a
thumbnail. The scores of a prompt for all views yield the value layer that the prompt would have had
from the start. At most `most` views are stored; beyond that, the view is dropped whose ground the
other views cover best from the same direction.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.codec import (
    embedding_from_proto,
    embedding_to_proto,
    frame_id_from_proto,
    frame_id_to_proto,
)
from helios_core.codec.frames import FARTHEST_M
from helios_core.errors import InvalidInput
from helios_core.types import Embedding, FrameId
from numpy.typing import NDArray

from helios_map2d.layers.value_layers import Cone, bin_directions
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.view_memory.detected_names import DetectedClass

PICTURE_PX = 320  # longer side of a thumbnail
PATCH_M = 0.5  # side of the ground squares by which views are compared
SIDES = 8  # number of directions of view by which views are compared
FARTHEST_SEEN_M = 5000.0  # limit of a 176 degree lens with 16 bits of millimetres
PROBES = 48  # number of azimuths at which a view's ground is sampled


@dataclass(frozen=True, eq=False)
class SeenView:
    """One stored view, searchable by its embedding, if any, and by its detected classes `named`.

    `jpeg` is a thumbnail of its image.
    """

    id: FrameId
    stamp_ns: int
    cone: Cone
    embedding: Embedding | None
    jpeg: bytes
    named: tuple[DetectedClass, ...] = ()

    @cached_property
    def patches(self) -> frozenset[tuple[int, int, int]]:
        """Coarse coverage: ground squares, each with the direction of view."""
        seen = np.flatnonzero(self.cone.reach_m)
        if not len(seen):
            return frozenset()
        seen = seen[:: max(1, len(seen) // PROBES)]
        forward, left = bin_directions(len(self.cone.reach_m))[:, seen]
        c, s = self.cone.heading
        steps = np.arange(PATCH_M / 2, max(float(self.cone.reach_m.max()), PATCH_M), PATCH_M)
        at, ray = np.nonzero(steps[:, None] <= self.cone.reach_m[seen])
        x = self.cone.x_m + steps[at] * (c * forward - s * left)[ray]
        y = self.cone.y_m + steps[at] * (s * forward + c * left)[ray]
        side = math.floor(math.atan2(s, c) / math.tau * SIDES + 0.5) % SIDES
        squares = np.unique(np.floor(np.stack([x, y], 1) / PATCH_M).astype(int), axis=0)
        return frozenset((int(a), int(b), side) for a, b in squares)

    @cached_property
    def kept(self) -> bytes:
        """View for files: a serialised `KeptMap` of this view alone."""
        reach = self.cone.reach_m
        seen = np.flatnonzero(reach)
        lo, hi = (int(seen[0]), int(seen[-1]) + 1) if len(seen) else (0, 0)
        view = pb.KeptView(
            id=frame_id_to_proto(self.id), stamp_ns=self.stamp_ns, x_m=self.cone.x_m,
            y_m=self.cone.y_m, heading_x=self.cone.heading[0], heading_y=self.cone.heading[1],
            half_fov_rad=self.cone.half_fov_rad, bins=len(reach), first_bin=lo,
            reach_m=reach[lo:hi].astype("<f4").tobytes(), jpeg=self.jpeg,
            named=[pb.KeptSighting(class_name=s.class_name, score=s.score, x_m=s.x_m, y_m=s.y_m)
                   for s in self.named],
        )  # fmt: skip
        if self.embedding is not None:
            view.embedding.CopyFrom(embedding_to_proto(self.embedding))
        return pb.KeptMap(views=[view]).SerializeToString()


def moved_view(view: SeenView, T_here_there: Transform2) -> SeenView:
    """View of another map in this frame."""
    cone = view.cone
    x_m, y_m = T_here_there.of(np.array([[cone.x_m, cone.y_m]]))[0].tolist()
    heading = T_here_there.rotation @ cone.heading
    places = T_here_there.of(np.array([(n.x_m, n.y_m) for n in view.named]).reshape(-1, 2))
    return replace(
        view,
        cone=replace(cone, x_m=x_m, y_m=y_m, heading=(float(heading[0]), float(heading[1]))),
        named=tuple(
            replace(n, x_m=float(x), y_m=float(y))
            for n, (x, y) in zip(view.named, places, strict=True)
        ),
    )


def read_view(message: pb.KeptView) -> SeenView:
    """View that `SeenView.kept` wrote. Raises InvalidInput if it is damaged."""
    reach = np.frombuffer(message.reach_m, "<f4")
    if not 0 < message.bins <= 100_000 or message.first_bin + len(reach) > message.bins:
        raise InvalidInput(
            f"a kept view has {len(reach)} ranges from {message.first_bin} of {message.bins}"
        )
    numbers = (message.x_m, message.y_m, message.heading_x, message.heading_y)
    numbers += tuple(v for s in message.named for v in (s.score, s.x_m, s.y_m))
    if not np.isfinite([*numbers, message.half_fov_rad]).all() or not np.isfinite(reach).all():
        raise InvalidInput("a kept view has numbers that are not finite")
    turned = abs(math.hypot(message.heading_x, message.heading_y) - 1)
    far_m = max(abs(message.x_m), abs(message.y_m))
    least_m, most_m = reach.min(initial=0.0), reach.max(initial=0.0)
    if (
        turned > 1e-3
        or far_m > FARTHEST_M
        or not 0 < message.half_fov_rad <= math.pi
        or least_m < 0
        or most_m > FARTHEST_SEEN_M
    ):
        raise InvalidInput(
            f"a kept view at ({message.x_m:g}, {message.y_m:g}) m has the heading "
            f"({message.heading_x:g}, {message.heading_y:g}), half a field of view of "
            f"{message.half_fov_rad:g} rad and ranges of {least_m:g} to {most_m:g} m: the file is "
            "damaged"
        )
    whole = np.zeros(message.bins, np.float32)
    whole[message.first_bin : message.first_bin + len(reach)] = reach
    cone = Cone(
        message.x_m,
        message.y_m,
        (message.heading_x, message.heading_y),
        message.half_fov_rad,
        whole,
    )
    return SeenView(
        frame_id_from_proto(message.id),
        message.stamp_ns,
        cone,
        embedding_from_proto(message.embedding) if message.HasField("embedding") else None,
        message.jpeg,
        tuple(DetectedClass(s.class_name, s.score, s.x_m, s.y_m) for s in message.named),
    )


class ViewMemory:
    """Stored views of one map, in the order of their addition."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._views: dict[FrameId, SeenView] = {}
        self._seen_by: Counter[tuple[int, int, int]] = Counter()

    def __len__(self) -> int:
        return len(self._views)

    def add(self, view: SeenView) -> None:
        """Store a view; it replaces another of the same frame."""
        if self._most <= 0:
            return
        if view.id in self._views:
            self._drop(view.id)
        self._views[view.id] = view
        self._seen_by.update(view.patches)
        if len(self._views) > self._most:
            self._drop(self._most_redundant(view.id))

    def snapshot(self) -> tuple[SeenView, ...]:
        """All views, oldest first."""
        return tuple(self._views.values())

    def _most_redundant(self, newest: FrameId) -> FrameId:
        """View whose ground the others cover best, the oldest of equals; never the newest view."""

        def redundancy(id: FrameId) -> float:
            patches = self._views[id].patches
            if not patches:
                return math.inf
            return sum(1 - 1 / self._seen_by[p] for p in patches) / len(patches)

        return max((id for id in self._views if id != newest), key=redundancy, default=newest)

    def _drop(self, id: FrameId) -> None:
        view = self._views.pop(id)
        self._seen_by.subtract(view.patches)
        for patch in view.patches:
            if self._seen_by[patch] <= 0:
                del self._seen_by[patch]


def small_picture(color: NDArray[np.uint8]) -> bytes:
    """JPEG thumbnail of an RGB image, at most `PICTURE_PX` along its longer side."""
    height, width = color.shape[:2]
    scale = min(1.0, PICTURE_PX / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(
        ".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80]
    )
    return data.tobytes()
