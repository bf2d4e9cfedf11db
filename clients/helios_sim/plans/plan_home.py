"""Home of a plan: like a generated home, with walls, doors and furniture as drawn."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np

from helios_sim.home import freespace, mujoco_model, task_sampling
from helios_sim.home.freespace import Obstacle
from helios_sim.home.generated_home import Home, feed
from helios_sim.home.home_types import Episode
from helios_sim.mujoco_library import mujoco
from helios_sim.plans import plan_structure
from helios_sim.plans.plan_structure import PlanDoor
from helios_sim.plans.wall_blocks import WallBlock

PASSES_BELOW_M = 1.4  # what hangs higher does not block the robot


@dataclass(frozen=True)
class PlanHome(Home):
    """Home of a plan with the objects of a seed. `doorways` is empty: `doors` has any direction."""

    walls: tuple[WallBlock, ...] = field(repr=False)
    doors: tuple[PlanDoor, ...] = field(repr=False)
    outside: tuple[Obstacle, ...] = field(repr=False)

    def spec(self, *, visuals: bool = True) -> mujoco.MjSpec:
        model = mujoco_model.ModelBuilder(visuals)
        furniture = (*self.receptacles, *self.fixtures)
        blocked = [freespace.footprint(f) for f in furniture if mujoco_model.casts_shade(f)]
        plan_structure.add_structure(
            model, self.bounds, self.rooms, self.styles, self.walls, self.doors, blocked
        )
        model.contents(self.receptacles, self.fixtures, self.objects)
        return model.finish(self.bounds)

    def obstacles(self) -> list[Obstacle]:
        return [
            *wall_obstacles(self.walls),
            *self.outside,
            *(freespace.footprint(item) for item in self.receptacles),
            *(freespace.footprint(item) for item in self.fixtures if item.blocks),
        ]

    def _structure_classes(self) -> dict[str, str]:
        return plan_structure.classes_of(self.doors)

    def _feed_structure(self, digest: hashlib._Hash) -> None:
        for room in self.rooms:
            feed(digest, room.kind, *np.array(room.outline).ravel().tolist())
        for block in self.walls:
            feed(digest, "wall", block.x, block.y, block.yaw_rad, block.length_m, block.z0_m)

    def sample_episode(self, rng: np.random.Generator) -> Episode:
        """Random task that can be solved. Raises NoTask if this home has none."""
        objects = {thing.class_name for thing in self.objects}
        hosts = {host.class_name for host in self.receptacles}
        try:
            return task_sampling.sample_among(self.receptacles, self.objects, rng, objects, hosts)
        except task_sampling.NoTask:
            raise task_sampling.NoTask(
                f"{self.preset.name} has {len(self.objects)} household things on "
                f"{len(hosts)} kinds of furniture within reach, and a task needs a thing and two "
                "kinds; draw tables, shelves or other furniture that the robot can reach"
            ) from None


def wall_obstacles(walls: tuple[WallBlock, ...]) -> list[Obstacle]:
    """Footprints of the walls that block the robot."""
    return [block.footprint for block in walls if block.z0_m < PASSES_BELOW_M]
