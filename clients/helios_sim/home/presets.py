"""Named kinds of homes. A preset never changes once published: a new one gets a new name."""

from dataclasses import dataclass


@dataclass(frozen=True)
class HomePreset:
    """Everything that a home depends on apart from its seed; pairs are inclusive ranges."""

    name: str
    rooms: tuple[int, int]
    width_m: tuple[float, float]
    depth_m: tuple[float, float]
    min_room_side_m: float
    doorway_width_m: tuple[float, float]
    extra_doorways: int
    receptacles: tuple[int, int]
    min_receptacle_classes: int
    objects: tuple[int, int]
    min_object_classes: int
    chairs_per_table: tuple[int, int]
    robot_radius_m: float = 0.3
    clearance_margin_m: float = 0.1
    reach_m: float = 0.75
    view_distance_m: float = 1.5
    camera_height_m: float = 1.31
    surface_height_m: tuple[float, float] = (0.3, 1.2)

    @property
    def passage_radius_m(self) -> float:
        """Radius of the disc for which everything in the home is reachable."""
        return self.robot_radius_m + self.clearance_margin_m


DEMO_V1 = HomePreset(
    name="demo-v1",
    rooms=(4, 5),
    width_m=(9.6, 11.6),
    depth_m=(8.2, 9.4),
    min_room_side_m=2.7,
    doorway_width_m=(1.1, 1.3),
    extra_doorways=1,
    receptacles=(12, 20),
    min_receptacle_classes=7,
    objects=(16, 20),
    min_object_classes=11,
    chairs_per_table=(1, 3),
)

PRESETS: dict[str, HomePreset] = {preset.name: preset for preset in (DEMO_V1,)}
