"""Catalog of the demo homes: classes, their makers, and the usual receptacles of each object."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from helios_sim.home import (
    cabinet_shapes,
    counter_shapes,
    decoration_shapes,
    other_objects,
    seating_shapes,
    table_shapes,
    tableware_objects,
)
from helios_sim.home.seating_shapes import Maker


@dataclass(frozen=True)
class Catalog:
    """Makers of furniture and objects for the homes of a preset, by class."""

    receptacles: Mapping[str, tuple[str, Maker]]  # class -> (stem of the body name, maker)
    fixtures: Mapping[str, Maker]
    objects: Mapping[str, tuple[Maker, tuple[str, ...]]]  # class -> (maker, likely receptacles)
    ovmm_class: Mapping[str, str] = field(default_factory=dict)  # own class -> OVMM class
    look_alikes: tuple[tuple[str, ...], ...] = ()  # groups of classes that are easily confused


class FurnitureModels(Protocol):
    """Replacement of the makers of a catalog; `name` is appended to the preset name of a home."""

    @property
    def name(self) -> str: ...

    def applied_to(self, catalog: Catalog) -> Catalog: ...


# Receptacle class -> (stem of the body name, maker).
RECEPTACLES: dict[str, tuple[str, Maker]] = {
    "sofa": ("sofa", seating_shapes.sofa),
    "armchair": ("armchair", seating_shapes.armchair),
    "coffee table": ("coffee_table", table_shapes.coffee_table),
    "side table": ("side_table", table_shapes.side_table),
    "TV stand": ("tv_stand", cabinet_shapes.tv_stand),
    "bookcase": ("bookcase", cabinet_shapes.bookcase),
    "kitchen counter": ("kitchen_counter", counter_shapes.kitchen_counter),
    "dining table": ("dining_table", table_shapes.dining_table),
    "bench": ("bench", seating_shapes.bench),
    "bed": ("bed", seating_shapes.bed),
    "nightstand": ("nightstand", cabinet_shapes.nightstand),
    "dresser": ("dresser", cabinet_shapes.dresser),
    "desk": ("desk", table_shapes.desk),
    "washstand": ("washstand", counter_shapes.washstand),
}

# Furniture and decoration that are no receptacles.
FIXTURES: dict[str, Maker] = {
    "chair": seating_shapes.chair,
    "plant": decoration_shapes.plant,
    "floor lamp": decoration_shapes.floor_lamp,
    "wardrobe": decoration_shapes.wardrobe,
    "fridge": decoration_shapes.fridge,
    "wall cabinet": decoration_shapes.wall_cabinet,
    "television": decoration_shapes.television,
    "picture": decoration_shapes.picture,
    "mirror": decoration_shapes.mirror,
    "window": decoration_shapes.window,
    "rug": decoration_shapes.rug,
    "toilet": decoration_shapes.toilet,
    "bathtub": decoration_shapes.bathtub,
}

_TABLES = ("coffee table", "dining table", "side table", "desk", "kitchen counter", "dresser")

# Object class -> (maker, receptacle classes on which it is likely).
OBJECTS: dict[str, tuple[Maker, tuple[str, ...]]] = {
    "mug": (tableware_objects.mug, (*_TABLES, "nightstand", "TV stand")),
    "bowl": (tableware_objects.bowl, ("coffee table", "dining table", "kitchen counter", "bench")),
    "plate": (tableware_objects.plate, ("coffee table", "dining table", "kitchen counter", "desk")),
    "bottle": (tableware_objects.bottle, ("kitchen counter", "dining table", "washstand", "desk")),
    "can": (tableware_objects.can, (*_TABLES, "TV stand", "nightstand")),
    "apple": (tableware_objects.apple, ("kitchen counter", "dining table", "coffee table", "desk")),
    "vase": (tableware_objects.vase, (*_TABLES, "bookcase", "TV stand")),
    "teapot": (
        tableware_objects.teapot,
        ("kitchen counter", "dining table", "coffee table", "side table"),
    ),
    "candle": (
        tableware_objects.candle,
        ("washstand", "nightstand", "coffee table", "dresser", "bench"),
    ),
    "book": (
        other_objects.book,
        ("sofa", "armchair", "desk", "nightstand", "bed", "bookcase", "bench"),
    ),
    "box": (other_objects.box, ("desk", "dresser", "bench", "bed", "bookcase", "kitchen counter")),
    "teddy bear": (other_objects.teddy_bear, ("bed", "sofa", "armchair", "bench", "dresser")),
    "toy car": (
        other_objects.toy_car,
        ("bed", "coffee table", "sofa", "TV stand", "bench", "desk"),
    ),
    "ball": (other_objects.ball, ("armchair", "bed", "sofa", "bench", "desk", "dresser")),
    "lamp": (
        other_objects.lamp,
        ("nightstand", "side table", "desk", "dresser", "bookcase", "TV stand"),
    ),
    "alarm clock": (other_objects.alarm_clock, ("nightstand", "desk", "bookcase", "dresser")),
    "remote control": (
        other_objects.remote_control,
        ("sofa", "coffee table", "TV stand", "armchair"),
    ),
    "pot plant": (
        other_objects.pot_plant,
        ("bookcase", "desk", "washstand", "TV stand", "dresser"),
    ),
}

DEMO = Catalog(RECEPTACLES, FIXTURES, OBJECTS)
