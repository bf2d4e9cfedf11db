"""Benchmarks of the object map: rendering against a plain torch tile rasteriser, updates and scores
against rendering."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from helios_core.geometry import camera_on_base, lift_pixels, se2_to_se3
from helios_core.types import Detection, Frame, Observation, Role, SearchClass, SearchContext
from helios_objectmap import persistence
from helios_objectmap.camera import View
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.rendering import cpu
from helios_objectmap.settings import ObjectMapSettings
from numpy.typing import NDArray

from helios_eval.bench.synthetic_flat import CAMERA, frames
from helios_eval.bench.timing import Row, compare

CHANNELS = 12
SIZES = (10_000, 50_000, 200_000)
PEER = "plain torch tile rasteriser"
OWN = "our render of 50000, 12 channels, 640x480"


def view_of(T_world_cam: NDArray[np.float64]) -> View:
    """View of the benchmark's camera from a pose [4, 4] in the world, metres."""
    c = CAMERA
    return View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, T_world_cam)


def gaussians_in_view(n: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """n surface points [n, 3] of the first frame and their radii [n], metres."""
    frame, rng = frames()[0], np.random.default_rng(0)
    points = lift_pixels(frame.depth_m, CAMERA, frame.T_world_cam).reshape(-1, 3)
    chosen = rng.choice(np.flatnonzero(np.isfinite(points[:, 0])), n, replace=n > 200_000)
    depth = frame.depth_m.ravel()[chosen]
    spacing = np.sqrt(CAMERA.width * CAMERA.height / n)
    radius = depth / CAMERA.fx * spacing * 0.6
    return points[chosen].astype(np.float32), radius.astype(np.float32)


def render() -> list[Row]:
    """Milliseconds to render 12 channels of 10, 50, 200 thousand Gaussians. Peer: plain torch."""
    return [_render(n) for n in SIZES]


def _render(n: int) -> Row:
    import torch

    from helios_eval.bench import torch_rasterizer

    means, radius = gaussians_in_view(n)
    opacity = np.full(n, 0.9, np.float32)
    features = np.random.default_rng(2).random((n, CHANNELS - 1), np.float32)
    view = view_of(frames()[0].T_world_cam)
    depth = (means @ view.T_cam_world[:3, :3].T.astype(np.float32) + view.T_cam_world[:3, 3])[:, 2:]
    everything = torch.from_numpy(np.hstack([depth, features]).astype(np.float32))
    points, radii, opacities = map(torch.from_numpy, (means, radius, opacity))
    T = torch.from_numpy(view.T_cam_world.astype(np.float32))
    c = CAMERA

    def ours(_: int) -> NDArray[np.float32]:
        projection = cpu.project(means, radius, opacity, view)
        return projection.render(features[projection.rows]).features

    def peer(_: int) -> torch.Tensor:
        with torch.no_grad():
            return torch_rasterizer.render(
                points, radii, opacities, everything, T, c.fx, c.cx, c.cy, c.width, c.height
            )

    # Near-equal depths may sort differently in float32, which changes a few of 300 thousand pixels.
    difference = np.abs(ours(0) - peer(0)[1:].numpy())
    if difference.mean() > 1e-4 or (difference > 0.02).mean() > 1e-3:
        raise AssertionError("the two rasterisers render different images: not the same work")
    return compare("render", f"{CHANNELS} channels, 640x480, {n} Gaussians", ours, PEER, peer, 3)


FIRST, RUNS = 3, 9  # updates before the measured ones; measured updates
COLUMNS = 340  # image columns of the table in updates: about 50 thousand Gaussians in view

CONTEXT = SearchContext(
    "bench",
    (SearchClass("table", Role.START_RECEPTACLE, 0.3), SearchClass("mug", Role.OBJECT, 0.3)),
)


def observation(frame: Frame, columns: int = CAMERA.width) -> Observation:
    """Observation whose first `columns` image columns show a table, and a strip of it a mug."""
    table = frame.depth_m > 0
    table[:, columns:] = False
    mug = table.copy()
    mug[:, :294] = mug[:, 347:] = False
    whole = (0, 0, CAMERA.width, CAMERA.height)
    found = tuple(Detection(n, 0.9, whole, m) for n, m in (("table", table), ("mug", mug)))
    return Observation(frame, "bench", found, {}, "bench")


def shifted_observation(i: int, columns: int) -> Observation:
    """Observation of the first frame from 2 cm beside viewpoint i - 1: always a new viewpoint."""
    frame = frames()[0]
    T = frame.T_world_cam.copy()
    T[:3, 3] += T[:3, 0] * 0.02 * i
    return observation(replace(frame, T_world_cam=T), columns)


def map_after_updates(
    updates: int,
    columns: int = 430,
    evidence: Literal["views", "sides"] = "views",
    renderer: Literal["cpu", "cuda"] = "cpu",
) -> ObjectMap:
    """Map after a number of updates, each from 2 cm beside the last viewpoint.

    columns: image columns of the table.
    """
    objects = ObjectMap(ObjectMapSettings.read(evidence=evidence, renderer=renderer))
    for i in range(updates):
        objects.update(shifted_observation(i, columns), CONTEXT)
    return objects


def tiled_map(objects: ObjectMap, copies: int) -> ObjectMap:
    """Map that holds the scene `copies` times, each copy 15 m beside the last, out of view."""
    arrays = persistence.arrays_of(objects.content(), None)
    header = json.loads(arrays["header"].tobytes())
    most, records = header["next_label"], header["records"]
    header["records"] = {
        int(label) + k * most: record for k in range(copies) for label, record in records.items()
    }
    header["next_label"] = most * copies
    rows = {k: [a] * copies for k, a in arrays.items() if k.startswith("store.")}
    beside = np.array([0, 15, 0], np.float32)
    rows["store.means"] = [arrays["store.means"] + beside * np.float32(k) for k in range(copies)]
    label = arrays["store.instance"]
    rows["store.instance"] = [
        np.where(label > 0, label + k * most, 0).astype(np.int32) for k in range(copies)
    ]
    arrays |= {k: np.concatenate(parts) for k, parts in rows.items()}
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    out = ObjectMap(ObjectMapSettings.read())
    out.load_content(persistence.read(persistence.to_bytes(arrays), out.empty_viewpoints()).content)
    out.set_context(CONTEXT)
    return out


def our_render(n: int = 50_000) -> Callable[[int], object]:
    """Render of 12 channels at 640x480, the peer of updates and scores."""
    means, radius = gaussians_in_view(n)
    opacity = np.full(n, 0.9, np.float32)
    features = np.random.default_rng(2).random((n, CHANNELS - 1), np.float32)
    view = view_of(frames()[0].T_world_cam)

    def run(_: int) -> object:
        projection = cpu.project(means, radius, opacity, view)
        return projection.render(features[projection.rows])

    return run


def object_update() -> list[Row]:
    """Milliseconds for a whole update and a query of all objects.

    An update renders, carves, creates, accumulates and clusters.

    Peers: our own render of 50 thousand Gaussians; for a map ten times as large, the update of the
    small map; for evidence by viewing sectors ("sides"), the update with evidence by views. Every
    update is from a new viewpoint.
    """
    small, alone, again = map_after_updates(FIRST, COLUMNS), UpdateSequence(), UpdateSequence()
    copy, large = tiled_map(small, 1), tiled_map(small, 10)
    times = compare("object_update", "", alone.updates(small), OWN, our_render(), RUNS)
    beside = f"with {len(copy)} in the map"
    more = compare(
        "object_update", "", again.updates(large), beside, UpdateSequence().updates(copy), RUNS
    )
    views, sides = map_after_updates(FIRST, COLUMNS), map_after_updates(FIRST, COLUMNS, "sides")
    beside = "with evidence by views"
    by_sides = compare(
        "object_update",
        "evidence by sides",
        UpdateSequence().updates(sides),
        beside,
        UpdateSequence().updates(views),
        RUNS,
    )
    return [
        replace(
            times, size=f"{len(small)} Gaussians in the map at the end, {alone.median} in view"
        ),
        replace(more, size=f"{len(large)} Gaussians in the map at the end, {again.median} in view"),
        by_sides,
    ]


class UpdateSequence:
    """Updates of a map from successive viewpoints, and the number of Gaussians in view of each."""

    def __init__(self) -> None:
        self._in_view: list[int] = []

    @property
    def median(self) -> int:
        return round(statistics.median(self._in_view))

    def updates(self, objects: ObjectMap) -> Callable[[int], object]:
        steps = [shifted_observation(FIRST + i, COLUMNS) for i in range(RUNS + 1)]

        def update(i: int) -> object:
            self._in_view.append(objects.update(steps[i], CONTEXT).in_view)
            return objects.objects()

        return update


def view_scores(poses: int = 16) -> Row:
    """Milliseconds for the what-if scores of candidate views of one object, in one call.

    The object has about 5000 Gaussians.
    """
    objects = map_after_updates(3)
    target = min(objects.objects(), key=lambda o: abs(o.gaussians - 5000))
    views = []
    for k in range(poses):
        base = se2_to_se3(0.8, 0.2 * (k - poses / 2), 0.02 * k)
        views.append(view_of(camera_on_base(base, 1.31, 0.4)))
    return compare(
        "view_scores",
        f"{poses} views of {target.gaussians} Gaussians",
        lambda _: objects.what_if(target.id, target.class_name, views),
        OWN,
        our_render(),
        9,
    )
