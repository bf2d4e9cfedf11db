"""Write the example home of the tutorial, clients/helios_examples/flat.sh3d.

A flat of six rooms with German names, as Sweet Home 3D stores it, and one piece with a model of its
own. `--check` fails if the committed file differs.
"""

from __future__ import annotations

import argparse
import io
import math
import sys
import zipfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

from helios_core.atomic_file import write_file

OUT = Path(__file__).parents[1] / "clients/helios_examples/flat.sh3d"
_UP, _RIGHT, _DOWN, _LEFT = 0.0, math.pi / 2, math.pi, 3 * math.pi / 2  # where the back is
_WIDE, _NARROW = 20.0, 10.0
# start x, y, end x, y and thickness in cm
_WALLS = (
    (0, 0, 1040, 0, _WIDE),
    (1040, 0, 1040, 760, _WIDE),
    (1040, 760, 0, 760, _WIDE),
    (0, 760, 0, 0, _WIDE),
    (0, 320, 1040, 320, _NARROW),
    (360, 0, 360, 320, _NARROW),
    (560, 0, 560, 760, _NARROW),
    (760, 0, 760, 320, _NARROW),
)
_ROOMS = (
    ("Küche", 10, 10, 355, 315),
    ("Flur", 365, 10, 555, 315),
    ("Bad", 565, 10, 755, 315),
    ("Arbeitszimmer", 765, 10, 1030, 315),
    ("Wohnzimmer", 10, 325, 555, 750),
    ("Schlafzimmer", 565, 325, 1030, 750),
)
# x, y, angle, name, catalogId, width, depth, height, elevation
_OPENINGS = (
    (360, 220, _RIGHT, "Tür", "eTeks#door", 91.5, 14.5, 208.5, 0),
    (460, 320, _UP, "Tür", "eTeks#door", 91.5, 14.5, 208.5, 0),
    (560, 220, _LEFT, "Tür", "eTeks#door", 91.5, 14.5, 208.5, 0),
    (560, 440, _LEFT, "Tür", "eTeks#door", 91.5, 14.5, 208.5, 0),
    (960, 320, _UP, "Tür", "eTeks#door", 91.5, 14.5, 208.5, 0),
    (460, 0, _DOWN, "Haustür", "eTeks#frontDoor", 101.5, 23, 208.5, 0),
    (180, 0, _UP, "Fenster", "eTeks#window85x123", 91, 34, 134, 87),
    (900, 0, _UP, "Fenster", "eTeks#window85x123", 91, 34, 134, 87),
    (1040, 540, _RIGHT, "Doppelfenster", "eTeks#doubleWindow126x163", 132, 34, 174, 40),
    (280, 760, _DOWN, "Doppelfenster", "eTeks#doubleWindow126x163", 132, 34, 174, 40),
)
_PIECES = (
    (45, 42, _UP, "Küchenschrank", "eTeks#kitchenCabinet", 60, 64, 85, 0),
    (120, 42, _UP, "Spüle", "eTeks#sink", 90, 64, 90, 0),
    (197, 42, _UP, "Herd", "eTeks#cooker", 60, 62, 85, 0),
    (260, 42, _UP, "Küchenunterschrank", "", 60, 64, 85, 0),
    (45, 27, _UP, "Küchenoberschrank", "eTeks#kitchenUpperCabinet", 60, 34, 60, 145),
    (322, 45, _UP, "Kühlschrank", "eTeks#fridge", 60, 62, 180, 0),
    (95, 225, _UP, "Küchentisch", "eTeks#table", 110, 75, 74, 0),
    (95, 285, _DOWN, "Stuhl", "eTeks#chair", 40, 42, 90, 0),
    (385, 95, _LEFT, "Schuhregal", "", 80, 32, 60, 0),
    (735, 60, _RIGHT, "Waschtisch", "eTeks#washbasinWithCabinet", 64, 46, 86, 0),
    (600, 45, _UP, "Waschmaschine", "eTeks#clothesWasher", 60, 60, 85, 0),
    (735, 270, _RIGHT, "WC", "eTeks#toiletUnit", 40, 55, 75, 0),
    (830, 45, _UP, "Schreibtisch", "eTeks#desk", 120, 62, 74, 0),
    (830, 100, _DOWN, "Bürostuhl", "eTeks#chair2", 45, 45, 95, 0),
    (1010, 130, _RIGHT, "Bücherregal", "", 100, 34, 190, 0),
    (790, 250, _LEFT, "Sessel", "eTeks#armchair", 80, 78, 77, 0),
    (58, 560, _LEFT, "Sofa", "eTeks#sofa", 190, 87, 87, 0),
    (220, 560, _UP, "Couchtisch", "eTeks#coffeeTable", 60, 100, 42, 0),
    (220, 560, _UP, "Teppich", "", 180, 240, 1, 0),
    (535, 560, _RIGHT, "TV-Schrank", "", 120, 42, 50, 0),
    (535, 560, _RIGHT, "Fernseher", "eTeks#flatTV", 110, 12, 66, 50),
    (400, 655, _UP, "Esstisch", "eTeks#table", 120, 70, 75, 0),
    (400, 600, _UP, "Stuhl", "eTeks#chair", 40, 42, 90, 0),
    (400, 710, _DOWN, "Stuhl", "eTeks#chair", 40, 42, 90, 0),
    (40, 370, _LEFT, "Zimmerpflanze", "eTeks#plant", 50, 50, 110, 0),
    (250, 345, _UP, "Kommode", "eTeks#chest", 110, 40, 85, 0),
    (800, 640, _DOWN, "Doppelbett", "eTeks#bed140x190", 158, 208, 70, 0),
    (692, 722, _DOWN, "Nachttisch", "eTeks#bedsideTable", 38, 38, 50, 0),
    (908, 722, _DOWN, "Nachttisch", "eTeks#bedsideTable", 38, 38, 50, 0),
    (720, 357, _UP, "Kleiderschrank", "eTeks#wardrobe", 150, 60, 210, 0),
    (745, 720, _DOWN, "Wecker", "", 10, 8, 9, 50),
    (800, 540, _UP, "Deckenlampe", "eTeks#pendantLamp", 50, 50, 60, 190),
)
_BENCH = (140, 735, _DOWN, "Sitzbank", "", 100, 28, 46, 0)
_SASH = (
    "<sash xAxis='0.05464481' yAxis='0.5862069' width='0.89071035' startAngle='0.0' "
    "endAngle='-1.5707964'/>"
)


def home_xml() -> str:
    """`Home.xml` of the flat."""
    rows = ["<?xml version='1.0'?>", "<home version='7000' name='flat.sh3d' wallHeight='250.0'>"]
    for k, row in enumerate(_OPENINGS):
        sash = _SASH if row[4] == "eTeks#door" else ""
        rows.append(_piece("doorOrWindow", k, row, f">{sash}</doorOrWindow>"))
    rows += [_piece("pieceOfFurniture", k, row, "/>") for k, row in enumerate(_PIECES)]
    rows.append(_piece("pieceOfFurniture", len(_PIECES), _BENCH, " model='1/bench.obj'/>"))
    for k, (x0, y0, x1, y1, thick) in enumerate(_WALLS):
        rows.append(
            f"<wall id='wall{k}' xStart='{x0}' yStart='{y0}' xEnd='{x1}' yEnd='{y1}' "
            f"height='250.0' thickness='{thick}'/>"
        )
    for k, (name, x0, y0, x1, y1) in enumerate(_ROOMS):
        corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        points = "".join(f"<point x='{x}' y='{y}'/>" for x, y in corners)
        rows.append(f"<room id='room{k}' name={quoteattr(name)}>{points}</room>")
    return "\n".join([*rows, "</home>", ""])


def _piece(tag: str, k: int, row: tuple[float | str, ...], end: str) -> str:
    x, y, angle, name, catalog_id, width, depth, height, elevation = row
    known = f" catalogId={quoteattr(str(catalog_id))}" if catalog_id else ""
    return (
        f"<{tag} id='{tag}{k}'{known} name={quoteattr(str(name))} x='{x}' y='{y}' "
        f"elevation='{elevation}' angle='{angle}' width='{width}' depth='{depth}' "
        f"height='{height}'{end}"
    )


def _bench() -> str:
    """OBJ model of a bench with a low back; in the file, up is +y and the front +z."""
    rows = ["mtllib bench.mtl"]
    boxes = (
        ("oak", (0, 0.36, 0), (1.0, 0.06, 0.28)),
        ("oak", (0, 0.45, -0.13), (1.0, 0.02, 0.02)),
        ("paint", (-0.45, 0.165, 0), (0.06, 0.33, 0.26)),
        ("paint", (0.45, 0.165, 0), (0.06, 0.33, 0.26)),
    )
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    for n, (material, (cx, cy, cz), (w, h, d)) in enumerate(boxes):
        rows += [
            f"v {cx + sx * w / 2:.3f} {cy + sy * h / 2:.3f} {cz + sz * d / 2:.3f}"
            for sx in (-1, 1)
            for sy in (-1, 1)
            for sz in (-1, 1)
        ]
        rows.append(f"usemtl {material}")
        rows += ["f " + " ".join(str(8 * n + i + 1) for i in face) for face in faces]
    return "\n".join([*rows, ""])


def example_flat() -> bytes:
    """The .sh3d file."""
    buffer = io.BytesIO()
    materials = "newmtl oak\nKd 0.72 0.53 0.35\nnewmtl paint\nKd 0.30 0.38 0.44\n"
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (
            ("Home.xml", home_xml()),
            ("1/bench.obj", _bench()),
            ("1/bench.mtl", materials),
        ):
            archive.writestr(zipfile.ZipInfo(name, (2026, 1, 1, 0, 0, 0)), text.encode())
    return buffer.getvalue()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="fail if the file differs")
    if parser.parse_args().check:
        if OUT.exists() and OUT.read_bytes() == example_flat():
            return 0
        print(f"{OUT} is out of date; run python -m scripts.generate_example_flat", file=sys.stderr)
        return 1
    write_file(OUT, example_flat())
    print(f"written to {OUT}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
