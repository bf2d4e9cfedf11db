"""Pairs of colour and depth by stamp. No I/O, not thread-safe."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

MOST_WAITING = 10


@dataclass(frozen=True)
class ImagePair:
    """Two images of one moment; `stamp_ns` is that of the colour image."""

    stamp_ns: int
    color: Any
    depth: Any


class ImagePairs:
    """Matches each colour image with the depth image nearest in time."""

    def __init__(self, within_s: float) -> None:
        self._within_ns = int(within_s * 1e9)
        self._color: OrderedDict[int, Any] = OrderedDict()
        self._depth: OrderedDict[int, Any] = OrderedDict()
        self.newest: ImagePair | None = None

    def add_color(self, stamp_ns: int, image: Any) -> ImagePair | None:
        """Add a colour image. Returns the pair that it completes."""
        near = self._nearest(self._depth, stamp_ns)
        self._keep(self._color, stamp_ns, image)
        return None if near is None else self._pair(stamp_ns, near)

    def add_depth(self, stamp_ns: int, image: Any) -> ImagePair | None:
        """Add a depth image. Returns the pair that it completes."""
        near = self._nearest(self._color, stamp_ns)
        self._keep(self._depth, stamp_ns, image)
        return None if near is None else self._pair(near, stamp_ns)

    def clear(self) -> None:
        """Forget all images: the robot's clock has begun anew."""
        self._color.clear()
        self._depth.clear()
        self.newest = None

    def _pair(self, color_ns: int, depth_ns: int) -> ImagePair:
        pair = ImagePair(color_ns, self._color[color_ns], self._depth[depth_ns])
        for waiting, used_ns in ((self._color, color_ns), (self._depth, depth_ns)):
            for older in [ns for ns in waiting if ns <= used_ns]:
                del waiting[older]
        self.newest = pair
        return pair

    def _nearest(self, images: OrderedDict[int, Any], stamp_ns: int) -> int | None:
        near = min(images, key=lambda ns: abs(ns - stamp_ns), default=None)
        return near if near is not None and abs(near - stamp_ns) <= self._within_ns else None

    @staticmethod
    def _keep(images: OrderedDict[int, Any], stamp_ns: int, image: Any) -> None:
        images[stamp_ns] = image
        while len(images) > MOST_WAITING:
            images.popitem(last=False)
