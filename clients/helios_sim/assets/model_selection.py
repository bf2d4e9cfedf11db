"""Selection of catalogue entries for each object class, and their kind for baking.

Selected by eye: household objects of plausible size, with their front at -y and without flat
textured leaves. A class that is not listed keeps its parametric shapes.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Literal

Kind = Literal["hard", "seat", "soft", "thing"]


@dataclass(frozen=True)
class Choice:
    """Entries for one class. A tuple of keys is a row of modules, left to right.

    `kind` sets the level of detail and the required flatness of surfaces: hard furniture, a seat,
    soft furniture, or "thing" for a movable object.
    """

    class_name: str
    kind: Kind
    keys: tuple[str | tuple[str, ...], ...]


_S, _0, _B, _K = "Scopia/", "BlendSwap-CC-0/", "BlendSwap-CC-BY/", "KatorLegaz/"


def _of(library: str, *names: str) -> tuple[str, ...]:
    return tuple(library + name for name in names)


_LOW_0, _SINK_0, _DRAWERS_0 = _of(_0, "lowerCabinet", "sinkCabinet", "drawersCabinet")
_LOW_B, _SINK_B, _DRAWERS_B, _SMALL_B = _of(
    _B, "kitchenLowerCabinet", "kitchenSink", "kitchenDrawersCabinet", "kitchenSmallLowerCabinet"
)
_SOFAS = (
    *_of(_S, "simple_sofa", "beige_sofa", "beige_sofa_2seats"),
    *_of(_S, "leather_sofa", "sofa_white_beige"),
    *_of(_0, "couch", "sofa2", "winchesterSofa"),
    *_of(_B, "sofa2", "couch3"),
    *_of(_K, "futon-couch", "mid-century-sofa"),
)
_ARMCHAIRS = (
    *_of(_S, "armchair", "armchair2", "armchair3"),
    *_of(_0, "armchair2", "winchesterArmchair", "modernArmchair"),
    *_of(_B, "armchair1", "fotel"),
)
_CHAIRS = (
    *_of(_S, "chair", "chair3", "chair4", "white_kitchen_chair", "plastic_chair"),
    *_of(_S, "tubular_chair"),
    *_of(_0, "chair2", "osakaChair", "plasticChair", "thonet"),
    *_of(_B, "chairWithCushion", "ella_chair_f", "plaidChair", "kitchenChair", "chair3"),
    *_of(_B, "cafe_set_tonon_chair"),
    *_of(_K, "dining-chair"),
)
_TABLES = (
    *_of(_S, "black_table", "table4", "wooden_table_office", "white_kitchen_table", "round-table"),
    *_of(_S, "table-with-leaning-feet", "metal_glass_table"),
    *_of(_0, "oakTable"),
    *_of(_B, "table"),
    *_of(_K, "glass-dining-table"),
)
_COFFEE_TABLES = (
    *_of(_S, "saloon_table", "table_wood_and_iron", "coffee-table2", "living_room_table"),
    *_of(_B, "coffeeTable"),
)
_SIDE_TABLES = (*_of(_B, "cafe_set_mota_table", "cafe_set_tonon_table"),)
_COUNTERS = (
    (_LOW_0, _SINK_0, _DRAWERS_0),
    (_DRAWERS_0, _LOW_0, _SINK_0, _LOW_0),
    (_SINK_B, _LOW_B),
    (_DRAWERS_B, _LOW_B, _SMALL_B),
)
_SHELVES = _of(_0, "bookcase")
_BEDS = (
    *_of(_S, "bed1", "iron_bed", "captains-bed"),
    *_of(_0, "bed2"),
    *_of(_B, "juniorBed"),
)
_LAMPS = (
    *_of(_S, "little_lamp1", "little_lamp2", "livingroom_lamp1"),
    *_of(_0, "desklamp"),
    *_of(_B, "lamp"),
)
_POT_PLANTS = (
    *_of(_S, "maceta"),
    *_of(_0, "littlePlant", "cactus"),
    *_of(_B, "succulentPlant", "luckyBamboo"),
)

CHOICES: tuple[Choice, ...] = (
    Choice("sofa", "soft", _SOFAS),
    Choice("armchair", "soft", _ARMCHAIRS),
    Choice("chair", "seat", _CHAIRS),
    Choice("bench", "seat", _of(_K, "bench")),
    Choice("stool", "seat", (*_of(_0, "stool2"), *_of(_B, "green_stool"))),
    Choice("dining table", "hard", _TABLES),
    Choice("coffee table", "hard", _COFFEE_TABLES),
    Choice("side table", "hard", _SIDE_TABLES),
    Choice("desk", "hard", (
        *_of(_S, "kids_desk_table", "kids_wooden_desk"),
        *_of(_B, "simpleDesk", "officeTable"),
        *_of(_0, "lbDesk"),
    )),
    Choice("TV stand", "hard", _of(_B, "tvStand")),
    Choice("nightstand", "hard", (*_of(_B, "bedsideTable"), *_of(_0, "bedsideTable2"))),
    Choice("dresser", "hard", (*_of(_S, "changing-table"), *_of(_B, "dresserWithDrawers"))),
    Choice("sideboard", "hard", _of(_B, "chest", "dresserWithDrawers")),
    Choice("filing cabinet", "hard", _of(_K, "filing-cabinet")),
    Choice("bookcase", "hard", _SHELVES),
    Choice("kitchen counter", "hard", _COUNTERS),
    Choice("washstand", "hard", _of(_0, "modernVanity")),
    Choice("washing machine", "hard", _of(_S, "clothes_washing_machine", "dryer_machine")),
    Choice("bed", "soft", _BEDS),
    Choice("wardrobe", "hard", (
        *_of(_S, "wardrobe1"),
        *_of(_B, "wardrobe", "wardrobe2"),
        *_of(_0, "wardrobeWithSlidingDoors"),
    )),
    Choice("fridge", "hard", (*_of(_0, "refrigerator", "largeFridge"), *_of(_K, "fridge"))),
    Choice("toilet", "hard", (
        *_of(_0, "toiletsUnit"),
        *_of(_B, "toilets_unit_jay_hardy", "modernToilet"),
    )),
    Choice("plant", "hard", (
        *_of(_B, "mediumIndoorPlant"),
    )),
    Choice("mug", "thing", _of(_K, "coffee-mug")),
    Choice("glass", "thing", (*_of(_K, "12-oz-glass", "highball-glass"), *_of(_B, "glass"))),
    Choice("jar", "thing", (*_of(_S, "sugar", "pottery"), *_of(_0, "cosmeticsPot"))),
    Choice("bowl", "thing", _of(_S, "bowl")),
    Choice("plate", "thing", _of(_K, "bread-plate", "dinner-plate")),
    Choice("pan", "thing", _of(_B, "largePan")),
    Choice("bottle", "thing", (
        *_of(_S, "wine_bottle", "com_bath", "medicoscopia_bottle2"),
        *_of(_B, "beer_bottle"),
        *_of(_K, "red-wine-bottle-01"),
        *_of(_0, "yogurtBottle"),
    )),
    Choice("vase", "thing", _of(_S, "vase1", "vase3", "jar")),
    Choice("jug", "thing", _of(_S, "old_jar", "creamer")),
    Choice("teapot", "thing", _of(_S, "teapot")),
    Choice("kettle", "thing", _of(_B, "espressokettle")),
    Choice("salt shaker", "thing", _of(_B, "saltShaker")),
    Choice("box", "thing", (*_of(_S, "cardboard-box", "medicoscopia_box"), *_of(_B, "gift"))),
    Choice("tablet", "thing", _of(_S, "tablet")),
    Choice("laptop", "thing", (*_of(_B, "laptop"), *_of(_K, "apple-ibook-2001"))),
    Choice("phone", "thing", (*_of(_B, "mobile"), *_of(_0, "iphone"))),
    Choice("remote control", "thing", _of(_S, "tv-remote-control")),
    Choice("stapler", "thing", _of(_K, "stapler")),
    Choice("picture frame", "thing", _of(_S, "frame1", "frame2")),
    Choice("lamp", "thing", _LAMPS),
    Choice("pot plant", "thing", _POT_PLANTS),
    Choice("teddy bear", "thing", _of(_0, "teddyBear")),
    Choice("toy car", "thing", _of(_B, "carrito-de-madera")),
    Choice("ball", "thing", (*_of(_0, "basketball"), *_of(_B, "ballonFoot"))),
    Choice("towel", "thing", _of(_S, "com_bath3_toalla")),
    Choice("soap dispenser", "thing", _of(_S, "com_bath2_soap")),
    Choice("sponge", "thing", _of(_S, "com_bath2_esponja")),
    Choice("hat", "thing", _of(_S, "chapeau")),
    Choice("basket", "thing", _of(_S, "shopping-basket")),
)  # fmt: skip


def digest(choices: tuple[Choice, ...]) -> str:
    """SHA-256 of the selection table."""
    return hashlib.sha256(repr(choices).encode()).hexdigest()
