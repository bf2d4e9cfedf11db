"""A small fake home as services report it: its map, its objects, a decision. Deterministic."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import cv2
import numpy as np
from helios_core import proto as pb

CELL_M = 0.05
WALLS_M = (  # x0, y0, x1, y1
    (0, 0, 9, 0.1),
    (0, 6.9, 9, 7),
    (0, 0, 0.1, 7),
    (8.9, 0, 9, 7),
    (4.4, 0, 4.5, 2.4),
    (4.4, 3.4, 4.5, 7),
    (0, 3.8, 1.6, 3.9),
    (2.6, 3.8, 4.5, 3.9),
    (4.5, 3.8, 6.2, 3.9),
    (7.2, 3.8, 9, 3.9),
)
FURNITURE_M = (
    (1.2, 1.2, 2.2, 1.8),
    (0.1, 0.8, 0.9, 2.4),
    (6.0, 0.1, 8.9, 0.7),
    (6.2, 1.9, 7.6, 2.9),
    (0.4, 5.0, 2.4, 6.9),
    (7.6, 5.2, 8.9, 6.0),
)


def gaussians(found: Sequence[pb.ObjectInstance]) -> pb.GaussiansReply:
    """Fill the boxes of the objects evenly with Gaussians."""
    rng = np.random.default_rng(0)
    names = ["other", *sorted({one.class_name for one in found})]
    means, instances, concentrations = [], [], []
    for one in found:
        center, size = ([v.x, v.y, v.z] for v in (one.center_m, one.size_m))
        means.append(rng.uniform(-0.5, 0.5, (one.gaussians, 3)) * size + center)
        instances += [one.id] * one.gaussians
        row = np.ones(len(names))
        row[names.index(one.class_name)] += 0.5 * one.views
        concentrations.append(np.tile(row, (one.gaussians, 1)))
    n = len(instances)
    shades = rng.integers(60, 220, (n, 3))
    return pb.GaussiansReply(
        count=n,
        means_m=np.concatenate(means).astype("<f4").tobytes(),
        scales_m=np.full(n, 0.02, "<f4").tobytes(),
        colors=shades.astype(np.uint8).tobytes(),
        instances=np.array(instances, "<u4").tobytes(),
        class_names=names,
        concentration=np.concatenate(concentrations).astype("<f4").tobytes(),
        opacities=np.full(n, 0.9, "<f4").tobytes(),
    )


def picture_jpeg(tone: int) -> bytes:
    """Encode a small camera image, as map2d stores one per view."""
    _, jpeg = cv2.imencode(".jpg", np.full((180, 320, 3), (90, 60 + tone, 150), np.uint8))
    return jpeg.tobytes()


def description() -> pb.RobotDescription:
    return pb.RobotDescription(
        name="stretch", footprint_radius_m=0.18, height_m=1.41, camera_height_m=1.31,
        camera=pb.Pinhole(fx=520, fy=520, cx=319.5, cy=239.5, width=640, height=480),
        reach_m=0.8, max_depth_m=5.0, can_move=True, can_pick=True, can_place=True, simulated=True,
        max_forward_m=1.0, max_turn_rad=1.0,
    )  # fmt: skip


def thing(
    id: int,
    name: str,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    score: float,
    views: int,
) -> pb.ObjectInstance:
    """Make an instance of the object map with a rectangular outline."""
    (x, y, _), (w, d, _) = center, size
    outline = [x - w / 2, y - d / 2, x + w / 2, y - d / 2, x + w / 2, y + d / 2, x - w / 2,
               y + d / 2]  # fmt: skip
    return pb.ObjectInstance(
        id=id, class_name=name, center_m=pb.Vector3(x=center[0], y=center[1], z=center[2]),
        size_m=pb.Vector3(x=size[0], y=size[1], z=size[2]), score=score,
        class_score=min(score + 0.08, 1.0), uncertainty=0.08, views=views, gaussians=40 * views,
        probabilities={name: min(score + 0.08, 1.0), "other": max(0.92 - score, 0.0)},
        top_m=center[2] + size[2] / 2, outline_m=outline, detection_rate=0.8,
    )  # fmt: skip


def decision(index: int) -> pb.Decision:
    """Make a global search decision over two tables and two frontiers."""
    rows = [
        ("receptacle", "coffee table 2", (1.7, 1.5), 0.68, 0.74, 1.6, True),
        ("frontier", "frontier 12", (4.5, 2.9), 0.41, 0.42, 1.5, False),
        ("frontier", "frontier 15", (2.1, 3.9), 0.22, 0.23, 2.0, False),
        ("receptacle", "dining table 5", (6.9, 2.4), 0.31, 0.19, 3.8, False),
    ]
    candidates = [
        pb.Candidate(
            kind=kind,
            name=name,
            position_m=pb.Vector3(x=x, y=y),
            chosen=chosen,
            terms={
                "class_score": score,
                "information_gain": score * 0.4,
                "distance_m": far,
                "total": total,
            },
        )
        for kind, name, (x, y), score, total, far, chosen in rows
    ]
    return pb.Decision(
        task_id="t1",
        index=index,
        phase="find_object",
        rule="global_search (eq. 10)",
        candidates=candidates,
        made_s=1.8e9 + index,
        context_id="c1",
        why="coffee table 2 is likely one and may hold the mug: total 0.74 against 0.42 of "
        "frontier 12",
        settings={"alpha_cs": 1.0, "alpha_d": 0.001},
    )


def snapshot(version: int, pose: tuple[float, float, float]) -> pb.MapSnapshot:
    """Make a map of the home in which three of its four rooms have been seen."""
    rows, columns = round(7 / CELL_M), round(9 / CELL_M)
    occupancy = np.zeros((rows, columns), np.int8)
    for x0, y0, x1, y1 in (*WALLS_M, *FURNITURE_M):
        box = [round(v / CELL_M) for v in (y0, y1, x0, x1)]
        occupancy[box[0] : box[1], box[2] : box[3]] = 100
    y, x = (np.mgrid[0:rows, 0:columns] + 0.5) * CELL_M
    seen = (x < 4.5) | ((y < 3.8) & (x < 8.2))
    seen &= ~((x < 4.4) & (y > 3.9) & (x + y > 7.8))
    occupancy[~seen] = -1
    explored = (seen & (x < 6.4)).astype(np.uint8)
    pick = np.exp(-((x - 1.7) ** 2 + (y - 1.5) ** 2) / 3) * 0.42 * seen
    place = np.exp(-((x - 7.2) ** 2 + (y - 0.7) ** 2) / 4) * 0.35 * seen
    angle = np.linspace(0, 1.6 * math.pi, 60)
    walked = np.column_stack([2.9 + 0.9 * np.cos(angle) + angle * 0.02, 2.6 + 0.8 * np.sin(angle)])
    walked = np.vstack([walked, pose[:2]]).astype(np.float32)
    return pb.MapSnapshot(
        id=pb.FrameId(robot_boot_id="boot", seq=version), version=version, cell_m=CELL_M,
        map_id="m1", origin_x_m=0.0, origin_y_m=0.0, width=columns, height=rows,
        occupancy=zlib.compress(occupancy.tobytes()), explored=zlib.compress(explored.tobytes()),
        values={"pick": zlib.compress(pick.astype("<f2").tobytes()),
                "place": zlib.compress(place.astype("<f2").tobytes())},
        frontiers=[
            pb.Frontier(id=12, x_m=6.4, y_m=2.0, size_m=1.3, reachable=True,
                        values={"pick": 0.21, "place": 0.33}),
            pb.Frontier(id=15, x_m=2.1, y_m=5.6, size_m=0.9, reachable=True,
                        values={"pick": 0.12, "place": 0.05}),
            pb.Frontier(id=19, x_m=6.7, y_m=3.8, size_m=0.7, reachable=False,
                        values={"pick": 0.08, "place": 0.11}),
        ],
        robot=pb.Pose2(x_m=pose[0], y_m=pose[1], yaw_rad=pose[2]),
        trajectory_m=walked.ravel().tolist(), context_id="c1",
        explored_m2=float(explored.sum() * CELL_M**2), occupied_m2=11.2,
    )  # fmt: skip
