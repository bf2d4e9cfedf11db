"""Task solver with access to the ground truth: checks that tasks are solvable and metrics correct.

`python -m helios_sim.ground_truth_solver --seeds 0-9 --preset demo-v1` prints a line for each seed.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
from helios_core.geometry import wrap_angle, yaw_of
from helios_core.robot import Action, ActionResult, Forward, Pick, Place, Tilt, Turn
from numpy.typing import NDArray

from helios_sim.episode_tracker import episode_of, reachable
from helios_sim.home import PRESETS, Surface, generate_home
from helios_sim.ovmm_metrics import Progress
from helios_sim.robot_model import CAMERA_HEIGHT_M, GRIPPER_BASE_M, REACH_M, TILT_RANGE_RAD
from helios_sim.world import World

_CELL_M = 0.05
_ON_SURFACE_GRID_M = 0.05
_MAX_PLACES = 12
_LIFT_M = 0.06  # headroom above an object that is placed
_LAST_SEED = 999  # of the homes for development

Cell = tuple[int, int]


class _OutOfSteps(Exception):
    """The step limit of the task is reached."""


class GroundTruthSolver:
    """Solves one task in a world with full ground truth."""

    def __init__(self, world: World, max_steps: int | None = None) -> None:
        """max_steps: limit on the number of actions; None for no limit."""
        self._world, self._max_steps = world, max_steps
        # Everything in a home is reachable with this radius; a drive ends up to 0.1 m off.
        radius_m = world.home.preset.passage_radius_m
        self._free, self._origin_m = reachable(world.home, radius_m, _CELL_M)
        self._actions = 0

    def run(self) -> Progress:
        """Solve the task; return the progress when it is done, fails, or is out of steps."""
        with suppress(_OutOfSteps):
            self._carry_out()
        return self._world.progress

    def _carry_out(self) -> None:
        for name in self._world.tracker.targets.objects:
            if self.fetch(name):
                break
        if self._world.held_name:
            for name in self._world.tracker.targets.goals:
                if self._bring(name):
                    break

    def fetch(self, name: str) -> bool:
        """Pick an object by its body name; return True if it is now held."""
        class_name = self._world.home.class_of(name)
        return any(
            self._act(Pick(self._point(name), class_name)).succeeded for _ in self._approaches(name)
        )

    def approach(self, name: str) -> bool:
        """Drive to an object or receptacle and face it; return True on success."""
        return next(self._approaches(name), False)

    def go_near(self, point_xy_m: tuple[float, float]) -> bool:
        """Drive to the free cell nearest to a point."""
        rows, columns = np.nonzero(self._free)
        x, y = self._middle(rows, columns)
        k = int(np.argmin(np.hypot(x - point_xy_m[0], y - point_xy_m[1])))
        return self._go((int(rows[k]), int(columns[k])))

    def _approaches(self, name: str) -> Iterator[bool]:
        """Drive to one spot after another and yield True each time the robot faces the object."""
        for spot in self._spots(self._world.position_m(name)):
            if self._go(spot) and self.face(self._world.position_m(name)):
                yield True

    def _point(self, name: str) -> tuple[float, float, float]:
        x, y, z = (float(v) for v in self._world.position_m(name))
        return x, y, z

    def _bring(self, name: str) -> bool:
        for point in self._free_points(name):
            for spot in self._spots(point):
                if self._go(spot) and self.face(point):
                    x, y, z = (float(v) for v in point)
                    if self._act(Place((x, y, z))).succeeded:
                        return self._world.progress.place
        return False

    def _free_points(self, name: str) -> Iterator[NDArray[np.float64]]:
        """Points on the receptacle within reach, those with the most free space around them first.

        Surfaces without enough headroom for the held object are skipped.
        """
        home = self._world.home
        held = (t.size_m[2] for t in home.objects if t.name == self._world.held_name)
        needed_m = next(held, 0.0) + _LIFT_M
        others = np.array([self._world.position_m(thing.name) for thing in home.objects])
        found: list[tuple[float, NDArray[np.float64]]] = []
        for surface in home.receptacle(name).surfaces:
            if surface.clear_m < needed_m:
                continue
            for point in _grid(surface):
                near = np.abs(others[:, 2] - point[2]) < 0.4
                room_m = np.linalg.norm((others - point)[near, :2], axis=1).min(initial=1.0)
                edge_m = _to_edge_m(surface, point)
                found.append((min(float(room_m) - 0.08, edge_m), point))
        found.sort(key=lambda entry: -entry[0])
        within_reach = (point for _, point in found if self._spots(point))
        return itertools.islice(within_reach, _MAX_PLACES)

    def _spots(self, point: NDArray[np.float64]) -> list[Cell]:
        """About a dozen cells well within reach of the point, nearest to the robot first."""
        rows, columns = np.nonzero(self._free)
        x, y = self._middle(rows, columns)
        flat = np.hypot(x - point[0], y - point[1])
        away = np.hypot(flat - GRIPPER_BASE_M[0], point[2] - GRIPPER_BASE_M[2])
        good = np.flatnonzero((away < REACH_M - 0.05) & (flat < 0.95))
        if len(good) == 0:
            return []
        at_x, at_y = self._world.state().T_world_base[:2, 3]
        travel = np.hypot(x[good] - at_x, y[good] - at_y)
        best = good[np.argsort(travel + 3.0 * flat[good], kind="stable")]
        step = max(1, len(best) // 12)
        return [(int(rows[k]), int(columns[k])) for k in best[::step]]

    def _go(self, goal: Cell) -> bool:
        """Drive along the shortest path over free cells; return True on arrival."""
        path = shortest_path(self._free, self._cell(), goal)
        if not path:
            return False
        while path:
            far = max(
                k for k in range(len(path)) if k == 0 or self._straight(self._cell(), path[k])
            )
            x, y = self._middle(path[far][0], path[far][1])
            if not self._drive_to(float(x), float(y)):
                return False
            path = path[far + 1 :]
        return True

    def _drive_to(self, x: float, y: float) -> bool:
        for _ in range(30):
            at = self._world.state().T_world_base[:2, 3]
            left = math.hypot(x - at[0], y - at[1])
            if left < 0.1:
                return True
            self._turn_to(math.atan2(y - at[1], x - at[0]))
            if not self._act(Forward(min(left, 1.0))).succeeded:
                return False
        return False

    def _turn_to(self, yaw_rad: float) -> None:
        for _ in range(20):
            left = wrap_angle(yaw_rad - yaw_of(self._world.state().T_world_base))
            if abs(left) < math.radians(5):
                return
            limit = math.radians(30)
            # Split the turn so that the remainder is never below the smallest turn.
            turn = left if abs(left) <= limit else math.copysign(limit, left)
            if limit < abs(left) < limit + math.radians(5):
                turn = math.copysign(limit - math.radians(5), left)
            self._act(Turn(turn))

    def face(self, point: NDArray[np.float64]) -> bool:
        """Turn the base and tilt the camera towards a point in the world frame."""
        at = self._world.state().T_world_base[:2, 3]
        self._turn_to(math.atan2(point[1] - at[1], point[0] - at[0]))
        flat = math.hypot(point[0] - at[0], point[1] - at[1])
        down = math.atan2(CAMERA_HEIGHT_M - point[2], flat)
        return self._act(Tilt(float(np.clip(down, *TILT_RANGE_RAD)))).succeeded

    def _act(self, action: Action) -> ActionResult:
        if self._max_steps is not None and self._world.progress.steps >= self._max_steps:
            raise _OutOfSteps
        self._actions += 1
        return self._world.act(action, f"oracle-{id(self)}-{self._actions}")

    def _cell(self) -> Cell:
        x, y = self._world.state().T_world_base[:2, 3]
        row = int((y - self._origin_m[1]) / _CELL_M)
        return row, int((x - self._origin_m[0]) / _CELL_M)

    def _middle(
        self, row: int | NDArray[np.int_], column: int | NDArray[np.int_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        x = self._origin_m[0] + (np.asarray(column) + 0.5) * _CELL_M
        return x, self._origin_m[1] + (np.asarray(row) + 0.5) * _CELL_M

    def _straight(self, a: Cell, b: Cell) -> bool:
        count = 2 * max(abs(a[0] - b[0]), abs(a[1] - b[1])) + 1
        rows = np.rint(np.linspace(a[0], b[0], count)).astype(int)
        columns = np.rint(np.linspace(a[1], b[1], count)).astype(int)
        return bool(self._free[rows, columns].all())


def shortest_path(free: NDArray[np.bool_], start: Cell, goal: Cell) -> list[Cell]:
    """Shortest 8-connected path by A*, without the start cell; empty if there is none."""
    if not free[goal]:
        return []

    def rest(cell: Cell) -> float:
        return math.hypot(cell[0] - goal[0], cell[1] - goal[1])

    cost, came = {start: 0.0}, {start: start}
    queue = [(rest(start), start)]
    while queue:
        _, cell = heapq.heappop(queue)
        if cell == goal:
            path = [cell]
            while came[path[-1]] != start:
                path.append(came[path[-1]])
            return path[::-1]
        for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            other = (cell[0] + dr, cell[1] + dc)
            inside = 0 <= other[0] < free.shape[0] and 0 <= other[1] < free.shape[1]
            new = cost[cell] + math.hypot(dr, dc)
            if inside and free[other] and new < cost.get(other, math.inf) - 1e-9:
                cost[other], came[other] = new, cell
                heapq.heappush(queue, (new + rest(other), other))
    return []


def _grid(surface: Surface) -> Iterator[NDArray[np.float64]]:
    c, s = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    half_x, half_y = surface.half_extent_xy
    for u in np.arange(-half_x, half_x + 1e-9, _ON_SURFACE_GRID_M):
        for v in np.arange(-half_y, half_y + 1e-9, _ON_SURFACE_GRID_M):
            x, y = surface.center_xy[0] + c * u - s * v, surface.center_xy[1] + s * u + c * v
            yield np.array([x, y, surface.height_m])


def _to_edge_m(surface: Surface, point: NDArray[np.float64]) -> float:
    d = point[:2] - np.array(surface.center_xy)
    c, s = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    half_x, half_y = surface.half_extent_xy
    return float(min(half_x - abs(c * d[0] + s * d[1]), half_y - abs(c * d[1] - s * d[0])))


def seeds_of(text: str) -> range:
    """Seeds of "3" or "0-9". Raises ArgumentTypeError for other text and for later homes."""
    first, _, last = text.partition("-")
    last = last or first
    if not (first.isdecimal() and last.isdecimal()) or int(last) < int(first):
        raise argparse.ArgumentTypeError(f"{text!r} names no seeds; write 3 or 0-9")
    if int(last) > _LAST_SEED:
        raise argparse.ArgumentTypeError(
            f"{text!r}: homes from {_LAST_SEED + 1} on belong to published results; wanted seeds "
            f"up to {_LAST_SEED}; `helios eval --agents ground-truth-walker` plays the others, and "
            "enters them in the ledger"
        )
    return range(int(first), int(last) + 1)


def main(say: Callable[[str], object] = print) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_sim.ground_truth_solver", description=__doc__
    )
    parser.add_argument("--seeds", type=seeds_of, default="0-9", help="first and last seed")
    parser.add_argument("--preset", default="demo-v1", choices=sorted(PRESETS))
    args = parser.parse_args()
    solved = count = 0
    for seed in args.seeds:
        began = time.monotonic()
        home = generate_home(seed, PRESETS[args.preset])
        world = World(home, episode_of(home, seed))
        done = GroundTruthSolver(world).run()
        world.close()
        count, solved = count + 1, solved + done.success
        say(
            f"seed {seed}: {'success' if done.success else 'FAILED'} {world.episode.instruction!r} "
            f"find_object {done.find_object} pick {done.pick} find_receptacle "
            f"{done.find_receptacle} place {done.place} collisions {done.collisions} "
            f"{done.collided_with} steps {done.steps} path {done.path_m:.1f} m "
            f"in {time.monotonic() - began:.1f} s"
        )
    say(f"{solved} of {count} solved")
    return 0 if solved == count else 1


if __name__ == "__main__":
    sys.exit(main())
