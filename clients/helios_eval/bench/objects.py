"""The object map against a plain torch tile rasteriser on both cores."""

from __future__ import annotations

import numpy as np
from helios_core.geometry import camera_on_base, lift_pixels, se2_to_se3
from helios_core.types import Detection, Frame, Observation, Role, SearchClass, SearchContext
from helios_objectmap import splat
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.view import View
from numpy.typing import NDArray

from helios_eval.bench.scene import CAMERA, FRAMES, frames
from helios_eval.bench.timing import Row, compare

CHANNELS = 12
PEER = "plain torch tile rasteriser"


def view_of(T_world_cam: NDArray[np.float64]) -> View:
    c = CAMERA
    return View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, T_world_cam)


def gaussians_in_view(n: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """n surface points of the first frame, and their radii, metres."""
    frame, rng = frames()[0], np.random.default_rng(0)
    points = lift_pixels(frame.depth_m, CAMERA, frame.T_world_cam).reshape(-1, 3)
    chosen = rng.choice(np.flatnonzero(np.isfinite(points[:, 0])), n, replace=n > 200_000)
    depth = frame.depth_m.ravel()[chosen]
    spacing = np.sqrt(CAMERA.width * CAMERA.height / n)
    radius = depth / CAMERA.fx * spacing * 0.6
    return points[chosen].astype(np.float32), radius.astype(np.float32)


def render(n: int = 50_000) -> Row:
    import torch

    from helios_eval.bench import torch_raster

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
        projection = splat.project(means, radius, opacity, view)
        return splat.render(projection, features[projection.rows]).features

    def peer(_: int) -> torch.Tensor:
        with torch.no_grad():
            return torch_raster.render(
                points, radii, opacities, everything, T, c.fx, c.cx, c.cy, c.width, c.height
            )

    # near-equal depths may be ordered differently in float32: a few pixels of 300 thousand
    difference = np.abs(ours(0) - peer(0)[1:].numpy())
    if difference.mean() > 1e-4 or (difference > 0.02).mean() > 1e-3:
        raise AssertionError("the two rasterisers draw different pictures: not the same work")
    return compare("render", f"{CHANNELS} channels, 640x480, {n} Gaussians", ours, PEER, peer, 5)


CONTEXT = SearchContext(
    "bench",
    (SearchClass("table", Role.START_RECEPTACLE, 0.3), SearchClass("mug", Role.OBJECT, 0.3)),
)


def observation(frame: Frame, seq: int) -> Observation:
    """Everything between 0.3 and 1.7 m up is a table; a strip of it is a mug."""
    height = lift_pixels(frame.depth_m, CAMERA, frame.T_world_cam)[..., 2]
    with np.errstate(invalid="ignore"):
        table = (height > 0.3) & (height < 1.7)
    mug = table.copy()
    mug[:, :300] = mug[:, 340:] = False
    whole = (0, 0, CAMERA.width, CAMERA.height)
    found = tuple(Detection(n, 0.9, whole, m) for n, m in (("table", table), ("mug", mug)))
    return Observation(frame, "bench", found, {}, "bench")


def object_update() -> Row:
    """A whole update: render, create, accumulate, cluster. Peer: two renders of as many."""
    seen = [observation(f, i) for i, f in enumerate(frames())]
    objects = ObjectMap(ObjectMapSettings())
    for o in seen:
        objects.update(o, CONTEXT)
    held = objects.gaussians()
    count = len(held.means)
    peer, size = _torch_renders(held.means.astype(np.float32), stride=2, times=2)
    return compare(
        "object_update", f"{count} Gaussians in the map, {size}",
        lambda i: objects.update(seen[i % FRAMES], CONTEXT), f"{PEER}, two passes", peer, 5,
    )  # fmt: skip


def view_scores(poses: int = 16) -> Row:
    """What-if scores of candidate views of one object. Peer: one render each."""
    objects = ObjectMap(ObjectMapSettings())
    objects.update(observation(frames()[0], 0), CONTEXT)
    target = max(objects.objects(), key=lambda o: o.gaussians)
    means = objects.gaussians(target.id).means.astype(np.float32)
    views = []
    for k in range(poses):
        base = se2_to_se3(0.8, 0.2 * (k - poses / 2), 0.02 * k)
        views.append(view_of(camera_on_base(base, 1.31, 0.4)))
    peer, size = _torch_renders(means, stride=2, times=poses)
    return compare(
        "view_scores", f"{poses} views of {target.gaussians} Gaussians, {size}",
        lambda _: objects.what_if(target.id, target.class_name, views), PEER, peer, 3,
    )  # fmt: skip


def _torch_renders(means: NDArray[np.float32], stride: int, times: int):
    """A function that renders `means` with 3 channels `times` times at our working resolution."""
    import torch

    from helios_eval.bench import torch_raster

    view = view_of(frames()[0].T_world_cam).strided(stride)
    radius = torch.full((len(means),), 0.006)
    points, opacity = torch.from_numpy(np.ascontiguousarray(means)), torch.full((len(means),), 0.99)
    features = torch.ones(len(means), 3)
    T = torch.from_numpy(view.T_cam_world.astype(np.float32))

    def run(_: int) -> None:
        with torch.no_grad():
            for _ in range(times):
                torch_raster.render(points, radius, opacity, features, T, view.fx, view.cx, view.cy,
                                    view.width, view.height)  # fmt: skip

    return run, f"{view.width}x{view.height}"
