"""Reader of one level of a Sweet Home 3D home: centimetres, y downwards, angles clockwise."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.name_rules import same_name
from numpy.typing import NDArray

from helios_sim.home.home_types import Rgb
from helios_sim.plans import plan_xml
from helios_sim.plans.furniture_classes import opening_kind
from helios_sim.plans.plan_archive import PlanArchive
from helios_sim.plans.plan_types import DrawnRoom, Opening, Piece, Plan, Wall, Xy
from helios_sim.plans.plan_xml import Element

_CM = 0.01
_FURTHEST_CM = 1e6
_MOST_SIZE_CM = 1e5
_LEAST_SIDE_M, _MOST_PIECE_M = 0.004, 30.0
_LEAST_ROOM_M2 = 0.5
_LEAST_WALL_M = 0.01
_SAME_ELEVATION_CM = 5.0
_MOST_WALLS, _MOST_PIECES, _MOST_ROOMS, _MOST_CORNERS = 4000, 3000, 300, 2000
_PIECES = ("pieceOfFurniture", "doorOrWindow", "light", "shelfUnit", "furnitureGroup")
_DEFAULT_HEIGHT_CM = "250"


class _Unusable(Exception):
    """An element whose attributes cannot be used; the message says why."""


@dataclass
class _Level:
    """Levels of one elevation: Sweet Home 3D keeps layers of a storey as levels."""

    elevation_cm: float
    names: list[str] = field(default_factory=list)
    ids: set[str] = field(default_factory=set)
    rooms: Counter[str] = field(default_factory=Counter)
    walls: int = 0

    @property
    def name(self) -> str:
        best = self.rooms.most_common(1)
        return best[0][0] if best else self.names[0] if self.names else ""


def read_plan(archive: PlanArchive, level: str = "") -> Plan:
    """One level of a home: the named one, else the one with the most rooms.

    Raises InvalidInput for a file that is no home, and for an unknown level.
    """
    home = plan_xml.parse(archive.home_xml(), archive.name)
    chosen, others = _chosen_level(home, level, archive.name)
    reader = _LevelReader(home.attributes.get("wallHeight", _DEFAULT_HEIGHT_CM), chosen.ids)
    walls = tuple(reader.walls(home))
    rooms = tuple(reader.rooms(home))
    pieces, openings = reader.furniture(home)
    if max(len(walls) / _MOST_WALLS, len(pieces) / _MOST_PIECES, len(rooms) / _MOST_ROOMS) > 1:
        raise InvalidInput(
            f"{archive.name} draws {len(walls)} walls, {len(rooms)} rooms and {len(pieces)} pieces "
            f"on one level; up to {_MOST_WALLS}, {_MOST_ROOMS} and {_MOST_PIECES} are read: give "
            "the plan of one home"
        )
    return Plan(
        archive.name,
        archive.sha256,
        chosen.name,
        tuple(other.name for other in others),
        walls,
        rooms,
        tuple(openings),
        tuple(pieces),
        tuple(reader.left_out),
    )


def _chosen_level(home: Element, wanted: str, file: str) -> tuple[_Level, list[_Level]]:
    levels: list[_Level] = []
    named: dict[str, tuple[_Level, str]] = {}
    for element in home.all("level"):
        try:
            elevation = _number(element, "elevation", "0")
        except _Unusable:
            continue
        name, key = element.attributes.get("name", ""), element.attributes.get("id", "")
        at = next((v for v in levels if abs(v.elevation_cm - elevation) < _SAME_ELEVATION_CM), None)
        if at is None:
            at = _Level(elevation)
            levels.append(at)
        at.names.append(name)
        at.ids.add(key)
        named[key] = (at, name)
    if not levels:
        levels = [_Level(0.0)]
    levels.sort(key=lambda v: v.elevation_cm)
    base = min(levels, key=lambda v: abs(v.elevation_cm))
    base.ids.add("")  # elements of a home without levels
    for element in home.all("room", "wall"):
        at, name = named.get(element.attributes.get("level", ""), (base, ""))
        if element.tag == "room":
            at.rooms[name] += 1
        else:
            at.walls += 1
    best = max(levels, key=lambda v: (v.rooms.total(), v.walls, -abs(v.elevation_cm)))
    if wanted:
        names = {name: v for v in levels for name in v.names}
        known = same_name(wanted, names)
        if known is None:
            offered = ", ".join(repr(name) for name in names) or "no named level"
            raise InvalidInput(f"{file} has no level {wanted!r}; it has {offered}")
        best = names[known]
    return best, [v for v in levels if v is not best]


class _LevelReader:
    """Converts the elements of one level; collects what is left out."""

    def __init__(self, wall_height_cm: str, level_ids: set[str]) -> None:
        self._wall_height_cm, self._ids = wall_height_cm, level_ids
        self.left_out: list[str] = []

    def walls(self, home: Element) -> Iterator[Wall]:
        for number, element in enumerate(self._here(home, "wall"), 1):
            try:
                yield self._wall(element)
            except _Unusable as why:
                self.left_out.append(f"wall {number}: {why}")

    def _wall(self, e: Element) -> Wall:
        height = _number(e, "height", self._wall_height_cm, least=1.0)
        start, end = _point(e, "xStart", "yStart"), _point(e, "xEnd", "yEnd")
        if math.dist(start, end) < _LEAST_WALL_M:
            raise _Unusable("its length is 0")
        thickness_m = _number(e, "thickness", least=0.1) * _CM
        if thickness_m > _MOST_PIECE_M:
            raise _Unusable(f"it is thicker than {_MOST_PIECE_M:g} m")
        return Wall(
            start,
            end,
            thickness_m,
            height * _CM,
            _number(e, "heightAtEnd", str(height), least=1.0) * _CM,
            -_number(e, "arcExtent", "0"),
            _rgb(e, "leftSideColor"),
            _rgb(e, "rightSideColor"),
        )

    def rooms(self, home: Element) -> Iterator[DrawnRoom]:
        for number, element in enumerate(self._here(home, "room"), 1):
            name = element.attributes.get("name", "").strip()
            try:
                outline = tuple(_point(p, "x", "y") for p in element.all("point"))
                if len(outline) > _MOST_CORNERS:
                    raise _Unusable(f"it has more than {_MOST_CORNERS} corners")
                if _area_m2(outline) < _LEAST_ROOM_M2:
                    raise _Unusable(f"it is smaller than {_LEAST_ROOM_M2} m²")
                yield DrawnRoom(name, outline, _rgb(element, "floorColor"))
            except _Unusable as why:
                self.left_out.append(f"room {name or number}: {why}")

    def furniture(self, home: Element) -> tuple[list[Piece], list[Opening]]:
        """Pieces, and doors and windows; groups are taken apart, hidden pieces left out."""
        pieces: list[Piece] = []
        openings: list[Opening] = []
        for element in self._leaves(home, None):
            name = element.attributes.get("name", "").strip() or element.tag
            try:
                if element.tag == "doorOrWindow":
                    openings.append(_opening(element, name))
                else:
                    pieces.append(_piece(element, name))
            except _Unusable as why:
                self.left_out.append(f"{name}: {why}")
        return pieces, openings

    def _leaves(self, parent: Element, level: str | None) -> Iterator[Element]:
        for element in parent.all(*_PIECES):
            own = element.attributes.get("level", level or "")
            if element.tag == "furnitureGroup":
                if element.attributes.get("visible") != "false":
                    yield from self._leaves(element, own)
            elif own in self._ids:
                if element.attributes.get("visible") == "false":
                    name = element.attributes.get("name", "a piece")
                    self.left_out.append(f"{name}: it is hidden in the plan")
                else:
                    yield element

    def _here(self, home: Element, tag: str) -> list[Element]:
        return [e for e in home.all(tag) if e.attributes.get("level", "") in self._ids]


def _opening(e: Element, name: str) -> Opening:
    x, y = _point(e, "x", "y")
    width, depth, height = (_number(e, k, least=0.0) * _CM for k in ("width", "depth", "height"))
    z_m = _number(e, "elevation", "0") * _CM
    if min(width, height) < _LEAST_SIDE_M:
        raise _Unusable("its width or height is 0")
    _check_size(width, depth, height)
    kind = opening_kind(e.attributes.get("catalogId", ""), name, z_m, height)
    hinge, swing = _leaf(e)
    return Opening(
        name, kind, x, y, -_number(e, "angle", "0"), width, depth, height, z_m, hinge, swing
    )


def _check_size(*sides_m: float) -> None:
    if max(sides_m) > _MOST_PIECE_M:
        raise _Unusable(f"it is larger than {_MOST_PIECE_M:g} m")


def _leaf(e: Element) -> tuple[int, int]:
    """Hinge and swing of the first leaf, see `Opening`; zeros without one.

    A leaf of Sweet Home 3D turns about its axis from `startAngle` to `endAngle`, clockwise; at
    angle 0 it points along x.
    """
    sashes = e.all("sash")
    if not sashes or len(sashes) > 1:
        return 0, 0
    try:
        at, turn = _number(sashes[0], "xAxis"), _number(sashes[0], "endAngle")
    except _Unusable:
        return 0, 0
    hinge = -1 if at < 0.5 else 1
    mirrored = -1 if e.attributes.get("modelMirrored") == "true" else 1
    # Seen from the hinge, a leaf that turns clockwise on the page ends towards -y of our frame.
    towards = 1 if math.sin(turn) < 0 else -1
    return hinge * mirrored, towards


def _piece(e: Element, name: str) -> Piece:
    x, y = _point(e, "x", "y")
    tilted = any(_number(e, k, "0") % math.tau > 1e-3 for k in ("pitch", "roll"))
    suffix = "InPlan" if tilted and "widthInPlan" in e.attributes else ""
    width, depth, height = (
        _number(e, f"{k}{suffix}", least=0.0) * _CM for k in ("width", "depth", "height")
    )
    if min(width, depth, height) < _LEAST_SIDE_M:
        raise _Unusable("its width, depth or height is 0")
    _check_size(width, depth, height)
    return Piece(
        name,
        e.attributes.get("catalogId", ""),
        x,
        y,
        _number(e, "elevation", "0") * _CM,
        0.0 if suffix else -_number(e, "angle", "0"),
        (width, depth, height),
        "" if tilted else e.attributes.get("model", ""),
        _rotation(e),
        _rgb(e, "color"),
        "staircaseCutOutShape" in e.attributes,
    )


def _rotation(e: Element) -> NDArray[np.float64]:
    words = e.attributes.get("modelRotation", "").split()
    try:
        turn = np.array([float(w) for w in words]).reshape(3, 3) if words else np.eye(3)
    except ValueError:
        raise _Unusable("the rotation of its model is no matrix") from None
    if not np.isfinite(turn).all() or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-2):
        raise _Unusable("the rotation of its model is no rotation")
    mirrored = e.attributes.get("modelMirrored") == "true"
    return np.diag([-1.0, 1.0, 1.0]) @ turn if mirrored else turn


def _point(e: Element, x: str, y: str) -> Xy:
    """Point in our frame, m."""
    return _number(e, x) * _CM, -_number(e, y) * _CM


def _number(e: Element, key: str, default: str | None = None, least: float | None = None) -> float:
    """Value of an attribute; with `least` a size between this and 1 km."""
    text = e.attributes.get(key, default)
    if text is None:
        raise _Unusable(f"it has no {key}")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    most = _FURTHEST_CM if least is None else _MOST_SIZE_CM
    if not abs(value) <= most or (least is not None and value < least):
        raise _Unusable(f"its {key} is {text[:20]!r}")
    return value


def _rgb(e: Element, key: str) -> Rgb | None:
    """Colour of "AARRGGBB"; None without one."""
    try:
        value = int(e.attributes.get(key, ""), 16) & 0xFFFFFF
    except ValueError:
        return None
    return (value >> 16) / 255, (value >> 8 & 255) / 255, (value & 255) / 255


def _area_m2(outline: tuple[Xy, ...]) -> float:
    if len(outline) < 3:
        return 0.0
    x, y = np.array(outline).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2
