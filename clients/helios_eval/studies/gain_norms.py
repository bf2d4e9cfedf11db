"""Study of gain_norm: the worth S·IG of one table, first seen from several distances.

    python -m helios_eval.studies.gain_norms

The object map gets one view of a table of 0.8 x 1.2 m, from one distance after the other, and then
one view of a speck of 12 cm. Each gain is that of ten gaze points 0.6 m around the thing, which are
the same for every first view of it. The table printed shows S·IG in the units of every gain_norm,
each relative to the table that was first seen from the nearest place.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Pinhole, camera_on_base, se2_to_se3
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
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.decisions.gain import Gain, normalised_gain
from helios_planner.settings import GainNorm
from numpy.typing import NDArray

NORMS: tuple[GainNorm, ...] = ("sum", "per_area", "per_pixel", "per_gaussian")
CAMERA = Pinhole(fx=381.4, fy=381.4, cx=319.5, cy=239.5, width=640, height=480)
EYE_M, TOP_M, GAZE_M, GAZE_POINTS = 1.3, 0.75, 0.6, 10
FIRST_SEEN_M = (1.2, 2.0, 3.0, 4.5, 6.5)
TABLE_M, SPECK_M, SPECK_FROM_M = (0.8, 1.2), (0.12, 0.12), 5.0
CONTEXT = SearchContext(
    "gain",
    (
        SearchClass("table", Role.START_RECEPTACLE, 0.3),
        SearchClass("mug", Role.OBJECT, 0.3),
    ),
)

Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # low, high
ROOM: tuple[Box, ...] = (((-20, -20, -0.1), (20, 20, 0)), ((8, -20, 0), (8.1, 20, 3)))


@dataclass(frozen=True)
class FirstView:
    """Terms of a thing after one view of it."""

    thing: str
    from_m: float
    class_score: float
    gain: Gain

    def worth(self, norm: GainNorm) -> float:
        """S·IG of eq. 10."""
        return self.class_score * normalised_gain(self.gain, norm)


def first_views(settings: ObjectMapSettings) -> list[FirstView]:
    """The table from every distance, nearest first, and then the speck."""
    table = [first_view("table", TABLE_M, away_m, settings) for away_m in FIRST_SEEN_M]
    return [*table, first_view("speck", SPECK_M, SPECK_FROM_M, settings)]


def first_view(
    thing: str, size_m: tuple[float, float], away_m: float, settings: ObjectMapSettings
) -> FirstView:
    """Terms of a flat thing at the origin after one view from `away_m`."""
    x, y = size_m[0] / 2, size_m[1] / 2
    box: Box = ((-x, -y, TOP_M - 0.05), (x, y, TOP_M))
    objects = ObjectMap(settings)
    objects.update(_seen((*ROOM, box), _facing(-away_m, 0.0)), CONTEXT)
    (instance,) = objects.objects()
    angles = np.arange(GAZE_POINTS) * 2 * math.pi / GAZE_POINTS
    places = [((x + GAZE_M) * math.cos(a), (y + GAZE_M) * math.sin(a)) for a in angles]
    c = CAMERA
    views = [View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, _facing(*p)) for p in places]
    answer = objects.what_if(instance.id, instance.class_name, views)
    assert answer is not None
    joint = answer[1]
    area_m2 = objects.seen_area_m2(instance.id)
    gain = Gain(joint.information_gain, instance.gaussians, area_m2, joint.pixels)
    return FirstView(thing, away_m, instance.class_score, gain)


def _facing(x_m: float, y_m: float) -> NDArray[np.float64]:
    """T_world_cam of a camera over (x, y) that faces the top of a thing at the origin."""
    away_m = math.hypot(x_m, y_m)
    base = se2_to_se3(x_m, y_m, math.atan2(-y_m, -x_m))
    return camera_on_base(base, EYE_M, math.atan2(EYE_M - TOP_M, away_m))


def _seen(boxes: Sequence[Box], T_world_cam: NDArray[np.float64]) -> Observation:
    """Observation of a perfect detector; the last box is the table."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(float)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], -1)
    rays = rays @ T_world_cam[:3, :3].T  # the distance along them is the depth
    depth, mask = np.full(u.shape, np.inf), np.zeros(u.shape, bool)
    for low, high in boxes:
        with np.errstate(divide="ignore"):
            a, b = ((np.array(end) - T_world_cam[:3, 3]) / rays for end in (low, high))
        near, far = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
        hit = (near < far) & (near > 0) & (near < depth)
        depth[hit], mask = near[hit], (mask & ~hit) | (hit if (low, high) == boxes[-1] else False)
    rows, columns = np.nonzero(mask)
    box = int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1
    depth_m = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    color = np.full((*depth.shape, 3), 128, np.uint8)
    frame = Frame(FrameId("study", 0, 0), 0, True, color, depth_m, CAMERA, T_world_cam, np.eye(4))
    return Observation(frame, CONTEXT.id, (Detection("table", 0.9, box, mask),), {}, "truth")


def table(views: Sequence[FirstView]) -> str:
    """Markdown table: one column for each first view, and the order that each gain_norm gives."""
    heads = [f"{v.thing}, {v.from_m:g} m" for v in views]
    lines = [f"| first seen | {' | '.join(heads)} |", "|---|" + "--:|" * len(views)]

    def line(name: str, values: Sequence[str]) -> None:
        lines.append(f"| {name} | {' | '.join(values)} |")

    line("Gaussians", [f"{v.gain.gaussians}" for v in views])
    line("seen area, m²", [f"{v.gain.area_m2:.2f}" for v in views])
    line("expected pixels", [f"{v.gain.pixels:.0f}" for v in views])
    line("IG, nats", [f"{v.gain.nats:.0f}" for v in views])
    for norm in NORMS:
        first = views[0].worth(norm)
        line(f"S·IG, {norm}", [f"{v.worth(norm) / first:.3g}" for v in views])
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.gain_norms",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--expected-label",
        choices=("one-hot", "rendered"),
        default="one-hot",
        help="setting of the object map",
    )
    given = parser.parse_args(arguments)
    print(table(first_views(ObjectMapSettings(expected_label=given.expected_label))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
