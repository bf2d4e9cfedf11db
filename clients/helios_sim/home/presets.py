"""Presets of homes. A published preset never changes; a new one gets a new name."""

import hashlib
from dataclasses import dataclass, fields
from typing import Literal

_NEWER_FIELDS = frozenset({"layout", "corridor_width_m", "floor_area_m2", "room_preference"})


@dataclass(frozen=True)
class HomePreset:
    """All parameters of a home except its seed; pairs are inclusive ranges.

    `catalog` names the makers and recipes (`catalogs.py`); `min_receptacle_classes` counts the
    catalog's own classes ("demo") or the 21 classes of the OVMM benchmark ("ovmm"). `room_area_m2`
    is the mean area of a room, which sets width and depth within their limits; (0, 0): width and
    depth are drawn directly. With the layout "corridor", `width_m` limits the long side of the home
    and `depth_m` the short side, `room_area_m2` and `cut` are unused, and `extra_doorways` counts
    the doors between living room, dining room and kitchen.
    """

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
    view_distance_m: float = 1.5  # unused; kept because `digest` includes it
    camera_height_m: float = 1.31
    surface_height_m: tuple[float, float] = (0.3, 1.2)
    catalog: Literal["demo", "ovmm"] = "demo"
    room_area_m2: tuple[float, float] = (0.0, 0.0)
    hidden_objects: int = 0  # minimum number; see home_generator.HIDDEN_SHARE
    cut: tuple[float, float] = (0.42, 0.58)  # position of a cut, as a share of the divided length
    # Fields from here on count in `digest` only where they differ from their default.
    layout: Literal["partition", "corridor"] = "partition"  # floor_plans.py or corridor_plans.py
    corridor_width_m: tuple[float, float] = (0.0, 0.0)
    floor_area_m2: tuple[float, float] = (0.0, 0.0)  # of the whole home
    room_preference: float = 0.0  # share of objects in rooms that suit them; 0: any room

    @property
    def passage_radius_m(self) -> float:
        """Radius of the disc that can reach everything in the home."""
        return self.robot_radius_m + self.clearance_margin_m

    def digest(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the fields by name, for reports.

        Newer fields count only where they differ from their default. The digests of older presets
        therefore stay the same.
        """
        text = "\n".join(
            f"{f.name}={getattr(self, f.name)!r}"
            for f in fields(self)
            if f.name not in _NEWER_FIELDS or getattr(self, f.name) != f.default
        )
        return hashlib.sha256(text.encode()).hexdigest()[:16]


LARGE = "ovmm-large-v1"  # name of the preset of larger homes

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

OVMM_V1 = HomePreset(
    name="ovmm-v1",
    rooms=(4, 8),
    width_m=(7.8, 14.0),
    depth_m=(6.6, 10.5),
    min_room_side_m=2.5,
    doorway_width_m=(0.9, 1.05),
    extra_doorways=1,
    receptacles=(16, 28),
    min_receptacle_classes=12,
    objects=(30, 30),
    min_object_classes=20,
    chairs_per_table=(2, 4),
    surface_height_m=(0.1, 1.25),
    catalog="ovmm",
    room_area_m2=(12.5, 15.5),
    hidden_objects=3,
    cut=(0.38, 0.62),
)

OVMM_LARGE_V1 = HomePreset(
    name=LARGE,
    rooms=(11, 16),
    width_m=(15.0, 30.0),
    depth_m=(9.5, 12.5),
    min_room_side_m=2.1,
    doorway_width_m=(0.9, 1.05),
    extra_doorways=1,
    receptacles=(35, 60),
    min_receptacle_classes=16,
    objects=(50, 70),
    min_object_classes=28,
    chairs_per_table=(2, 4),
    surface_height_m=(0.1, 1.25),
    catalog="ovmm",
    hidden_objects=5,
    layout="corridor",
    corridor_width_m=(1.5, 2.1),
    floor_area_m2=(200.0, 350.0),
    room_preference=0.75,
)

PRESETS: dict[str, HomePreset] = {
    preset.name: preset for preset in (DEMO_V1, OVMM_V1, OVMM_LARGE_V1)
}

# Presets with the noise table of another, and the actions per task where they are not the paper's.
_NOISE = {LARGE: "ovmm-v1"}
_STEPS = {LARGE: 2500}
_PAPERS_STEPS = 1250


def noise_table_of(preset: str) -> str:
    """Name of the simulated detector's noise table in the homes of a preset."""
    return _NOISE.get(preset, preset)


def pick_and_place_steps_of(preset: str) -> int:
    """Number of actions that a pick-and-place task may take in the homes of a preset."""
    return _STEPS.get(preset, _PAPERS_STEPS)
