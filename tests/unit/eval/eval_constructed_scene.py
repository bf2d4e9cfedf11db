"""Constructs the scene of one video frame."""

import numpy as np
from helios_core import proto as pb
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, MapView
from helios_core.types import Detection, FrameId, ObjectInstance
from helios_eval.video.frame_content import Scene

CELL_M = 0.05


def constructed_map() -> MapView:
    """Two rooms of a home of 9 x 7 m; the right room is partly explored."""
    shape = (160, 200)
    occupancy = np.full(shape, UNKNOWN, np.int8)
    occupancy[10:150, 10:150] = FREE
    top_m = np.zeros(shape, np.float32)
    for rows, columns, height in (
        (slice(10, 13), slice(10, 150), 2.5),
        (slice(147, 150), slice(10, 150), 2.5),
        (slice(10, 150), slice(10, 13), 2.5),
        (slice(10, 70), slice(95, 98), 2.5),
        (slice(90, 150), slice(95, 98), 2.5),
        (slice(100, 125), slice(30, 60), 0.45),
        (slice(14, 26), slice(40, 90), 0.9),
        (slice(110, 140), slice(110, 130), 0.75),
    ):
        occupancy[rows, columns] = OCCUPIED
        top_m[rows, columns] = height
    explored = occupancy != UNKNOWN
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    value = (0.12 + 0.2 * np.exp(-((x - 120) ** 2 + (y - 80) ** 2) / 3000)).astype(np.float32)
    return MapView(
        version=7,
        frame_id=FrameId("boot", 0, 7),
        context_id="c",
        cell_m=CELL_M,
        origin_m=(-2.0, -1.5),
        occupancy=occupancy,
        explored=explored,
        top_m=top_m,
        values={"pick": np.where(explored, value, 0), "place": np.where(explored, 0.4 - value, 0)},
        frontiers=(
            pb.Frontier(id=1, x_m=5.4, y_m=2.0, reachable=True, values={"pick": 0.31}),
            pb.Frontier(id=2, x_m=5.4, y_m=5.0, reachable=False, values={"pick": 0.2}),
        ),
        robot_pose=(1.5, 1.8, 0.6),
        trajectory_m=np.array([[0, 0], [0.8, 0.3], [1.2, 1.0], [1.5, 1.8]], np.float32),
        explored_m2=41.5,
        occupied_m2=6.0,
    )


def thing(name: str, x: float, y: float, half_m: float, score: float, views: int = 4):
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half_m + (x, y)
    return ObjectInstance(
        id=1, class_name=name, center_m=np.array([x, y, 0.5]), size_m=np.full(3, 2 * half_m),
        score=score, class_score=score + 0.1, uncertainty=0.1, views=views, gaussians=100,
        probabilities={name: score}, top_m=0.6, outline_m=corners,
    )  # fmt: skip


def constructed_decision(candidates: int = 6) -> pb.Decision:
    rng = np.random.default_rng(0)
    out = pb.Decision(
        index=11,
        phase="find_object",
        rule="global search (eq. 8-10)",
        why="explore frontier 4: value 0.31 times 1.42 at 3.1 m gives 0.437, the best of 6",
        settings={"alpha_d": 0.001, "frontier_scale": 1.42},
    )
    for k in range(candidates):
        terms = {"distance_m": float(rng.uniform(1, 9)), "total": float(rng.uniform(0, 0.4))}
        if k % 3 == 0:
            terms |= {"class_score": 0.62, "information_gain": float(rng.uniform(0, 1))}
            name, kind = "coffee table", "receptacle"
        else:
            terms |= {"value": float(rng.uniform(0.1, 0.3))}
            name, kind = f"frontier {k}", "frontier"
        out.candidates.append(pb.Candidate(kind=kind, name=name, terms=terms))
    if candidates:
        best = max(out.candidates, key=lambda c: c.terms["total"])
        best.chosen = True
        best.position_m.CopyFrom(pb.Vector3(x=5.4, y=2.0, z=0.0))
    return out


def constructed_scene(**changes) -> Scene:
    height, width = 640, 480
    v, u = np.mgrid[0:height, 0:width]
    color = np.stack([150 + u // 8, 140 + v // 10, 120 + (u + v) // 16], -1).astype(np.uint8)
    mask = (u - 250) ** 2 + (v - 400) ** 2 < 45**2
    table = (v > 420) & (u > 60) & (u < 430)
    facts = {
        "title": "helios-paper · home 12 of ovmm-v1 · noisy detector",
        "task": pb.Task(
            id="t", instruction="Move the mug from the coffee table to the kitchen counter",
            state="running", phase="find_object", kind="move", max_steps=1250, seeking="mug",
            message="driving to a frontier, 3.1 m to go",
        ),
        "color": color,
        "detections": (
            Detection("mug", 0.71, (205, 355, 295, 445), mask),
            Detection("coffee table", 0.55, (60, 420, 430, 640), table),
        ),
        "map": constructed_map(),
        "robot": (1.5, 1.8, 0.6),
        "path_m": np.array([[1.5, 1.8], [2.4, 2.3], [3.6, 2.4], [5.4, 2.0]]),
        "objects": (
            thing("coffee table", 0.25, 4.1, 0.6, 0.71), thing("mug", 0.3, 4.2, 0.05, 0.44),
            thing("kitchen counter", 1.2, -0.5, 0.5, 0.38),
        ),
        "decisions": (constructed_decision(2), constructed_decision()),
        "roles": {
            "mug": "object", "coffee table": "start_receptacle",
            "kitchen counter": "goal_receptacle",
        },
        "story": (
            (0, "starting"), (12, "looking around"),
            (40, "search the coffee table: class score 0.62 times gain 0.41 gives 0.33"),
            (84, "driving to a frontier, 3.1 m to go"),
        ),
        "step": 87,
    }  # fmt: skip
    return Scene(**{**facts, **changes})
