"""Writes a furniture library of four hand-written models in the format of Sweet Home 3D."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

import cv2
import numpy as np
from helios_sim.assets.model_selection import Choice

LICENCE = "This file is under http://creativecommons.org/licenses/by/3.0/ for all"
CHOICES = (
    Choice("dining table", "hard", ("Tiny/table",)),
    Choice("coffee table", "hard", ("Tiny/table",)),
    Choice("chair", "seat", ("Tiny/chair",)),
    Choice("dresser", "hard", (("Tiny/chest", "Tiny/chest"),)),
    Choice("nightstand", "hard", ("Tiny/chest",)),
    Choice("mug", "thing", ("Tiny/mug", "Tiny/lost")),
)
_MATERIALS = (
    "newmtl wood\nKd 1 1 1\nmap_Kd wood.png\n\nnewmtl red\nKd 0.8 0.1 0.1\n\n"
    "newmtl glass\nKd 1 1 1\nd 0.2\n"
)

Box = tuple[
    tuple[float, float, float], tuple[float, float, float]
]  # corners: x right, y up, z front


def obj_of(boxes: dict[str, list[Box]], scale: float = 1.0) -> str:
    """An OBJ of boxes by material, with outward faces, each with the whole texture."""
    lines = ["mtllib model.mtl", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    count = 0
    for material, parts in boxes.items():
        lines.append(f"usemtl {material}")
        for low, high in parts:
            for k in range(8):
                corner = [(low, high)[k >> axis & 1][axis] * scale for axis in range(3)]
                lines.append("v {} {} {}".format(*corner))
            for quad in ("1573", "2486", "1265", "3784", "1342", "5687"):
                corners = [f"{count + int(v)}/{t}" for t, v in enumerate(quad, 1)]
                lines.append("f " + " ".join(corners))
            count += 8
    return "\n".join(lines) + "\n"


def _legs(width: float, depth: float, height: float, thick: float) -> list[Box]:
    return [
        ((x, 0, z), (x + thick, height, z + thick))
        for x in (0, width - thick)
        for z in (0, depth - thick)
    ]


TABLE = obj_of(
    {"wood": [((0, 0.70, 0), (1.2, 0.74, 0.8))], "red": _legs(1.2, 0.8, 0.70, 0.06)}, scale=40.0
)
CHAIR = obj_of(
    {
        "red": [((0, 0.42, 0), (0.44, 0.45, 0.46)), ((0, 0.45, 0), (0.44, 0.9, 0.03))],
        "wood": _legs(0.44, 0.46, 0.42, 0.04),
    }
)
CHEST = obj_of({"wood": [((0, 0, 0), (0.5, 0.55, 0.42))]})
MUG = obj_of({"glass": [((0, 0, 0), (0.08, 0.1, 0.08)), ((0.08, 0.02, 0.03), (0.12, 0.08, 0.05))]})

_ENTRIES = {
    "table": ("Table", (120, 80, 74), TABLE, ""),
    "chair": ("Chair", (44, 46, 90), CHAIR, ""),
    "chest": ("Chest", (50, 42, 55), CHEST, ""),
    "mug": ("Mug", (12, 8, 10), MUG, ""),
}


def write_library(folder: Path, licence: str = LICENCE, name: str = "Tiny") -> Path:
    """Write the library, by default `Tiny.sh3f`, into a folder; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    picture = np.zeros((400, 300, 3), np.uint8)
    picture[:, :150] = (40, 90, 150)
    png = cv2.imencode(".png", picture)[1].tobytes()
    catalogue = []
    path = folder / f"{name}.sh3f"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, (key, (title, size, obj, rotation)) in enumerate(_ENTRIES.items(), 1):
            values = {
                "id": f"{name}#{key}",
                "name": title,
                "category": "Living room",
                "model": f"/tiny/{key}/model.obj",
                "width": size[0],
                "depth": size[1],
                "height": size[2],
                "creator": "A. Carpenter",
            } | ({"modelRotation": rotation} if rotation else {})
            catalogue += [f"{k}#{number}={v}" for k, v in values.items()]
            archive.writestr(f"tiny/{key}/model.obj", obj)
            archive.writestr(f"tiny/{key}/model.mtl", _MATERIALS)
            archive.writestr(f"tiny/{key}/wood.png", png)
        archive.writestr("PluginFurnitureCatalog.properties", "\n".join(catalogue))
        archive.writestr("LICENSE.TXT", licence)
    return path


def write_package(library: Path, package: Path) -> Path:
    """Write a Debian package that contains the library; its path."""
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:xz") as tar:
        tar.add(library, f"./usr/share/sweethome3d/furniture/{library.name}")
    members = {"debian-binary": b"2.0\n", "control.tar.xz": b"odd", "data.tar.xz": data.getvalue()}
    out = b"!<arch>\n"
    for name, content in members.items():
        out += f"{name:<16}{0:<12}{0:<6}{0:<6}{100644:<8}{len(content):<10}`\n".encode()
        out += content + b"\n" * (len(content) % 2)
    package.write_bytes(out)
    return package
