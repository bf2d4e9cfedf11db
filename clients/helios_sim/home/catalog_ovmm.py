"""Classes of the benchmark's homes: all 21 receptacle classes of OVMM, 42 classes of things.

We keep plain names where they are better for language: `OVMM_CLASS` says which class of the
benchmark each of our receptacles is (its list: bathtub, bed, bench, cabinet, chair, chest of
drawers, couch, counter, filing cabinet, hamper, serving cart, shelves, shoe rack, sink, stand,
stool, table, toilet, trunk, wardrobe, washer/dryer).
"""

from helios_sim.home import (
    decor,
    doors,
    extras,
    fitted,
    gadgets,
    household,
    kitchenware,
    seating,
    shelving,
    storage,
    tables,
    tableware,
    things,
    utility,
)
from helios_sim.home.catalog import Catalog
from helios_sim.home.seating import Maker
from helios_sim.home.variety import varied

# Ours -> (stem of the body name, maker, class of the benchmark).
_RECEPTACLES: dict[str, tuple[str, Maker, str]] = {
    "sofa": ("sofa", seating.sofa, "couch"),
    "armchair": ("armchair", seating.armchair, "chair"),
    "chair": ("chair", utility.chair, "chair"),
    "stool": ("stool", utility.stool, "stool"),
    "bench": ("bench", seating.bench, "bench"),
    "bed": ("bed", seating.bed, "bed"),
    "coffee table": ("coffee_table", tables.coffee_table, "table"),
    "side table": ("side_table", tables.side_table, "table"),
    "dining table": ("dining_table", tables.dining_table, "table"),
    "desk": ("desk", tables.desk, "table"),
    "TV stand": ("tv_stand", storage.tv_stand, "stand"),
    "nightstand": ("nightstand", storage.nightstand, "stand"),
    "dresser": ("dresser", storage.dresser, "chest of drawers"),
    "sideboard": ("sideboard", utility.sideboard, "cabinet"),
    "filing cabinet": ("filing_cabinet", utility.filing_cabinet, "filing cabinet"),
    "bookcase": ("bookcase", shelving.bookcase, "shelves"),
    "shelf": ("shelf", shelving.shelf, "shelves"),
    "shoe rack": ("shoe_rack", shelving.shoe_rack, "shoe rack"),
    "serving cart": ("serving_cart", shelving.serving_cart, "serving cart"),
    "wardrobe": ("wardrobe", shelving.wardrobe, "wardrobe"),
    "trunk": ("trunk", utility.trunk, "trunk"),
    "hamper": ("hamper", utility.hamper, "hamper"),
    "kitchen counter": ("kitchen_counter", fitted.kitchen_counter, "counter"),
    "washstand": ("washstand", fitted.washstand, "sink"),
    "bathtub": ("bathtub", utility.bathtub, "bathtub"),
    "toilet": ("toilet", utility.toilet, "toilet"),
    "washing machine": ("washing_machine", utility.washing_machine, "washer/dryer"),
}

OVMM_CLASS: dict[str, str] = {name: row[2] for name, row in _RECEPTACLES.items()}

_FIXTURES: dict[str, Maker] = {
    "plant": decor.plant,
    "floor lamp": decor.floor_lamp,
    "fridge": decor.fridge,
    "wall cabinet": decor.wall_cabinet,
    "television": decor.television,
    "picture": decor.picture,
    "mirror": decor.mirror,
    "window": decor.window,
    "rug": decor.rug,
    "door": doors.door_leaf,
    "ceiling lamp": extras.ceiling_lamp,
    "towel rail": extras.towel_rail,
    "coat rack": extras.coat_rack,
    "wall clock": extras.wall_clock,
    "cooker": extras.cooker,
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
    "mug": (varied(tableware.mug, textures=_GLAZED, lies=0.1), (*_TOPS, *_BEDSIDE)),
    "glass": (varied(kitchenware.glass), (*_TOPS, "serving cart", "nightstand")),
    "can": (varied(tableware.can, (0.9, 1.15), lies=0.2), (*_TOPS, "serving cart", "trunk")),
    "candle": (varied(tableware.candle, (0.85, 1.15)), (*_BATH, *_STORES, "coffee table")),
    "jar": (varied(kitchenware.jar), (*_KITCHEN, "washing machine")),
    "bowl": (varied(tableware.bowl, (0.85, 1.15), _GLAZED), (*_KITCHEN, "coffee table", "bench")),
    "plate": (varied(tableware.plate, (0.8, 1.1), _GLAZED), (*_KITCHEN, "desk", "stool")),
    "pan": (varied(kitchenware.pan), (*_KITCHEN, "stool")),
    "bottle": (varied(tableware.bottle, lies=0.1), (*_KITCHEN, *_BATH, "desk", "nightstand")),
    "vase": (varied(tableware.vase, textures=_GLAZED), (*_TOPS, *_STORES, "TV stand")),
    "jug": (varied(kitchenware.jug, textures=_GLAZED), (*_KITCHEN, "coffee table")),
    "teapot": (varied(tableware.teapot, textures=_GLAZED), (*_KITCHEN, "coffee table")),
    "kettle": (varied(kitchenware.kettle, (0.9, 1.1)), ("kitchen counter", "serving cart")),
    "salt shaker": (varied(kitchenware.salt_shaker), _KITCHEN),
    "apple": (varied(tableware.apple, (0.9, 1.1)), (*_KITCHEN, "coffee table", "desk")),
    "orange": (varied(kitchenware.orange, (0.9, 1.15)), (*_KITCHEN, "coffee table", "bed")),
    "banana": (varied(kitchenware.banana, (0.95, 1.15)), (*_KITCHEN, "desk", "nightstand")),
    # desk and sofa
    "book": (varied(things.book, (0.8, 1.15), _PRINT), (*_OFFICE, *_SEATS, *_BEDSIDE, *_STORES)),
    "box": (varied(things.box, (0.8, 1.25), _PRINT), (*_STORES, *_OFFICE, "washing machine")),
    "tablet": (varied(gadgets.tablet, (0.9, 1.1)), (*_LOUNGE, *_OFFICE, *_BEDSIDE)),
    "laptop": (varied(gadgets.laptop, (0.9, 1.05)), (*_OFFICE, "dining table", "bed", "sofa")),
    "phone": (varied(gadgets.phone, (0.95, 1.1)), (*_LOUNGE, *_OFFICE, *_BEDSIDE, "washstand")),
    "remote control": (varied(things.remote_control, (0.85, 1.1)), (*_LOUNGE, "bed")),
    "stapler": (varied(gadgets.stapler), _OFFICE),
    "tape roll": (varied(gadgets.tape_roll), (*_OFFICE, "trunk", "washing machine")),
    "tissue box": (varied(gadgets.tissue_box, (0.85, 1.05)), (*_BEDSIDE, *_LOUNGE, "toilet")),
    "picture frame": (varied(gadgets.picture_frame), (*_STORES, *_BEDSIDE, "desk", "TV stand")),
    "alarm clock": (varied(things.alarm_clock, (0.85, 1.15)), (*_BEDSIDE, *_OFFICE)),
    "lamp": (varied(things.lamp, (0.85, 1.1)), ("nightstand", "side table", "desk", "sideboard")),
    "pot plant": (varied(things.pot_plant), (*_STORES, *_TOPS, "stool", "washstand")),
    # toys
    "teddy bear": (varied(things.teddy_bear, (0.8, 1.15)), (*_SEATS, "trunk", "shelf")),
    "toy car": (varied(things.toy_car, textures=("stripes",)), (*_SEATS, *_LOUNGE, "trunk")),
    "puzzle cube": (varied(gadgets.puzzle_cube, (0.9, 1.15)), (*_LOUNGE, *_OFFICE, "bed")),
    "ball": (varied(things.ball, (0.8, 1.15), _PRINT), (*_SEATS, "shelf", "trunk")),
    # cloth, bath and hall
    "towel": (varied(household.towel, (0.85, 1.1)), (*_BATH, "bed", "bench", "wardrobe")),
    "toilet paper": (varied(household.toilet_paper, (0.9, 1.1)), _BATH),
    "soap dispenser": (varied(household.soap_dispenser), (*_BATH, "kitchen counter")),
    "sponge": (varied(household.sponge), (*_BATH, "kitchen counter")),
    "shoe": (varied(household.shoe, (0.85, 1.1)), ("shoe rack", "bench", "wardrobe", "trunk")),
    "hat": (varied(household.hat, (0.9, 1.1)), (*_STORES, "bench", "shoe rack", "chair")),
    "basket": (varied(household.basket, (0.85, 1.1)), (*_STORES, *_TOPS, "washing machine")),
    "cushion": (varied(household.cushion, (0.85, 1.1)), (*_SEATS, "trunk")),
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
