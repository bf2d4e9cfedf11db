"""Base placement: poses from which to look at a candidate, to pick, or to place.

Gaze points are the paper's (section 3.2, local search): reachable places around a candidate from
which its centre is in sight. Poses to pick and to place are rated by path and clearance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.geometry import Matrix, camera_on_base
from helios_core.types import ObjectInstance, RobotDescription
from numpy.typing import NDArray

from helios_planner.motion_planning import kernels
from helios_planner.motion_planning.costmap import GroundMap, Pose2, corner_of, facing
from helios_planner.motion_planning.path_planner import Reach

REACH_SPARE_M = 0.06  # part of the robot's reach that base placement leaves unused
ON_TOP_M = 0.15  # nothing else stands within this distance of an object
OTHER_SIDE_M = 0.4  # least distance of a new pose from one that failed
ON_SHELF_M = 0.45  # from a shelf's edge to an object at its back
SURFACE_M = 0.04  # a flat spot this far above a receptacle's surface is the top of another thing
_HEIGHT_STEP_M = 0.02


@dataclass(frozen=True)
class GazeRules:
    """Rules for gaze points, lengths in metres. They lie on contours at `distances_m` around the
    candidate's ground projection, `spacing_m` apart. There is none where something above
    `block_height_m`, or above the line of sight, stands between; objects within `near_m` of the
    candidate are part of it."""

    distances_m: tuple[float, ...]
    spacing_m: float
    block_height_m: float = 1.25
    near_m: float = 0.15
    aim_at_top: bool = False  # else between the candidate's top and centre


@dataclass(frozen=True)
class GazePoint:
    """Pose of the base and tilt of the head; positive tilt looks down."""

    pose: Pose2
    tilt_rad: float
    arrival: float  # arrival time in cells at full speed, from the robot's present pose

    def T_world_cam(self, robot: RobotDescription) -> Matrix:
        """Camera pose [4, 4] at the gaze point."""
        return camera_on_base(
            self.pose.T_world_base, robot.camera_height_m, self.tilt_rad, robot.camera_forward_m
        )


def outline_of(candidate: ObjectInstance) -> NDArray[np.float64]:
    """Ground projection [n, 2] of a candidate: its hull, or its box if the hull is too small."""
    if len(candidate.outline_m) >= 3:
        return np.asarray(candidate.outline_m, float)
    half = np.maximum(candidate.size_m[:2] / 2, 0.03)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    return candidate.center_m[:2] + corners * half


def outline_mask(ground: GroundMap, outline_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Mask [h, w] with 1 in the cells under an outline [n, 2]."""
    mask = np.zeros(ground.occupancy.shape, np.uint8)
    corners = np.rint(ground.exact_cells_of(outline_m)[:, ::-1] - 0.5).astype(np.int32)
    cv2.fillPoly(mask, [corners.reshape(-1, 1, 2)], 1)
    return mask


def tilt_towards(distance_m: float, height_m: float, robot: RobotDescription) -> float:
    """Tilt (rad) that centres a point ahead of the base at that distance and height, within
    the head's range."""
    ahead_m = max(distance_m - robot.camera_forward_m, 0.05)
    tilt = math.atan2(robot.camera_height_m - height_m, ahead_m)
    low, high = robot.tilt_range_rad
    return float(np.clip(tilt, low, high))


def eye_of(pose: Pose2, robot: RobotDescription) -> tuple[float, float]:
    """Position of the camera over the ground (x, y) for a pose of the base."""
    return (
        pose.x_m + robot.camera_forward_m * math.cos(pose.yaw_rad),
        pose.y_m + robot.camera_forward_m * math.sin(pose.yaw_rad),
    )


def in_sight(
    ground: GroundMap,
    eye_xy: tuple[float, float],
    eye_z_m: float,
    target_m: Sequence[float] | NDArray[np.float64],
    near_m: float,
    block_height_m: float,
) -> bool:
    """True if no known obstacle stands between an eye and a point (world x, y, z)."""
    (r0, c0), (r1, c1) = ground.exact_cells_of(np.array([eye_xy, target_m[:2]]))
    return not kernels.hidden_along(
        ground.top_m,
        r0,
        c0,
        eye_z_m,
        r1,
        c1,
        float(target_m[2]),
        near_m / ground.cell_m,
        block_height_m,
    )


def gaze_points(
    candidate: ObjectInstance, reached: Reach, robot: RobotDescription, rules: GazeRules
) -> list[GazePoint]:
    """Gaze points around a candidate (paper, section 3.2), shortest path first: free and reachable
    poses that face the middle of its ground projection and have its highest point in sight."""
    ground = reached.ground
    outline = outline_of(candidate)
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    top_m = float(max(candidate.top_m, candidate.center_m[2]))
    extent_m = float(np.hypot(*(outline - middle).T).max())
    farthest = max(rules.distances_m) + extent_m + 0.2
    near = ground.window_at(middle, farthest)
    part = ground.part(near)
    if part.occupancy.size == 0:
        return []
    mask = outline_mask(part, outline)
    if not mask.any():
        return []
    away_m = cv2.distanceTransform((mask == 0).astype(np.uint8), cv2.DIST_L2, 5) * ground.cell_m
    arrival = reached.arrival[near]
    chosen: list[GazePoint] = []
    for wanted_m in rules.distances_m:
        on_contour = (np.abs(away_m - wanted_m) <= 0.75 * ground.cell_m) & np.isfinite(arrival)
        cells = np.argwhere(on_contour)
        if not len(cells):
            continue
        cells = cells[np.argsort(arrival[cells[:, 0], cells[:, 1]], kind="stable")]
        for (row, column), (x_m, y_m) in zip(cells, part.centres_of(cells), strict=True):
            if any(g.pose.distance_m((x_m, y_m)) < rules.spacing_m for g in chosen):
                continue
            target = (*middle, top_m)
            pose = facing(float(x_m), float(y_m), middle)
            seen = in_sight(
                ground,
                eye_of(pose, robot),
                robot.camera_height_m,
                target,
                extent_m + rules.near_m,
                rules.block_height_m,
            )
            if not seen or not reached.fits(pose):
                continue
            distance_m = pose.distance_m(middle)
            tilt_rad = tilt_towards(distance_m, top_m, robot)
            if not rules.aim_at_top:
                tilt_rad += tilt_towards(distance_m, float(candidate.center_m[2]), robot)
                tilt_rad /= 2
            chosen.append(GazePoint(pose, tilt_rad, float(arrival[row, column])))
    return sorted(chosen, key=lambda g: g.arrival)


@dataclass(frozen=True)
class PlaceRules:
    """Rules for placing points, lengths in metres."""

    inset_m: float
    flat_m: float
    patch_m: float = 0.10  # side of the patch that must be flat
    spacing_m: float = 0.08
    best_inset_m: float = 0.22
    on_things: bool = True  # also on top of what lies on the receptacle, such as a cushion


@dataclass(frozen=True)
class AheadRules:
    """The region ahead of the robot in which the paper's rule looks for the highest point."""

    reach_m: float
    half_width_m: float = 0.2
    above_m: float = 0.3  # anything higher above the receptacle's top is a wall behind it


@dataclass(frozen=True)
class Spot:
    """Placing point (world, on the surface) and the pose from which it is in reach."""

    point_m: tuple[float, float, float]
    stand: Pose2
    inset_m: float


def stand_for(
    target_m: Sequence[float] | NDArray[np.float64],
    reached: Reach,
    robot: RobotDescription,
    reach_m: float,
    tried: Sequence[tuple[float, float]] = (),
    near_m: float = ON_TOP_M,
    tried_m: float = 0.2,
) -> Pose2 | None:
    """Reachable pose within `reach_m` of a point (world x, y, z) that faces and sees it and is not
    near a tried one: short path, wide clearance. None if there is none. near_m: distance from the
    point within which nothing hides it."""
    ground = reached.ground
    near = ground.window_at(target_m, reach_m)
    cells = np.argwhere(np.isfinite(reached.arrival[near])) + corner_of(near)
    if not len(cells):
        return None
    xy = ground.centres_of(cells)
    away = np.hypot(xy[:, 0] - target_m[0], xy[:, 1] - target_m[1])
    fits = away <= reach_m
    for x_m, y_m in tried:
        fits &= np.hypot(xy[:, 0] - x_m, xy[:, 1] - y_m) > tried_m
    cells, xy = cells[fits], xy[fits]
    cost = reached.arrival[cells[:, 0], cells[:, 1]] * ground.cell_m - 2.0 * np.minimum(
        reached.slack[cells[:, 0], cells[:, 1]], 0.1
    )
    for k in np.argsort(cost, kind="stable")[:400:4]:
        pose = facing(float(xy[k, 0]), float(xy[k, 1]), (float(target_m[0]), float(target_m[1])))
        eye = eye_of(pose, robot)
        seen = in_sight(ground, eye, robot.camera_height_m, target_m, near_m, robot.height_m)
        if seen and reached.fits(pose):
            return pose
    return None


def place_spots(
    receptacle: ObjectInstance,
    reached: Reach,
    reach_m: float,
    rules: PlaceRules,
    not_from: Sequence[tuple[float, float]] = (),
) -> list[Spot]:
    """Flat spots on a receptacle in reach of a possible pose, best first: well inside the edge,
    then a short path. Empty if no surface was seen or none is in reach. not_from: positions from
    which placing failed (x, y in m)."""
    ground = reached.ground
    outline = outline_of(receptacle)
    centre, extent = outline.mean(axis=0), float(np.ptp(outline, axis=0).max())
    near = ground.window_at(centre, extent + reach_m + 0.3)
    part, (r0, c0) = ground.part(near), corner_of(near)
    if part.occupancy.size == 0:
        return []
    inset = _flat_inset_m(part, receptacle, outline, rules)
    arrival = reached.arrival[near]
    stands = np.argwhere(np.isfinite(arrival))
    stand_xy = part.centres_of(stands)
    for x_m, y_m in not_from:
        other = np.hypot(stand_xy[:, 0] - x_m, stand_xy[:, 1] - y_m) > OTHER_SIDE_M
        stands, stand_xy = stands[other], stand_xy[other]
    if not len(stands):
        return []
    way_m = arrival[stands[:, 0], stands[:, 1]] * ground.cell_m
    spots: list[tuple[float, Spot]] = []
    step = max(1, round(rules.spacing_m / ground.cell_m))
    for row, column in np.argwhere(inset >= rules.inset_m):
        if (row + r0) % step or (column + c0) % step:  # the same grid for every window
            continue
        x_m, y_m = part.centres_of(np.array([[row, column]]))[0]
        away = np.hypot(stand_xy[:, 0] - x_m, stand_xy[:, 1] - y_m)
        in_reach = np.flatnonzero(away <= reach_m)
        if not len(in_reach):
            continue
        stand = _nearest_that_fits((x_m, y_m), stand_xy, way_m, in_reach, reached)
        if stand is None:
            continue
        pose, way = stand
        flat_m = min(rules.patch_m, float(inset[row, column]) - ground.cell_m)
        z_m = _top_around_m(part, int(row), int(column), flat_m)
        depth = min(float(inset[row, column]), rules.best_inset_m)
        spot = Spot((float(x_m), float(y_m), z_m), pose, float(inset[row, column]))
        spots.append((-10 * depth + 0.2 * way, spot))
    return [spot for _, spot in sorted(spots, key=lambda pair: pair[0])]


def _nearest_that_fits(
    target: tuple[float, float],
    xy: NDArray[np.float64],
    way_m: NDArray[np.float32],
    in_reach: NDArray[np.integer],
    reached: Reach,
) -> tuple[Pose2, float] | None:
    """Pose at one of the places that faces the target, by the shortest path, and
    that path's length."""
    for k in in_reach[np.argsort(way_m[in_reach], kind="stable")][:200:10]:
        pose = facing(float(xy[k, 0]), float(xy[k, 1]), target)
        if reached.fits(pose):
            return pose, float(way_m[k])
    return None


def highest_ahead(
    receptacle: ObjectInstance, ground: GroundMap, robot: Pose2, rules: AheadRules
) -> tuple[float, float, float] | None:
    """Highest point (world x, y, z) of a receptacle in a region ahead of the robot, by the paper's
    rule; None if nothing of it was seen there."""
    mask = outline_mask(ground, outline_of(receptacle))
    on_it = (ground.top_m > 0) & (ground.top_m <= receptacle.top_m + rules.above_m)
    cells = np.argwhere((mask != 0) & on_it)
    if not len(cells):
        return None
    xy = ground.centres_of(cells)
    c, s = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
    ahead, left = ((xy - robot.xy) @ np.array([[c, -s], [s, c]])).T
    here = (ahead > 0) & (np.abs(left) <= rules.half_width_m)
    here &= np.hypot(ahead, left) <= rules.reach_m
    if not here.any():
        return None
    top = np.where(here, ground.top_m[cells[:, 0], cells[:, 1]], -np.inf)
    k = int(np.argmax(top))
    return float(xy[k, 0]), float(xy[k, 1]), float(top[k])


def edge_spot(
    receptacle: ObjectInstance, stand: Pose2, inset_m: float
) -> tuple[float, float, float]:
    """Placing point without a seen surface: the point of the outline nearest to the robot, moved
    `inset_m` towards the middle, at the receptacle's height."""
    outline = outline_of(receptacle)
    middle = outline.mean(axis=0)
    ends = np.roll(outline, -1, axis=0)
    share = np.linspace(0, 1, 20)[:, None, None]
    points = (outline + share * (ends - outline)).reshape(-1, 2)
    nearest = points[np.argmin(np.hypot(*(points - stand.xy).T))]
    inward = middle - nearest
    inward /= max(float(np.hypot(*inward)), 1e-6)
    x_m, y_m = nearest + inward * inset_m
    return float(x_m), float(y_m), float(receptacle.top_m)


def _flat_inset_m(
    part: GroundMap,
    receptacle: ObjectInstance,
    outline: NDArray[np.float64],
    rules: PlaceRules,
) -> NDArray[np.float32]:
    """Distance [h, w] (m) of each flat cell of the receptacle to the next cell that is not flat."""
    mask = outline_mask(part, outline)
    n = max(1, round(rules.patch_m / part.cell_m / 2))
    kernel = np.ones((2 * n + 1, 2 * n + 1), np.uint8)
    # Fill holes of a cell or two: one noisy cell must not end a surface.
    top = cv2.morphologyEx(part.top_m, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    rough = cv2.dilate(top, kernel) - cv2.erode(top, kernel)
    flat = (mask != 0) & (top > 0.05) & (top <= receptacle.top_m + 0.15) & (rough <= rules.flat_m)
    if not rules.on_things and flat.any():
        flat &= top <= surface_height_m(top[flat]) + SURFACE_M
    # The patch around a cell is flat too, so the flat part itself ends n cells further out.
    out = cv2.distanceTransform(flat.astype(np.uint8), cv2.DIST_L2, 5) * part.cell_m
    out[flat] += n * part.cell_m
    return out.astype(np.float32)


def surface_height_m(heights_m: NDArray[np.floating | np.integer]) -> float:
    """Height that most of the flat cells have, from the heights [n] of at least one cell."""
    steps = np.rint(heights_m / _HEIGHT_STEP_M).astype(np.int64)
    counts = np.convolve(np.bincount(steps), np.ones(3))[1:-1]  # neighbouring heights count too
    most = int(np.argmax(counts))
    return float(np.median(heights_m[np.abs(steps - most) <= 1]))


def top_at_m(ground: GroundMap, xy_m: tuple[float, float], radius_m: float) -> float:
    """Greatest height (m) seen around a point (world x, y); 0 without any, also beyond the map."""
    row, column = ground.cells_of(np.array([xy_m]))[0]
    rows, columns = ground.occupancy.shape
    if not (0 <= row < rows and 0 <= column < columns):
        return 0.0
    return _top_around_m(ground, int(row), int(column), radius_m)


def _top_around_m(part: GroundMap, row: int, column: int, radius_m: float) -> float:
    n = max(1, int(radius_m / part.cell_m + 1e-6))
    return float(
        part.top_m[max(0, row - n) : row + n + 1, max(0, column - n) : column + n + 1].max()
    )


def nearest_to(
    point_m: NDArray[np.float64], things: Sequence[ObjectInstance], within_m: float
) -> ObjectInstance | None:
    """Instance whose centre is nearest to a point, within `within_m` in the plane; else None."""
    near = [t for t in things if math.dist(t.center_m[:2], point_m[:2]) <= within_m]
    return min(near, key=lambda t: math.dist(t.center_m[:2], point_m[:2]), default=None)


def near_outline(receptacle: ObjectInstance, point_m: np.ndarray, within_m: float) -> bool:
    """True if a point lies over a receptacle's ground projection, or within `within_m` of it."""
    hull = outline_of(receptacle).astype(np.float32).reshape(-1, 1, 2)
    return cv2.pointPolygonTest(hull, (float(point_m[0]), float(point_m[1])), True) >= -within_m
