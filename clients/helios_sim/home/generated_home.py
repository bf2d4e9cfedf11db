"""Generated home: layout, MuJoCo model, free space and tasks."""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from helios_sim.home import freespace, mujoco_model, task_sampling
from helios_sim.home.home_types import (
    Doorway,
    Episode,
    Fixture,
    Receptacle,
    Room,
    RoomStyle,
    SceneObject,
)
from helios_sim.home.presets import HomePreset
from helios_sim.mujoco_library import mujoco


@dataclass(frozen=True)
class Home:
    """Home generated from a seed. The same seed and preset give the same home.

    `bounds` is (x0, y0, x1, y1) in metres; `start_pose` is (x, y, yaw) with room for a robot.
    """

    seed: int
    preset: HomePreset
    rooms: tuple[Room, ...]
    doorways: tuple[Doorway, ...]
    receptacles: tuple[Receptacle, ...]
    objects: tuple[SceneObject, ...]
    fixtures: tuple[Fixture, ...]
    start_pose: tuple[float, float, float]
    bounds: tuple[float, float, float, float]
    styles: tuple[RoomStyle, ...] = field(repr=False)

    def spec(self, *, visuals: bool = True) -> mujoco.MjSpec:
        """MuJoCo model without a robot; without visuals only collision geoms."""
        return mujoco_model.assemble(
            self.rooms,
            self.doorways,
            self.receptacles,
            self.fixtures,
            self.objects,
            self.styles,
            visuals=visuals,
        )

    def class_of(self, body_name: str) -> str:
        """Class of a body of `spec()`, such as "mug" or "wall". Raises KeyError for other names."""
        try:
            return self._classes[body_name]
        except KeyError:
            raise KeyError(
                f"no body {body_name!r} in home {self.seed}; ask for one of Home.body_names()"
            ) from None

    def body_names(self) -> tuple[str, ...]:
        """Names of all bodies of `spec()` except the world body."""
        return tuple(self._classes)

    @cached_property
    def _classes(self) -> dict[str, str]:
        classes = self._structure_classes()
        for thing in (*self.receptacles, *self.fixtures, *self.objects):
            classes[thing.name] = thing.class_name
        return classes

    def _structure_classes(self) -> dict[str, str]:
        return mujoco_model.structure_classes(self.rooms, self.doorways)

    def receptacle(self, name: str) -> Receptacle:
        """Receptacle of that body name. Raises KeyError if there is none."""
        return self._receptacles[name]

    @cached_property
    def _receptacles(self) -> dict[str, Receptacle]:
        return {receptacle.name: receptacle for receptacle in self.receptacles}

    def structure_hash(self) -> str:
        """SHA-256 of rooms, doorways, furniture and objects, poses rounded to 1 mm.

        Object poses result from the physics. The hash is therefore the same in all processes and
        on all machines where the same version of MuJoCo gives the same results.
        """
        digest = self._drawn()
        for thing in self.objects:
            feed(digest, thing.name, *thing.position_m, thing.yaw_rad, *thing.size_m)
        return digest.hexdigest()

    def drawn_hash(self) -> str:
        """SHA-256 of rooms, doorways and furniture, poses rounded to 1 mm.

        In preset ovmm-v1 they do not depend on the physics, except for a few seeds whose first
        draw failed in the physics (see `home_generator`). The hash of a seed is then the same on
        any machine, unless a rounding error moves a value across a 1 mm step.
        """
        return self._drawn().hexdigest()

    def _drawn(self) -> "hashlib._Hash":
        digest = hashlib.sha256()
        self._feed_structure(digest)
        for item in (*self.receptacles, *self.fixtures):
            feed(digest, item.name, item.x, item.y, item.yaw_rad, *item.size_m)
        return digest

    def _feed_structure(self, digest: "hashlib._Hash") -> None:
        for room in self.rooms:
            feed(digest, room.kind, room.x0, room.y0, room.x1, room.y1)
        for door in self.doorways:
            feed(digest, str(door.axis), door.x, door.y, door.width_m)

    def obstacles(self) -> list[freespace.Obstacle]:
        """Walls, and footprints of all furniture that blocks a robot."""
        return freespace.obstacles(self.rooms, self.doorways, self.receptacles, self.fixtures)

    def free_space(
        self, radius_m: float, cell_m: float = 0.05
    ) -> tuple[NDArray[np.bool_], tuple[float, float]]:
        """Mask [iy, ix] of cells at whose centre a disc of that radius is free, and its origin.

        The centre of cell (iy, ix) is origin + ((ix + 0.5) cell_m, (iy + 0.5) cell_m).
        """
        clearance = freespace.clearance_m(self.bounds, self.obstacles(), cell_m)
        return clearance > radius_m, (self.bounds[0], self.bounds[1])

    def sample_episode(self, rng: np.random.Generator) -> Episode:
        """Random task that can be solved; see `task_sampling`."""
        if self.preset.catalog == "ovmm":
            return task_sampling.sample_any(self.receptacles, self.objects, rng)
        return task_sampling.sample(self.receptacles, self.objects, rng)


def feed(digest: "hashlib._Hash", name: str, *values: float) -> None:
    """Add a name and lengths (m) or angles (rad), rounded to thousandths, to a digest."""
    rounded = ",".join(str(round(value * 1000)) for value in values)
    digest.update(f"{name}:{rounded}\n".encode())
