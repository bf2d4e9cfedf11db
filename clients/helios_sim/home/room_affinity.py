"""Rooms that suit a class of objects: general knowledge, one row per class.

Placement of objects uses it (`HomePreset.room_preference`). No service and no agent reads it.
"""

_MEALS = ("kitchen", "dining room", "living room")
_COOKING = ("kitchen", "dining room")
_SLEEP = ("bedroom", "guest room", "child's room")
_WASH = ("bathroom", "laundry room")
_WORK = ("office", "child's room")
_ENTRY = ("corridor", "hallway", "storage room")

# Class -> kinds of rooms in which it usually is.
ROOMS: dict[str, frozenset[str]] = {
    name: frozenset(rooms)
    for name, rooms in {
        # tableware
        "mug": (*_MEALS, "office"),
        "glass": _MEALS,
        "can": (*_COOKING, "storage room"),
        "candle": ("living room", "dining room", "bathroom", "bedroom"),
        "jar": (*_COOKING, "storage room"),
        "bowl": _MEALS,
        "plate": _COOKING,
        "pan": ("kitchen",),
        "bottle": (*_MEALS, "storage room"),
        "vase": ("living room", "dining room", "corridor", "hallway"),
        "jug": _COOKING,
        "teapot": _MEALS,
        "kettle": ("kitchen",),
        "salt shaker": _COOKING,
        "apple": _MEALS,
        "orange": _MEALS,
        "banana": _MEALS,
        # desk and sofa
        "book": ("office", "living room", *_SLEEP),
        "box": ("office", "storage room", "laundry room"),
        "tablet": ("living room", "office", *_SLEEP),
        "laptop": ("office", "living room"),
        "phone": ("living room", "office", *_SLEEP),
        "remote control": ("living room", "bedroom"),
        "stapler": _WORK,
        "tape roll": (*_WORK, "storage room"),
        "tissue box": ("living room", "bathroom", *_SLEEP),
        "picture frame": ("living room", "office", "bedroom", "corridor", "hallway"),
        "alarm clock": _SLEEP,
        "lamp": ("living room", "office", *_SLEEP),
        "pot plant": ("living room", "dining room", "office", "corridor", "hallway"),
        # toys
        "teddy bear": _SLEEP,
        "toy car": ("child's room", "living room"),
        "puzzle cube": ("child's room", "living room", "office"),
        "ball": ("child's room", "living room", "storage room"),
        # cloth, bath and hall
        "towel": _WASH,
        "toilet paper": ("bathroom", "storage room"),
        "soap dispenser": ("bathroom", "kitchen"),
        "sponge": (*_WASH, "kitchen"),
        "shoe": _ENTRY,
        "hat": (*_ENTRY, "bedroom"),
        "basket": (*_WASH, "storage room", "living room"),
        "cushion": ("living room", *_SLEEP),
    }.items()
}


def suits(class_name: str, room_kind: str) -> bool:
    """True if objects of the class usually are in rooms of that kind.

    Raises KeyError for a class without a row.
    """
    return room_kind in ROOMS[class_name]
