"""Catalog of the benchmark homes: all 21 receptacle classes of OVMM and 42 object classes.

Receptacles have own class names that suit plain language; `OVMM_CLASS` maps each of them to its
class in OVMM (bathtub, bed, bench, cabinet, chair, chest of drawers, couch, counter, filing
cabinet, hamper, serving cart, shelves, shoe rack, sink, stand, stool, table, toilet, trunk,
wardrobe, washer/dryer).
"""

from helios_sim.home import (
    cabinet_shapes,
    counter_shapes,
    decoration_shapes,
    desk_objects,
    doors,
    household_objects,
    kitchen_objects,
    other_furniture_shapes,
    other_objects,
    room_fixtures,
    seating_shapes,
    shelf_shapes,
    table_shapes,
    tableware_objects,
)
from helios_sim.home.catalog import Catalog
from helios_sim.home.seating_shapes import Maker
from helios_sim.home.shape_variation import varied

# Own class -> (stem of the body name, maker, OVMM class).
_RECEPTACLES: dict[str, tuple[str, Maker, str]] = {
    "sofa": ("sofa", seating_shapes.sofa, "couch"),
    "armchair": ("armchair", seating_shapes.armchair, "chair"),
    "chair": ("chair", other_furniture_shapes.chair, "chair"),
    "stool": ("stool", other_furniture_shapes.stool, "stool"),
    "bench": ("bench", seating_shapes.bench, "bench"),
    "bed": ("bed", seating_shapes.bed, "bed"),
    "coffee table": ("coffee_table", table_shapes.coffee_table, "table"),
    "side table": ("side_table", table_shapes.side_table, "table"),
    "dining table": ("dining_table", table_shapes.dining_table, "table"),
    "desk": ("desk", table_shapes.desk, "table"),
    "TV stand": ("tv_stand", cabinet_shapes.tv_stand, "stand"),
    "nightstand": ("nightstand", cabinet_shapes.nightstand, "stand"),
    "dresser": ("dresser", cabinet_shapes.dresser, "chest of drawers"),
    "sideboard": ("sideboard", other_furniture_shapes.sideboard, "cabinet"),
    "filing cabinet": ("filing_cabinet", other_furniture_shapes.filing_cabinet, "filing cabinet"),
    "bookcase": ("bookcase", shelf_shapes.bookcase, "shelves"),
    "shelf": ("shelf", shelf_shapes.shelf, "shelves"),
    "shoe rack": ("shoe_rack", shelf_shapes.shoe_rack, "shoe rack"),
    "serving cart": ("serving_cart", shelf_shapes.serving_cart, "serving cart"),
    "wardrobe": ("wardrobe", shelf_shapes.wardrobe, "wardrobe"),
    "trunk": ("trunk", other_furniture_shapes.trunk, "trunk"),
    "hamper": ("hamper", other_furniture_shapes.hamper, "hamper"),
    "kitchen counter": ("kitchen_counter", counter_shapes.kitchen_counter, "counter"),
    "washstand": ("washstand", counter_shapes.washstand, "sink"),
    "bathtub": ("bathtub", other_furniture_shapes.bathtub, "bathtub"),
    "toilet": ("toilet", other_furniture_shapes.toilet, "toilet"),
    "washing machine": ("washing_machine", other_furniture_shapes.washing_machine, "washer/dryer"),
}

OVMM_CLASS: dict[str, str] = {name: row[2] for name, row in _RECEPTACLES.items()}

_FIXTURES: dict[str, Maker] = {
    "plant": decoration_shapes.plant,
    "floor lamp": decoration_shapes.floor_lamp,
    "fridge": decoration_shapes.fridge,
    "wall cabinet": decoration_shapes.wall_cabinet,
    "television": decoration_shapes.television,
    "picture": decoration_shapes.picture,
    "mirror": decoration_shapes.mirror,
    "window": decoration_shapes.window,
    "rug": decoration_shapes.rug,
    "door": doors.door_leaf,
    "ceiling lamp": room_fixtures.ceiling_lamp,
    "towel rail": room_fixtures.towel_rail,
    "coat rack": room_fixtures.coat_rack,
    "wall clock": room_fixtures.wall_clock,
    "cooker": room_fixtures.cooker,
}

_TOPS = ("coffee table", "dining table", "side table", "desk", "kitchen counter", "sideboard")
_KITCHEN = ("kitchen counter", "dining table", "serving cart", "sideboard", "shelf")
_SEATS = ("sofa", "armchair", "chair", "stool", "bench", "bed")
_STORES = ("shelf", "bookcase", "wardrobe", "dresser", "sideboard", "trunk")
_BATH = ("washstand", "bathtub", "toilet", "washing machine", "hamper", "shelf")
_OFFICE = ("desk", "filing cabinet", "bookcase", "side table")
_LOUNGE = ("coffee table", "sofa", "armchair", "TV stand", "side table")
_BEDSIDE = ("nightstand", "bed", "dresser")

_PRINT = ("dots", "stripes", "checks", "bands")
_GLAZED = ("ceramic", "dots", "bands")

# Class -> (maker, receptacle classes on which it is likely).
_OBJECTS: dict[str, tuple[Maker, tuple[str, ...]]] = {
    # tableware
    "mug": (varied(tableware_objects.mug, textures=_GLAZED, lies=0.1), (*_TOPS, *_BEDSIDE)),
    "glass": (varied(kitchen_objects.glass), (*_TOPS, "serving cart", "nightstand")),
    "can": (
        varied(tableware_objects.can, (0.9, 1.15), lies=0.2),
        (*_TOPS, "serving cart", "trunk"),
    ),
    "candle": (varied(tableware_objects.candle, (0.85, 1.15)), (*_BATH, *_STORES, "coffee table")),
    "jar": (varied(kitchen_objects.jar), (*_KITCHEN, "washing machine")),
    "bowl": (
        varied(tableware_objects.bowl, (0.85, 1.15), _GLAZED),
        (*_KITCHEN, "coffee table", "bench"),
    ),
    "plate": (varied(tableware_objects.plate, (0.8, 1.1), _GLAZED), (*_KITCHEN, "desk", "stool")),
    "pan": (varied(kitchen_objects.pan), (*_KITCHEN, "stool")),
    "bottle": (
        varied(tableware_objects.bottle, lies=0.1),
        (*_KITCHEN, *_BATH, "desk", "nightstand"),
    ),
    "vase": (varied(tableware_objects.vase, textures=_GLAZED), (*_TOPS, *_STORES, "TV stand")),
    "jug": (varied(kitchen_objects.jug, textures=_GLAZED), (*_KITCHEN, "coffee table")),
    "teapot": (varied(tableware_objects.teapot, textures=_GLAZED), (*_KITCHEN, "coffee table")),
    "kettle": (varied(kitchen_objects.kettle, (0.9, 1.1)), ("kitchen counter", "serving cart")),
    "salt shaker": (varied(kitchen_objects.salt_shaker), _KITCHEN),
    "apple": (varied(tableware_objects.apple, (0.9, 1.1)), (*_KITCHEN, "coffee table", "desk")),
    "orange": (varied(kitchen_objects.orange, (0.9, 1.15)), (*_KITCHEN, "coffee table", "bed")),
    "banana": (varied(kitchen_objects.banana, (0.95, 1.15)), (*_KITCHEN, "desk", "nightstand")),
    # desk and sofa
    "book": (
        varied(other_objects.book, (0.8, 1.15), _PRINT),
        (*_OFFICE, *_SEATS, *_BEDSIDE, *_STORES),
    ),
    "box": (
        varied(other_objects.box, (0.8, 1.25), _PRINT),
        (*_STORES, *_OFFICE, "washing machine"),
    ),
    "tablet": (varied(desk_objects.tablet, (0.9, 1.1)), (*_LOUNGE, *_OFFICE, *_BEDSIDE)),
    "laptop": (varied(desk_objects.laptop, (0.9, 1.05)), (*_OFFICE, "dining table", "bed", "sofa")),
    "phone": (
        varied(desk_objects.phone, (0.95, 1.1)),
        (*_LOUNGE, *_OFFICE, *_BEDSIDE, "washstand"),
    ),
    "remote control": (varied(other_objects.remote_control, (0.85, 1.1)), (*_LOUNGE, "bed")),
    "stapler": (varied(desk_objects.stapler), _OFFICE),
    "tape roll": (varied(desk_objects.tape_roll), (*_OFFICE, "trunk", "washing machine")),
    "tissue box": (varied(desk_objects.tissue_box, (0.85, 1.05)), (*_BEDSIDE, *_LOUNGE, "toilet")),
    "picture frame": (
        varied(desk_objects.picture_frame),
        (*_STORES, *_BEDSIDE, "desk", "TV stand"),
    ),
    "alarm clock": (varied(other_objects.alarm_clock, (0.85, 1.15)), (*_BEDSIDE, *_OFFICE)),
    "lamp": (
        varied(other_objects.lamp, (0.85, 1.1)),
        ("nightstand", "side table", "desk", "sideboard"),
    ),
    "pot plant": (varied(other_objects.pot_plant), (*_STORES, *_TOPS, "stool", "washstand")),
    # toys
    "teddy bear": (varied(other_objects.teddy_bear, (0.8, 1.15)), (*_SEATS, "trunk", "shelf")),
    "toy car": (varied(other_objects.toy_car, textures=("stripes",)), (*_SEATS, *_LOUNGE, "trunk")),
    "puzzle cube": (varied(desk_objects.puzzle_cube, (0.9, 1.15)), (*_LOUNGE, *_OFFICE, "bed")),
    "ball": (varied(other_objects.ball, (0.8, 1.15), _PRINT), (*_SEATS, "shelf", "trunk")),
    # cloth, bath and hall
    "towel": (varied(household_objects.towel, (0.85, 1.1)), (*_BATH, "bed", "bench", "wardrobe")),
    "toilet paper": (varied(household_objects.toilet_paper, (0.9, 1.1)), _BATH),
    "soap dispenser": (varied(household_objects.soap_dispenser), (*_BATH, "kitchen counter")),
    "sponge": (varied(household_objects.sponge), (*_BATH, "kitchen counter")),
    "shoe": (
        varied(household_objects.shoe, (0.85, 1.1)),
        ("shoe rack", "bench", "wardrobe", "trunk"),
    ),
    "hat": (varied(household_objects.hat, (0.9, 1.1)), (*_STORES, "bench", "shoe rack", "chair")),
    "basket": (
        varied(household_objects.basket, (0.85, 1.1)),
        (*_STORES, *_TOPS, "washing machine"),
    ),
    "cushion": (varied(household_objects.cushion, (0.85, 1.1)), (*_SEATS, "trunk")),
}

_LOOK_ALIKES = (
    ("mug", "glass", "can", "candle", "jar", "toilet paper"),
    ("bowl", "plate", "pan", "hat", "basket"),
    ("bottle", "vase", "jug", "soap dispenser", "salt shaker", "kettle", "teapot"),
    ("book", "box", "tablet", "tissue box", "laptop", "towel", "cushion"),
    ("phone", "remote control", "tablet", "stapler", "sponge"),
    ("apple", "orange", "ball"),
    ("alarm clock", "picture frame", "puzzle cube", "box", "tape roll"),
    ("lamp", "pot plant", "vase"),
    ("shoe", "toy car", "banana"),
)

OVMM = Catalog(
    receptacles={name: (stem, make) for name, (stem, make, _) in _RECEPTACLES.items()},
    fixtures=_FIXTURES,
    objects=_OBJECTS,
    ovmm_class=OVMM_CLASS,
    look_alikes=_LOOK_ALIKES,
)
