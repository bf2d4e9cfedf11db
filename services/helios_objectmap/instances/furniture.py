"""Which classes are furniture: their instances have the voxels of receptacles in every role."""

from __future__ import annotations

from helios_core.name_rules import plain
from helios_core.usual_sizes import usual_extents

# Large classes that `sizes.toml` lists as not standing on the floor, or does not list.
_ALSO = frozenset({
    "cabinet", "cupboard", "cooker", "stove", "oven", "range", "sink", "stand", "washer/dryer",
    "tv", "television", "tv set", "tv screen", "radiator", "window", "curtain", "curtains", "blind",
    "blinds", "fireplace", "shower", "shower curtain", "staircase", "wall", "floor", "ceiling",
})  # fmt: skip


def is_furniture(class_name: str) -> bool:
    """True for furniture, large appliances and fixtures: classes that usually stand on the floor,
    and a few more. The last words decide: a "white kitchen table" is a table, a "table lamp" is
    not."""
    words = plain(class_name).split()
    return any(_is_listed(" ".join(words[k:])) for k in range(len(words)))


def _is_listed(name: str) -> bool:
    usual = usual_extents(name)
    return name in _ALSO or (usual is not None and usual.on_floor)


def is_flat(class_name: str, height_m: float) -> bool:
    """True for a class that usually is no higher than `height_m` above the floor, like a rug."""
    usual = usual_extents(class_name)
    return usual is not None and usual.on_floor and float(usual.most_m[2]) <= height_m
