"""Benchmarks of the 2D maps, against OpenCV and numpy on whole arrays."""

from __future__ import annotations

import math

import cv2
import numpy as np
from helios_core.types import Frame
from helios_map2d.camera_view import View, view_of
from helios_map2d.grid import GridSpec, TileMask
from helios_map2d.layers.explored_area import ExploredArea
from helios_map2d.layers.frontiers import FrontierFinder, FrontierRules
from helios_map2d.layers.occupancy import OccupancyLayer, OccupancyRules
from helios_map2d.layers.reachability import ReachableFloor
from helios_map2d.layers.value_layers import ValueLayers, ValueRules, cone_of
from numpy.typing import NDArray

from helios_eval.bench.synthetic_flat import FRAMES, frames
from helios_eval.bench.timing import Row, compare

CELLS = 2000
CELL_M = 0.025
MIN_M, MAX_M = 0.1, 5.0
BAND_M = (0.10, 1.50)


def grid() -> GridSpec:
    """Square grid of `CELLS` by `CELLS` cells of `CELL_M` metres around the world's origin."""
    return GridSpec.centred_on(0.0, 0.0, CELL_M, CELLS)


def project_frame(frame: Frame, on: GridSpec) -> View:
    """Projection of a frame's depth between `MIN_M` and `MAX_M` metres onto the cells of a grid."""
    return view_of(frame.depth_m, frame.camera, frame.T_world_cam, on, MIN_M, MAX_M)


def cell_polygon(frame: Frame) -> NDArray[np.int32]:
    """Corners (cells) of the floor that a frame shows: the camera, and the farthest point of every
    eighth image column."""
    depth = np.where((frame.depth_m > MIN_M) & (frame.depth_m < MAX_M), frame.depth_m, 0)
    reach = depth.max(axis=0)
    u = np.arange(0, frame.camera.width, 8)
    rays = np.stack([(u - frame.camera.cx) / frame.camera.fx, np.zeros(len(u)), np.ones(len(u))], 1)
    points = (rays * reach[u, None]) @ frame.T_world_cam[:3, :3].T + frame.T_world_cam[:3, 3]
    corners = np.vstack([frame.T_world_cam[:2, 3], points[:, :2]])
    return (corners / CELL_M + CELLS / 2).astype(np.int32)


class PeerMaps:
    """Simple peer: projects all pixels, counts hits per cell, and fills the field of view."""

    def __init__(self) -> None:
        shape = (CELLS, CELLS)
        self.hits = np.zeros(shape, np.int32)
        self.explored = np.zeros(shape, np.uint8)
        self.occupied = np.zeros(shape, np.uint8)
        self.values = np.zeros((2, *shape), np.float32)
        self.confidence = np.zeros(shape, np.float32)

    def occupancy(self, frame: Frame) -> None:
        c = frame.camera
        v, u = np.nonzero((frame.depth_m > MIN_M) & (frame.depth_m < MAX_M))
        z = frame.depth_m[v, u]
        points = np.stack([(u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z], 1)
        world = points @ frame.T_world_cam[:3, :3].T + frame.T_world_cam[:3, 3]
        band = (world[:, 2] >= BAND_M[0]) & (world[:, 2] <= BAND_M[1])
        cells = (world[band, :2] / CELL_M + CELLS / 2).astype(np.int64)
        inside = ((cells >= 0) & (cells < CELLS)).all(axis=1)
        np.add.at(self.hits, (cells[inside, 1], cells[inside, 0]), 1)
        seen = np.zeros((CELLS, CELLS), np.uint8)
        cv2.fillPoly(seen, [cell_polygon(frame)], 1)
        self.explored |= seen
        self.occupied = (self.hits >= 5).astype(np.uint8)

    def value(self, frame: Frame, scores: tuple[float, float]) -> None:
        cone = np.zeros((CELLS, CELLS), np.uint8)
        cv2.fillPoly(cone, [cell_polygon(frame)], 1)
        rows, columns = np.mgrid[0:CELLS, 0:CELLS].astype(np.float32)
        at = frame.T_world_cam[:2, 3] / CELL_M + CELLS / 2
        heading = math.atan2(frame.T_world_cam[1, 2], frame.T_world_cam[0, 2])
        angle = np.arctan2(rows - at[1], columns - at[0]) - heading
        angle = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
        new = 0.25 + 0.75 * np.cos(angle / (frame.camera.hfov_rad / 2) * np.pi / 2) ** 2
        new = np.where(cone > 0, new, 0)
        new[(new < 0.35) & (new < self.confidence)] = 0
        total = self.confidence + new
        with np.errstate(invalid="ignore", divide="ignore"):
            for k, score in enumerate(scores):
                mixed = (self.confidence * self.values[k] + new * score) / total
                self.values[k] = np.where(new > 0, mixed, self.values[k])
            mixed = (self.confidence**2 + new**2) / total
            self.confidence = np.where(new > 0, mixed, self.confidence).astype(np.float32)

    def frontiers(self) -> int:
        free = (self.explored > 0) & (self.occupied == 0)
        unknown = ((self.explored == 0) & (self.occupied == 0)).astype(np.uint8)
        border = cv2.dilate(unknown, np.ones((3, 3), np.uint8)) > 0
        found, _, _, _ = cv2.connectedComponentsWithStats((free & border).astype(np.uint8))
        return int(found)


class OurMaps:
    """Occupancy, explored area and frontiers as the service updates them, without publishing."""

    def __init__(self, cells: int = CELLS) -> None:
        self.grid = GridSpec.centred_on(0.0, 0.0, CELL_M, cells)
        rules = FrontierRules()
        self.layer = OccupancyLayer(self.grid, OccupancyRules())
        self.search = ExploredArea(self.grid)
        self.ground = ReachableFloor(self.grid, rules.robot_radius_m / CELL_M)
        self.finder = FrontierFinder(self.grid, rules)

    def occupancy(self, frame: Frame) -> TileMask:
        """Integrate a frame; return the tiles in which frontiers may have changed."""
        view = project_frame(frame, self.grid)
        box = self.grid.to_local(self.grid.to_world(view.window).tiled)
        at = box.slices
        before = self.layer.occupancy[at].copy()
        self.search.add(self.layer.integrate(view, (0.0, 0.0), 0.3), view.window)
        self.ground.update(self.layer.occupancy, before, box)
        tiles = TileMask.of(self.grid.to_world(box.grown(1)).tiles)
        self.finder.update(self.layer.occupancy, self.search.explored, tiles)
        return tiles


def occupancy_update() -> Row:
    """Milliseconds to integrate one depth image into occupancy, explored area and frontiers."""
    ours, plain = OurMaps(), PeerMaps()
    return compare(
        "occupancy_update",
        f"640x480 depth into {CELLS}x{CELLS} cells",
        lambda i: ours.occupancy(frames()[i % FRAMES]),
        "OpenCV and numpy on whole arrays",
        lambda i: plain.occupancy(frames()[i % FRAMES]),
    )


def value_fusion() -> Row:
    """Milliseconds to integrate the scores of one frame into both value layers."""
    layers, plain, on = ValueLayers(grid(), ValueRules()), PeerMaps(), grid()
    layers.reset(("pick", "place"))
    scores = {"pick": 0.3, "place": 0.6}
    return compare(
        "value_fusion",
        f"2 layers, {CELLS}x{CELLS} cells",
        lambda i: layers.integrate(cone_of(project_frame(frames()[i % FRAMES], on)), scores),
        "OpenCV and numpy on whole arrays",
        lambda i: plain.value(frames()[i % FRAMES], (0.3, 0.6)),
        runs=7,
    )


def frontiers() -> Row:
    """Milliseconds to update and find the frontiers after each frame of the first walk.

    Every frame shows new floor, so no frontier can be reused. The peer searches the map of the
    whole walk.
    """
    ours, plain, walk = OurMaps(), PeerMaps(), []
    for frame in frames():
        tiles = ours.occupancy(frame)
        walk.append((ours.layer.occupancy.copy(), ours.search.explored.copy(), tiles))
        plain.occupancy(frame)
    finder = FrontierFinder(ours.grid, FrontierRules())

    def anew(i: int) -> int:
        if i % FRAMES == 0:
            finder.reset()
        occupancy, explored, tiles = walk[i % FRAMES]
        finder.update(occupancy, explored, tiles)
        return len(finder.find(occupancy, ours.ground, (0.8, 0.0), {}))

    return compare(
        "frontiers",
        f"{CELLS}x{CELLS} cells",
        anew,
        "OpenCV on whole arrays",
        lambda _: plain.frontiers(),
    )
