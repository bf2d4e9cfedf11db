"""Compares our 2D maps with VLFM's own on the same frames: speed and agreement.

    python tests/bench/against_vlfm.py --vlfm DIR --frontier-exploration DIR [--frames F] [--out D]

The directories are checkouts of bdaiinstitute/vlfm and naokiyokoyama/frontier_exploration; nothing
of them is part of this project. Frames are those of `helios bench`, or of a folder of RGB-D frames
(`--frames redkitchen:DIR`). Times are medians of processor time, so that other load counts less;
both sides run in turn within one run. "map" is the time from a frame to a published version; its
counterpart is VLFM's `update_map`. "frontiers" is the update of the frontiers after a frame is in
the map; its counterpart is VLFM's `_get_frontiers`, which calls frontier_exploration on the whole
map, without tiles, persistent numbers or reachability. Maps are compared at 20 cells per metre, the
only size that VLFM's value map has.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from helios_core.geometry import Pinhole, se2_to_se3
from helios_core.types import Frame, FrameId, Observation, SearchContext
from helios_eval.bench.synthetic_flat import frames as bench_frames
from helios_map2d.camera_view import heading_of, view_of
from helios_map2d.epoch_map import EpochMap
from helios_map2d.grid import TileMask
from helios_map2d.layer_stack import LayerStack
from helios_map2d.layers.frontiers import FrontierFinder, FrontierRules
from helios_map2d.layers.occupancy import OccupancyRules
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.value_layers import ValueLayers, ValueRules, cone_of
from helios_map2d.settings import vlfm_compatible
from helios_map2d.warm_up import warm_up
from numpy.typing import NDArray

NEAR_M, FAR_M = 0.1, 5.0
BAND_M = (0.30, 1.50)  # VLFM filters no noise: below it, far floor becomes obstacles
RADIUS_M = 0.18
SCORES = {"pick": 0.3, "place": 0.6}


class Vlfm:
    """VLFM's maps of `cells` x `cells`, fed with our frames in VLFM's conventions."""

    def __init__(self, cells: int, per_m: int, fusion_max: bool = False) -> None:
        from vlfm.mapping.obstacle_map import ObstacleMap  # pyright: ignore[reportMissingImports]
        from vlfm.mapping.value_map import ValueMap  # pyright: ignore[reportMissingImports]

        self.per_m = per_m
        self.obstacles: Any = ObstacleMap(
            min_height=BAND_M[0],
            max_height=BAND_M[1],
            agent_radius=RADIUS_M,
            area_thresh=1.5,
            hole_area_thresh=-1,
            size=cells,
            pixels_per_meter=per_m,
        )
        self.values: Any = ValueMap(len(SCORES), size=cells, use_max_confidence=fusion_max)
        self.cells = cells

    def see(self, frame: Frame) -> None:
        camera = frame.camera
        self.obstacles.update_map(
            depth_of(frame), pose_of(frame), NEAR_M, FAR_M, camera.fx, camera.fy, camera.hfov_rad
        )

    def value(self, frame: Frame, scores: dict[str, float]) -> None:
        self.values.update_map(
            np.array(list(scores.values())),
            depth_of(frame),
            pose_of(frame),
            NEAR_M,
            FAR_M,
            frame.camera.hfov_rad,
        )

    def frontiers(self) -> Any:
        return self.obstacles._get_frontiers()

    def upright(self, array: NDArray) -> NDArray:
        """Turn a VLFM array to our axes: its rows are x, its columns run against y."""
        return np.roll(array.T[::-1], 1, axis=0)


def depth_of(frame: Frame) -> NDArray[np.float32]:
    """Depth as VLFM takes it: 0 to 1 between the limits; unmeasured pixels count as far."""
    good = (frame.depth_m > NEAR_M) & (frame.depth_m < FAR_M)
    return np.where(good, (frame.depth_m - NEAR_M) / (FAR_M - NEAR_M), 1.0).astype(np.float32)


def pose_of(frame: Frame) -> NDArray[np.float64]:
    """The camera pose with VLFM's axes: x forward, y left, z up."""
    out = frame.T_world_cam.copy()
    out[:3, :3] = frame.T_world_cam[:3, :3] @ np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    return out


def load(source: str) -> list[Frame]:
    """The frames for the comparison."""
    kind, _, where = source.partition(":")
    if kind == "bench":
        return list(bench_frames())
    if kind == "redkitchen":
        return list(redkitchen(Path(where)))
    raise SystemExit(f"--frames {source!r}: wanted bench or redkitchen:DIR")


def redkitchen(folder: Path) -> Iterator[Frame]:
    """Every tenth frame of a folder of RGB-D frames with `meta.json` and `poses.csv`."""
    meta = json.loads((folder / "meta.json").read_text())
    camera = Pinhole(*(meta[k] for k in ("fx", "fy", "cx", "cy", "width", "height")))
    rows = np.loadtxt(folder / "poses.csv", delimiter=",", skiprows=1)
    for row in rows[::10]:
        name = folder / "frames" / f"{int(row[0]):06d}"
        depth = cv2.imread(f"{name}.png", cv2.IMREAD_UNCHANGED)
        color = cv2.imread(f"{name}.jpg")
        if depth is None or color is None:
            raise SystemExit(f"{name}.png or .jpg cannot be read")
        T = np.vstack([row[2:14].reshape(3, 4), [0, 0, 0, 1]])
        base = se2_to_se3(T[0, 3], T[1, 3], math.atan2(*heading_of(T)[::-1]))
        yield Frame(
            FrameId("redkitchen", 0, int(row[0])),
            int(row[1] * 1e9),
            True,
            np.asarray(color[..., ::-1], np.uint8),
            (depth * meta["depth_scale_m"]).astype(np.float32),
            camera,
            T,
            base,
        )


def timed(work: Callable[[], object]) -> float:
    """Processor time of this thread in ms. Not of the process: BLAS's second thread spins after a
    matrix product, and that would count as VLFM's work."""
    began = time.thread_time()
    work()
    return (time.thread_time() - began) * 1e3


def numbered(frame: Frame, seq: int) -> Frame:
    return dataclasses.replace(frame, id=FrameId("bench", 0, seq))


def speed(
    frames: list[Frame], cells: int, laps: int, maps: int, by_lap: bool
) -> dict[str, dict[str, Any]]:
    """Medians on `cells` x `cells` maps at 2.5 cm (values: VLFM's own 5 cm). The first lap over the
    frames, where each shows new ground, counts apart from the later laps. Everything runs on
    several maps that begin empty."""
    cv2.setNumThreads(1)
    times: dict[str, dict[str, list[float]]] = {"new ground": {}, "known ground": {}}
    for _ in range(maps):
        one_map(frames, cells, laps, times, by_lap)
    out: dict[str, dict[str, Any]] = {}
    for ground, by_name in times.items():
        ms = {name: statistics.median(taken) for name, taken in by_name.items()}
        for name in ("map", "values", "frontiers"):
            peer = ms[f"vlfm {name}"]
            out.setdefault(name, {})[ground] = {
                "ours_ms": round(ms[name], 3),
                "vlfm_ms": round(peer, 2),
                "ratio": round(peer / ms[name], 1),
            }
        out.setdefault("frame and observation, all published", {})[ground] = {
            "ours_ms": round(ms["published"], 3)
        }
    return out


def one_map(
    frames: list[Frame],
    cells: int,
    laps: int,
    times: dict[str, dict[str, list[float]]],
    by_lap: bool,
) -> None:
    """Add the times of `laps` laps over the frames, ours and VLFM's in turn: frame by frame, or lap
    by lap."""
    rules = MapRules(size_cells=cells, frontiers=FrontierRules(robot_radius_m=RADIUS_M))
    ours, theirs = EpochMap(rules, (0.0, 0.0), RADIUS_M), Vlfm(cells, 40)
    ours.reset_search(SearchContext("bench", (), {}))
    stack = ours.stack
    layers, finder = (
        ValueLayers(stack.grid, ValueRules()),
        FrontierFinder(stack.grid, rules.frontiers),
    )

    def own(i: int) -> dict[str, float]:
        frame = numbered(frames[i % len(frames)], i + 1)
        map_ms = timed(lambda: ours.integrate_frame(frame))
        tiles = touched(ours)
        seen = Observation(frame, "bench", (), SCORES, "bench")
        published_ms = map_ms + timed(lambda: ours.integrate_values(seen))
        view = view_of(frame.depth_m, frame.camera, frame.T_world_cam, stack.grid, NEAR_M, FAR_M)
        values_ms = timed(lambda: layers.integrate(cone_of(view), SCORES))
        xy = ours.robot_pose[:2] if ours.robot_pose else (0.0, 0.0)
        frontiers_ms = timed(lambda: frontiers_of(stack, finder, tiles, xy))
        return {
            "map": map_ms,
            "published": published_ms,
            "values": values_ms,
            "frontiers": frontiers_ms,
        }

    def of_vlfm(i: int) -> dict[str, float]:
        frame = frames[i % len(frames)]
        return {
            "vlfm map": timed(lambda: theirs.see(frame)),
            "vlfm values": timed(lambda: theirs.value(frame, SCORES)),
            "vlfm frontiers": timed(theirs.frontiers),
        }

    at_once = len(frames) if by_lap else 1
    for first in range(0, laps * len(frames), at_once):
        for side in (own, of_vlfm):
            for i in range(first, first + at_once):
                into = times["new ground" if i < len(frames) else "known ground"]
                for name, ms in side(i).items():
                    into.setdefault(name, []).append(ms)


def by_size(frames: list[Frame], laps: int) -> dict[str, float]:
    """Median ms from a frame and its scores to all published, on maps of two sizes in turn."""
    sizes = (2000, 8000)
    rules = [
        MapRules(size_cells=size, frontiers=FrontierRules(robot_radius_m=RADIUS_M))
        for size in sizes
    ]
    maps = [EpochMap(one, (0.0, 0.0), RADIUS_M) for one in rules]
    times: list[list[float]] = [[] for _ in sizes]
    for state in maps:
        state.reset_search(SearchContext("bench", (), {}))
    for i in range(laps * len(frames)):
        frame = numbered(frames[i % len(frames)], i + 1)
        seen = Observation(frame, "bench", (), SCORES, "bench")
        # Each size goes first equally often.
        for k, state in list(enumerate(maps))[:: 1 if i % 2 else -1]:
            ms = timed(lambda s=state, f=frame: s.integrate_frame(f))
            times[k].append(ms + timed(lambda s=state, o=seen: s.integrate_values(o)))
    ms = [statistics.median(taken[len(frames) :]) for taken in times]
    named = {
        f"{size} x {size} cells, ms": round(took, 3) for size, took in zip(sizes, ms, strict=True)
    }
    return named | {"larger by": round(ms[1] / ms[0] - 1, 3)}


def touched(ours: EpochMap) -> TileMask:
    """The tiles that the newest frame changed, and their neighbours."""
    new = [t for t, tile in ours.published.ground.items() if tile.version == ours.version]
    return TileMask.of(
        (r + dr, c + dc) for r, c in new for dr, dc in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    )


def frontiers_of(
    stack: LayerStack, finder: FrontierFinder, tiles: TileMask, robot_m: tuple[float, float]
) -> None:
    """Update the frontiers after a frame: cells in the tiles that it touched, clusters, centres,
    reachability and numbers."""
    occupancy = stack.occupancy.occupancy
    finder.update(occupancy, stack.search.explored, tiles)
    finder.find(occupancy, stack.ground, robot_m, {})


def agreement(frames: list[Frame], cells: int, out: Path | None) -> dict[str, float]:
    """IoU of obstacles and of explored area; mean difference of the values that both maps have."""
    rules = MapRules(
        cell_m=0.05,
        size_cells=cells,
        min_depth_m=NEAR_M,
        max_depth_m=FAR_M,
        occupancy=OccupancyRules(band_lo_m=BAND_M[0], band_hi_m=BAND_M[1]),
        frontiers=FrontierRules(robot_radius_m=RADIUS_M),
    )
    same, default = EpochMap(vlfm_compatible(rules), (0.0, 0.0), 0.0), EpochMap(rules, (0, 0), 0.0)
    theirs = Vlfm(cells, 20)
    for state in (same, default):
        state.reset_search(SearchContext("bench", (), {"pick": "", "place": ""}))
    for i, frame in enumerate(frames):
        frame = numbered(frame, i + 1)
        moved = by_half_a_cell(frame, 0.05)
        scores = {"pick": 0.2 + 0.6 * (i * 7 % 10) / 10, "place": 0.5}
        for state in (same, default):
            state.integrate_frame(moved)
            state.integrate_values(Observation(moved, "bench", (), scores, "bench"))
        theirs.see(frame)
        theirs.value(frame, scores)
    obstacles = theirs.upright(theirs.obstacles._map)
    explored = theirs.upright(theirs.obstacles.explored_area)
    values = theirs.upright(theirs.values._value_map[..., 0])
    mine = [
        aligned(same, a, cells)
        for a in (
            same.stack.occupancy.occupancy == 100,
            same.stack.search.explored > 0,
            same.stack.values.layers["pick"].value,
        )
    ]
    both = (mine[2] != 0) & (values != 0)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        usual = (
            aligned(default, default.stack.occupancy.occupancy == 100, cells),
            aligned(default, default.stack.search.explored > 0, cells),
        )
        picture(out / "vlfm.png", [(obstacles, explored), (mine[0], mine[1]), usual])
    return {
        "obstacle_iou": round(iou(mine[0], obstacles, 1), 4),
        "obstacle_iou_exact": round(iou(mine[0], obstacles, 0), 4),
        "explored_iou": round(iou(mine[1], explored, 0), 4),
        "value_cells_iou": round(iou(mine[2] != 0, values != 0, 0), 4),
        "mean_value_difference": round(float(np.abs(mine[2] - values)[both].mean()), 5),
    }


def by_half_a_cell(frame: Frame, cell_m: float) -> Frame:
    """Shift a frame by half a cell: VLFM rounds to cells, ours begin at multiples of the size."""
    shift = np.eye(4)
    shift[:2, 3] = cell_m / 2
    return dataclasses.replace(
        frame, T_world_cam=shift @ frame.T_world_cam, T_world_base=shift @ frame.T_world_base
    )


def aligned(state: EpochMap, array: NDArray, cells: int) -> NDArray:
    """The part of one of our arrays that VLFM's map covers."""
    row, column = -cells // 2 - state.stack.grid.corner[0], -cells // 2 - state.stack.grid.corner[1]
    return array[row : row + cells, column : column + cells]


def iou(a: NDArray, b: NDArray, slack: int) -> float:
    """Intersection over union; cells within `slack` cells of each other count as shared."""
    if slack:
        kernel = np.ones((2 * slack + 1,) * 2, np.uint8)
        wide_a = cv2.dilate(a.astype(np.uint8), kernel) > 0
        wide_b = cv2.dilate(b.astype(np.uint8), kernel) > 0
        shared = ((a & wide_b).sum() + (b & wide_a).sum()) / 2
        return float(shared / ((a.sum() + b.sum()) - shared))
    return float((a & b).sum() / max(1, (a | b).sum()))


def picture(path: Path, maps: list[tuple[NDArray, NDArray]]) -> None:
    """Draw the maps side by side: explored green, obstacles black."""
    known = np.argwhere(np.any([o | e for o, e in maps], axis=0))
    (r0, c0), (r1, c1) = known.min(axis=0) - 5, known.max(axis=0) + 6
    parts = []
    for (obstacles, explored), name in zip(
        maps, ("VLFM", "preset vlfm-compatible", "default"), strict=True
    ):
        rgb = np.full((*obstacles.shape, 3), 225, np.uint8)
        rgb[explored] = (200, 240, 200)
        rgb[obstacles] = (40, 40, 50)
        part = cv2.resize(
            rgb[r0:r1, c0:c1][::-1], None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST
        )
        head = np.full((26, part.shape[1], 3), 255, np.uint8)
        cv2.putText(
            head, name, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (44, 50, 62), 1, cv2.LINE_AA
        )
        parts += [np.vstack([head, part]), np.full((part.shape[0] + 26, 8, 3), 255, np.uint8)]
    cv2.imwrite(str(path), cv2.cvtColor(np.hstack(parts[:-1]), cv2.COLOR_RGB2BGR))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--vlfm", type=Path, required=True)
    parser.add_argument("--frontier-exploration", type=Path, required=True)
    parser.add_argument("--frames", default="bench")
    parser.add_argument("--cells", type=int, default=2000)
    parser.add_argument("--laps", type=int, default=3, help="over the frames; 0: no times")
    parser.add_argument("--maps", type=int, default=2, help="that begin empty, for times")
    parser.add_argument(
        "--by-lap",
        action="store_true",
        help="take turns after each lap, not after each frame: then the other side's arrays do not "
        "push ours out of the cache",
    )
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    sys.path[:0] = [str(args.vlfm), str(args.frontier_exploration)]
    warm_up()
    frames = load(args.frames)
    result = {
        "frames": f"{args.frames}: {len(frames)}",
        "agreement": agreement(frames, 1000, args.out),
        "speed": speed(frames, args.cells, args.laps, args.maps, args.by_lap) if args.laps else {},
        "by size": by_size(frames, args.laps) if args.laps > 1 else {},
    }
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
