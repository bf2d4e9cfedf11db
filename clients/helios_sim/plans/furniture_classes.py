"""Class of a piece of furniture, by its number in the catalogue, then by its name in any language.

`catalogue_names.json` holds the numbers and names of Sweet Home 3D's catalogues
(scripts/generate_catalogue_names.py); `furniture_words.toml` holds words that occur in names that
their authors wrote themselves.
"""

from __future__ import annotations

import json
import re
import tomllib
import unicodedata
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from helios_sim.home.home_types import Vec3
from helios_sim.plans.plan_types import OpeningKind

UNKNOWN = "furniture"  # class of a piece with an unknown name
SMALL, IGNORED = "small", "ignored"
_WORDS = Path(__file__).with_name("furniture_words.toml")
_NAMES = Path(__file__).with_name("catalogue_names.json")
_COMPOUND_LETTERS = 5
_WITHOUT_SPACES = re.compile(r"[\u3040-\u30ff\u3400-\u9fff\uac00-\ud7af]")
_DOOR_SILL_M = 0.25
_SMALL_M = 0.35  # a piece with an unknown name and no longer side is a household thing
_LEAST_DOOR_M = 1.5


def class_of(catalog_id: str, name: str, size_m: Vec3, z_m: float = 0.0) -> str:
    """Class of a piece, `UNKNOWN`, `SMALL` (a household thing) or `IGNORED` (no furniture).

    size_m: width, depth, height. z_m: height of its lower face.
    """
    ids, names = _catalogue()
    plain = plain_name(name)
    found = ids.get(catalog_id) or names.get(plain) or word_class(name)
    if not found:
        return SMALL if max(size_m) < _SMALL_M else UNKNOWN
    return _by_size(found, size_m, z_m)


def opening_kind(catalog_id: str, name: str, z_m: float, height_m: float) -> OpeningKind:
    """Kind of a door or window: what begins at the floor and is as tall as a door is a door.

    A window down to the floor is a window by its number or name; French windows are doors.
    """
    ids, names = _catalogue()
    if "french" in catalog_id.lower():
        return "door"
    if z_m > _DOOR_SILL_M or z_m + height_m < _LEAST_DOOR_M:
        return "window"
    named = ids.get(catalog_id) or names.get(plain_name(name)) or word_class(name)
    return "window" if named == "window" else "door"


@cache
def word_class(name: str) -> str:
    """Class of the longest known word in a name; empty if there is none."""
    return _longest_word(name, known_words())


@cache
def room_kind(name: str) -> str:
    """Kind of a room by its name, such as "kitchen"; empty for an unknown name."""
    return _longest_word(name, known_words("rooms"))


def _longest_word(name: str, words_of: Mapping[str, tuple[str, ...]]) -> str:
    plain, best, found = f" {plain_name(name)} ", 0, ""
    for class_name, words in words_of.items():
        for word in words:
            if len(word) <= best:
                continue
            if _WITHOUT_SPACES.search(word):
                there = word in plain
            else:
                there = f"{word} " if len(word) >= _COMPOUND_LETTERS else f" {word} "
                there = there in plain
            if there:
                best, found = len(word), class_name
    return found


def plain_name(name: str) -> str:
    """Name in lower case without numbers, punctuation and repeated spaces."""
    text = unicodedata.normalize("NFC", name).casefold()
    kept = (c if c.isalpha() or unicodedata.combining(c) or c in "'-" else " " for c in text)
    return " ".join("".join(kept).split())


def _by_size(found: str, size_m: Vec3, z_m: float) -> str:
    """Class of a "table", "cabinet" or "lamp" of that size."""
    width, depth, height = size_m
    if found == "table":
        if z_m + height < 0.56:
            return "coffee table" if max(width, depth) >= 0.6 else "side table"
        return "dining table" if max(width, depth) >= 0.7 else "side table"
    if found == "cabinet":
        if z_m > 1.0:
            return "wall cabinet"
        return "wardrobe" if height > 1.4 else "sideboard"
    if found == "lamp":
        if z_m > 1.4:
            return "ceiling lamp"
        return "floor lamp" if z_m < 0.1 and height > 0.9 else SMALL
    if found == "kitchen counter" and z_m > 1.0:
        return "wall cabinet"
    return found


@cache
def known_words(part: str = "classes") -> dict[str, tuple[str, ...]]:
    """Words of a part of `furniture_words.toml`, "classes" or "rooms", as `plain_name` writes
    them."""
    classes = tomllib.loads(_WORDS.read_text(encoding="utf-8"))[part]
    return {name: tuple(plain_name(word) for word in words) for name, words in classes.items()}


@cache
def _catalogue() -> tuple[dict[str, str], dict[str, str]]:
    """(class by catalogue number, class by plain name)."""
    table = json.loads(_NAMES.read_text(encoding="utf-8"))
    by_id = {key: name for name, keys in table["ids"].items() for key in keys}
    by_name = {said: name for name, all_said in table["names"].items() for said in all_said}
    return by_id, by_name
