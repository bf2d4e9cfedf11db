"""Each benchmark's task in a home, and what the truth says of it in the end.

Open-vocabulary mobile manipulation: `helios_sim.metrics`. Object navigation: the goal is a class of
furniture, as most goals of HM3D are; the robot succeeds when the agent says that it has arrived
while the base stands within 0.1 m of a viewpoint of any piece of that class (viewpoints as in
`helios_sim.metrics`). SPL weighs success by the shortest way from the start to any viewpoint.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from helios_sim.episode import episode_of, reachable
from helios_sim.home import Episode, Home
from helios_sim.judge import failure_cause, objectnav_cause
from helios_sim.metrics import Points, at_viewpoint, viewpoints_of
from helios_sim.world import World
from numpy.typing import NDArray

from helios_eval.record import Benchmark

CELL_M = 0.05
NEAREST_GOAL_M = 2.0  # a goal that is nearer to the start is no search

Said = tuple[str, str, str]  # state, cause and message of the agent


@dataclass(frozen=True)
class Verdict:
    """What of an episode's record differs by benchmark."""

    find_object: bool
    pick: bool
    find_receptacle: bool
    place: bool
    success: bool
    cause: str
    shortest_path_m: float | None = None


def episode_for(benchmark: Benchmark, home: Home, seed: int) -> Episode:
    """The task of a seed."""
    return episode_of(home, seed) if benchmark == "ovmm" else _navigation(home, seed)


def verdict(benchmark: Benchmark, world: World, said: Said, max_steps: int) -> Verdict:
    """On the world's thread, when the agent has ended."""
    if benchmark == "objectnav":
        return _arrived(world, said, max_steps)
    done = world.progress
    cause = failure_cause(done, world.events, said, max_steps)
    return Verdict(
        done.find_object, done.pick, done.find_receptacle, done.place, done.success, cause
    )


def goals_of(home: Home, class_name: str, radius_m: float) -> dict[str, Points]:
    """Furniture of a class: name -> viewpoints [n, 2] that a robot of that radius can get to."""
    free, origin_m = reachable(home, radius_m, CELL_M)
    out = {}
    for item in (*home.receptacles, *home.fixtures):
        if item.class_name != class_name:
            continue
        c, s = abs(math.cos(item.yaw_rad)), abs(math.sin(item.yaw_rad))
        half_x = (c * item.size_m[0] + s * item.size_m[1]) / 2
        half_y = (s * item.size_m[0] + c * item.size_m[1]) / 2
        low, high = (item.x - half_x, item.y - half_y), (item.x + half_x, item.y + half_y)
        out[item.name] = viewpoints_of(low, high, free, origin_m, CELL_M)
    return out


def shortest_way_m(
    free: NDArray[np.bool_], origin_m: tuple[float, float], start_m: Points, ends_m: Points
) -> float:
    """Length of the shortest way over free cells of 0.05 m to the nearest end; inf without one.

    start_m [2], ends_m [n, 2]. Steps go to 16 neighbours: at most 2.8 % longer than the truth.
    """

    def cell(point: Points) -> tuple[int, int]:
        return (
            int((point[1] - origin_m[1]) / CELL_M),
            int((point[0] - origin_m[0]) / CELL_M),
        )

    ends = {cell(point) for point in ends_m}
    begin = cell(start_m)
    cost = {begin: 0.0}
    queue = [(0.0, begin)]
    while queue:
        so_far, at = heapq.heappop(queue)
        if at in ends:
            return so_far * CELL_M
        if so_far > cost[at]:
            continue
        for dr, dc in _MOVES:
            to = (at[0] + dr, at[1] + dc)
            if not (0 <= to[0] < free.shape[0] and 0 <= to[1] < free.shape[1] and free[to]):
                continue
            half = (at[0] + round(dr / 2.01), at[1] + round(dc / 2.01))
            if not free[half]:
                continue
            new = so_far + math.hypot(dr, dc)
            if new < cost.get(to, math.inf) - 1e-9:
                cost[to] = new
                heapq.heappush(queue, (new, to))
    return math.inf


def _navigation(home: Home, seed: int) -> Episode:
    """Any class of furniture of which no piece is near the start; the farthest where all are."""
    x, y, _ = home.start_pose
    nearest_m: dict[str, float] = {}
    for item in home.receptacles:
        away_m = math.hypot(item.x - x, item.y - y)
        nearest_m[item.class_name] = min(away_m, nearest_m.get(item.class_name, math.inf))
    far = sorted(name for name, away_m in nearest_m.items() if away_m >= NEAREST_GOAL_M)
    far = far or [max(sorted(nearest_m), key=lambda name: nearest_m[name])]
    rng = np.random.default_rng([seed, 0x0B1E])
    name = far[int(rng.integers(len(far)))]
    return Episode(name, "", "", f"Find the {name}")


def _arrived(world: World, said: Said, max_steps: int) -> Verdict:
    radius_m = world.describe().footprint_radius_m
    home, name = world.home, world.episode.object_class
    viewpoints = np.vstack([np.zeros((0, 2)), *goals_of(home, name, radius_m).values()])
    x, y = (float(v) for v in world.state().T_world_base[:2, 3])
    success = said[0] == "succeeded" and at_viewpoint((x, y), viewpoints)
    free, origin_m = reachable(home, radius_m, CELL_M)
    shortest_m = shortest_way_m(free, origin_m, np.array(home.start_pose[:2]), viewpoints)
    cause = objectnav_cause(success, world.progress.steps, said, max_steps)
    return Verdict(success, False, False, False, success, cause, shortest_m)


_MOVES = tuple(
    (dr, dc)
    for dr in range(-2, 3)
    for dc in range(-2, 3)
    if math.gcd(dr, dc) == 1 and abs(dr) + abs(dc) <= 3
)
