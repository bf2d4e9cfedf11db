"""Small plans of homes, written as Sweet Home 3D writes them. Centimetres, y downwards."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from helios_sim.plans import DrawnHome, PlanSource, drawn_home

# Two rooms side by side, 4 m by 5 m each, with a door in the wall between them.
TWO_ROOMS = (
    "<wall id='n' xStart='0' yStart='0' xEnd='800' yEnd='0' height='250' thickness='20'/>"
    "<wall id='e' xStart='800' yStart='0' xEnd='800' yEnd='500' height='250' thickness='20'/>"
    "<wall id='s' xStart='800' yStart='500' xEnd='0' yEnd='500' height='250' thickness='20'/>"
    "<wall id='w' xStart='0' yStart='500' xEnd='0' yEnd='0' height='250' thickness='20'/>"
    "<wall id='m' xStart='400' yStart='0' xEnd='400' yEnd='500' height='250' thickness='10'/>"
)
LEFT, RIGHT = (10, 10, 395, 490), (405, 10, 790, 490)


def room(name: str, box: tuple[float, float, float, float], level: str = "") -> str:
    """A rectangular room."""
    x0, y0, x1, y1 = box
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    points = "".join(f"<point x='{x}' y='{y}'/>" for x, y in corners)
    at = f" level='{level}'" if level else ""
    return f"<room name={quoteattr(name)}{at}>{points}</room>"


def piece(
    name: str,
    x: float,
    y: float,
    size: tuple[float, float, float] = (100, 60, 75),
    tag: str = "pieceOfFurniture",
    inner: str = "",
    **attributes: object,
) -> str:
    """A piece of furniture, or with another tag a door."""
    width, depth, height = size
    given = {"x": x, "y": y, "width": width, "depth": depth, "height": height} | attributes
    text = " ".join(f"{key}={quoteattr(str(value))}" for key, value in given.items())
    return f"<{tag} name={quoteattr(name)} {text}>{inner}</{tag}>"


def door(x: float, y: float, *, width: float = 90, angle: float = math.pi / 2) -> str:
    """A door, by default in a wall along y."""
    return piece("Door", x, y, (width, 15, 208), "doorOrWindow", angle=angle)


def write_plan(
    path: Path, parts: Iterable[str], entries: Mapping[str, bytes] | None = None
) -> Path:
    """A .sh3d file of these parts, with further entries such as models."""
    xml = "<?xml version='1.0'?><home version='7000' wallHeight='250'>" + "".join(parts) + "</home>"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Home.xml", xml)
        for name, content in (entries or {}).items():
            archive.writestr(name, content)
    return path


def drawn(path: Path, *parts: str, entries: Mapping[str, bytes] | None = None) -> DrawnHome:
    """Home of two rooms with a door between them, and these parts."""
    rooms = (TWO_ROOMS, room("Living room", LEFT), room("Kitchen", RIGHT))
    return drawn_home(PlanSource.of(write_plan(path, (*rooms, *parts), entries)))
