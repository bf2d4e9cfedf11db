"""Points on the floor as people write them: "3.2, 4.1", "(3.2 m, -4.1 m) facing 90 degrees".

Lengths are metres in the world frame. A heading without a unit is in degrees, counter-clockwise
from the world's x axis.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass

from helios_core.errors import InvalidInput
from helios_core.geometry import wrap_angle

MOST_M = 10_000.0  # of a coordinate; no home is so large
WORD = "xypoint"  # stands for the point in what is read on
HOW = "“go to 3.2, 4.1” or “go to 3.2, 4.1 facing 90 degrees” (metres in the world frame)"

_NUMBER = r"[-+]?(?:\d+(?:\.\d+)?|\.\d+|(?:nan|inf(?:inity)?)(?!\w))"
_METRES = r"(?:\s*(?:metres?|meters?|m)\b)?"
_POINT = re.compile(
    r"(?<![\w.+-])"
    r"(?:(?:the\s+)?(?:point|position|coordinates?|pose|location|place|spot)\s+(?:at\s+|of\s+)?)?"
    rf"[(\[]?\s*(?:x\s*[=:]?\s*)?(?P<x>{_NUMBER}){_METRES}"
    rf"(?:\s*[,;]\s*|\s+and\s+|\s+)(?:y\s*[=:]?\s*)?(?P<y>{_NUMBER}){_METRES}(?![\w.])"
    rf"(?P<more>\s*[,;]?\s*(?:z\s*[=:]?\s*)?{_NUMBER}{_METRES}(?![\w.]))?\s*[)\]]?"
)
_FACING = re.compile(
    r"\s*,?\s*(?:and\s+)?(?:(?:then\s+)?(?:facing|face|heading|looking|look|turned|turn|yaw)"
    r"|(?:with|at)\s+(?:an?\s+|the\s+)?(?:yaw|heading|orientation|angle))"
    rf"(?:\s+(?:to|of|at|towards?))?\s*[=:]?\s*(?P<angle>{_NUMBER})"
    r"\s*(?P<unit>degrees?|deg|°|radians?|rad)?(?![\w.])"
)
_SIGNS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u2012": "-", "\u221e": "inf"})


@dataclass(frozen=True)
class Point:
    """A place on the floor of the world, and which way to face there; None: any."""

    x_m: float
    y_m: float
    yaw_rad: float | None = None

    def __str__(self) -> str:
        return f"({self.x_m:.2f}, {self.y_m:.2f}) m"


@dataclass(frozen=True)
class Written:
    """A point and the text around it, in which `WORD` stands for the point. more: a third number
    follows its two."""

    point: Point
    text: str
    more: bool = False


def find_point(text: str) -> Written | None:
    """The first point of a text. `confirm` it once it is known that a point is meant."""
    plain = unicodedata.normalize("NFKC", text).translate(_SIGNS).lower()
    found = _POINT.search(plain)
    if found is None:
        return None
    end, yaw_rad = found.end(), None
    if turned := _FACING.match(plain, end):
        end = turned.end()
        angle = _number(turned["angle"])
        in_radians = (turned["unit"] or "").startswith("rad")
        yaw_rad = angle if in_radians else math.radians(angle)
    x_m, y_m = _number(found["x"]), _number(found["y"])
    text = f"{plain[: found.start()]} {WORD} {plain[end:]}"
    return Written(Point(x_m, y_m, yaw_rad), text, bool(found["more"]))


def confirm(written: Written, said: str) -> Point:
    """The point, its heading within half a turn. Raises InvalidInput for one that is none.

    said: the instruction in quotation marks, for the error.
    """
    point = written.point
    if written.more:
        raise InvalidInput(f"{said} gives three numbers; write two, {HOW}")
    for axis, value in (("x", point.x_m), ("y", point.y_m)):
        if math.isnan(value):
            raise InvalidInput(f"{said} gives {value} as {axis}; wanted a number of metres: {HOW}")
        if not abs(value) <= MOST_M:
            raise InvalidInput(f"{said} names a point beyond {MOST_M:.0f} m; write {HOW}")
    yaw_rad = point.yaw_rad
    if yaw_rad is not None and not math.isfinite(yaw_rad):
        raise InvalidInput(f"{said} names no angle; write {HOW}")
    turned = None if yaw_rad is None else wrap_angle(yaw_rad)
    return Point(point.x_m, point.y_m, turned)


def _number(text: str) -> float:
    return float(text)
