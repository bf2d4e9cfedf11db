"""Which classes there are, how they are made, and where each stands by custom."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from helios_sim.home import decor, fitted, seating, storage, tables, tableware, things
from helios_sim.home.seating import Maker


@dataclass(frozen=True)
class Catalog:
    """What the homes of a preset are made of, by class."""

    receptacles: Mapping[str, tuple[str, Maker]]  # class -> (stem of the body name, maker)
    fixtures: Mapping[str, Maker]
    objects: Mapping[str, tuple[Maker, tuple[str, ...]]]  # class -> (maker, likely receptacles)
    ovmm_class: Mapping[str, str] = field(default_factory=dict)  # ours -> the benchmark's
    look_alikes: tuple[tuple[str, ...], ...] = ()  # classes that are taken for each other


class Dressing(Protocol):
    """Other makers for the classes of a catalog; `name` marks homes that are made with them."""

    @property
    def name(self) -> str: ...

    def over(self, catalog: Catalog) -> Catalog: ...


# Receptacle class -> (stem of the body name, maker).
RECEPTACLES: dict[str, tuple[str, Maker]] = {
    "sofa": ("sofa", seating.sofa),
    "armchair": ("armchair", seating.armchair),
    "coffee table": ("coffee_table", tables.coffee_table),
    "side table": ("side_table", tables.side_table),
    "TV stand": ("tv_stand", storage.tv_stand),
    "bookcase": ("bookcase", storage.bookcase),
    "kitchen counter": ("kitchen_counter", fitted.kitchen_counter),
    "dining table": ("dining_table", tables.dining_table),
    "bench": ("bench", seating.bench),
    "bed": ("bed", seating.bed),
    "nightstand": ("nightstand", storage.nightstand),
    "dresser": ("dresser", storage.dresser),
    "desk": ("desk", tables.desk),
    "washstand": ("washstand", fitted.washstand),
}

# Furniture and decoration that is no receptacle.
FIXTURES: dict[str, Maker] = {
    "chair": seating.chair,
    "plant": decor.plant,
    "floor lamp": decor.floor_lamp,
    "wardrobe": decor.wardrobe,
    "fridge": decor.fridge,
    "wall cabinet": decor.wall_cabinet,
    "television": decor.television,
    "picture": decor.picture,
    "mirror": decor.mirror,
    "window": decor.window,
    "rug": decor.rug,
    "toilet": decor.toilet,
    "bathtub": decor.bathtub,
}

_TABLES = ("coffee table", "dining table", "side table", "desk", "kitchen counter", "dresser")

# Object class -> (maker, receptacle classes on which it is likely).
OBJECTS: dict[str, tuple[Maker, tuple[str, ...]]] = {
    "mug": (tableware.mug, (*_TABLES, "nightstand", "TV stand")),
    "bowl": (tableware.bowl, ("coffee table", "dining table", "kitchen counter", "bench")),
    "plate": (tableware.plate, ("coffee table", "dining table", "kitchen counter", "desk")),
    "bottle": (tableware.bottle, ("kitchen counter", "dining table", "washstand", "desk")),
    "can": (tableware.can, (*_TABLES, "TV stand", "nightstand")),
    "apple": (tableware.apple, ("kitchen counter", "dining table", "coffee table", "desk")),
    "vase": (tableware.vase, (*_TABLES, "bookcase", "TV stand")),
    "teapot": (tableware.teapot, ("kitchen counter", "dining table", "coffee table", "side table")),
    "candle": (tableware.candle, ("washstand", "nightstand", "coffee table", "dresser", "bench")),
    "book": (things.book, ("sofa", "armchair", "desk", "nightstand", "bed", "bookcase", "bench")),
    "box": (things.box, ("desk", "dresser", "bench", "bed", "bookcase", "kitchen counter")),
    "teddy bear": (things.teddy_bear, ("bed", "sofa", "armchair", "bench", "dresser")),
    "toy car": (things.toy_car, ("bed", "coffee table", "sofa", "TV stand", "bench", "desk")),
    "ball": (things.ball, ("armchair", "bed", "sofa", "bench", "desk", "dresser")),
    "lamp": (things.lamp, ("nightstand", "side table", "desk", "dresser", "bookcase", "TV stand")),
    "alarm clock": (things.alarm_clock, ("nightstand", "desk", "bookcase", "dresser")),
    "remote control": (things.remote_control, ("sofa", "coffee table", "TV stand", "armchair")),
    "pot plant": (things.pot_plant, ("bookcase", "desk", "washstand", "TV stand", "dresser")),
}

DEMO = Catalog(RECEPTACLES, FIXTURES, OBJECTS)
