"""A generated home: what stands where, its MuJoCo model, its free space and its tasks."""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
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


@dataclass(frozen=True)
class Home:
    """A home by seed. The same seed and preset give the same home.

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
        """The model of everything but the robot; without visuals only what collides."""
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
        """Class of a body of `spec()`: "mug", "dining table", "wall". KeyError for any other."""
        try:
            return self._classes[body_name]
        except KeyError:
            raise KeyError(
                f"no body {body_name!r} in home {self.seed}; ask for one of Home.body_names()"
            ) from None

    def body_names(self) -> tuple[str, ...]:
        """Names of all bodies of `spec()` but the world itself."""
        return tuple(self._classes)

    @cached_property
    def _classes(self) -> dict[str, str]:
        classes = mujoco_model.structure_classes(self.rooms, self.doorways)
        for thing in (*self.receptacles, *self.fixtures, *self.objects):
            classes[thing.name] = thing.class_name
        return classes

    def receptacle(self, name: str) -> Receptacle:
        """The receptacle of that body name. KeyError if there is none."""
        return self._receptacles[name]

    @cached_property
    def _receptacles(self) -> dict[str, Receptacle]:
        return {receptacle.name: receptacle for receptacle in self.receptacles}

    def structure_hash(self) -> str:
        """SHA-256 of what stands where, poses rounded to 1 mm: `drawn_hash` and the things.

        The things lie where the physics left them, so this is the same wherever the same version
        of MuJoCo gives the same results: in every process of a machine, and on machines alike.
        """
        digest = self._drawn()
        for thing in self.objects:
            _feed(digest, thing.name, *thing.position_m, thing.yaw_rad, *thing.size_m)
        return digest.hexdigest()

    def drawn_hash(self) -> str:
        """SHA-256 of rooms, doorways and furniture, poses rounded to 1 mm.

        Of preset ovmm-v1 the physics has no say in them (but for few seeds, whose things found no
        rest in the first draw: see generate): the same by seed on any machine, up to rounding
        errors of its arithmetic that would have to move something across 1 mm.
        """
        return self._drawn().hexdigest()

    def _drawn(self) -> "hashlib._Hash":
        digest = hashlib.sha256()
        for room in self.rooms:
            _feed(digest, room.kind, room.x0, room.y0, room.x1, room.y1)
        for door in self.doorways:
            _feed(digest, str(door.axis), door.x, door.y, door.width_m)
        for item in (*self.receptacles, *self.fixtures):
            _feed(digest, item.name, item.x, item.y, item.yaw_rad, *item.size_m)
        return digest

    def free_space(
        self, radius_m: float, cell_m: float = 0.05
    ) -> tuple[NDArray[np.bool_], tuple[float, float]]:
        """Cells [iy, ix] at whose middle a disc of that radius touches nothing, and the origin.

        Cell (iy, ix) has its middle at origin + ((ix + 0.5) cell_m, (iy + 0.5) cell_m).
        """
        clearance = freespace.clearance_m(
            self.bounds,
            freespace.obstacles(self.rooms, self.doorways, self.receptacles, self.fixtures),
            cell_m,
        )
        return clearance > radius_m, (self.bounds[0], self.bounds[1])

    def sample_episode(self, rng: np.random.Generator) -> Episode:
        """A task that can be solved; see `episodes`."""
        if self.preset.catalog == "ovmm":
            return task_sampling.sample_any(self.receptacles, self.objects, rng)
        return task_sampling.sample(self.receptacles, self.objects, rng)


def _feed(digest: "hashlib._Hash", name: str, *values: float) -> None:
    rounded = ",".join(str(round(value * 1000)) for value in values)
    digest.update(f"{name}:{rounded}\n".encode())
