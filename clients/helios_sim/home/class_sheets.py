"""Overview image of all classes of a catalog, with a few examples of each.

`python -m helios_sim.home.class_sheets objects --out FILE` (or `receptacles`, `fixtures`).
"""

import argparse
import math
import os
from pathlib import Path

# Without a display MuJoCo renders through EGL; it reads the variable when first imported.
os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import numpy as np

from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.color_palette import draw_palette
from helios_sim.home.home_pictures import Image, grid, write_picture
from helios_sim.home.home_types import Shape
from helios_sim.home.mujoco_model import GROUP_FURNITURE, ModelBuilder
from helios_sim.home.shape_variation import Maker
from helios_sim.mujoco_library import mujoco

_TILE_PX = (300, 130)  # width, height
_EACH = 4
_FOVY_DEG = 30.0
_FLOOR_RGBA = (0.78, 0.77, 0.75, 1.0)


def class_sheet(makers: dict[str, Maker], *, centered: bool) -> Image:
    """Image with one tile per class. centered: the origin is the box centre, as for objects."""
    tiles = []
    for number, (name, make) in enumerate(makers.items()):
        shapes = []
        for k in range(_EACH):
            rng = np.random.default_rng([k, number])
            shapes.append(make(rng, draw_palette(rng)))
        tile = _tile(shapes, centered)
        cv2.putText(tile, name, (5, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20,) * 3, 1, cv2.LINE_AA)
        tiles.append(tile)
    return grid(tiles, 4)


def _tile(shapes: list[Shape], centered: bool) -> Image:
    width, height = _TILE_PX
    pitch = max(math.hypot(*shape.size_m[:2]) for shape in shapes) * 1.02
    tall = max(shape.size_m[2] for shape in shapes)
    model = ModelBuilder(visuals=True)
    for k, shape in enumerate(shapes):
        z = shape.size_m[2] / 2 if centered else 0.0
        body = model.body(f"shape_{k}", ((k - (len(shapes) - 1) / 2) * pitch, 0.0, z), 0.4)
        model.draw(body, shape.visuals, GROUP_FURNITURE)
    spec = model.finish((-5, -5, 5, 5))
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(type=plane, size=[50, 50, 1], rgba=list(_FLOOR_RGBA))
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    compiled.vis.global_.fovy = _FOVY_DEG
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.lookat = 90.0, -24.0, [0.0, 0.0, tall * 0.48]
    half = max(pitch * len(shapes) * height / width, tall * 1.5) / 2
    camera.distance = half / math.tan(math.radians(_FOVY_DEG / 2)) + pitch / 2
    renderer = mujoco.Renderer(compiled, height, width)
    try:
        renderer.update_scene(data, camera)
        return np.ascontiguousarray(renderer.render())
    finally:
        renderer.close()


def main() -> None:
    """Draw the sheet that the command line selects."""
    parser = argparse.ArgumentParser(description="All classes of a catalog in one picture")
    parser.add_argument("what", choices=("objects", "receptacles", "fixtures"))
    parser.add_argument("--catalog", default="ovmm", choices=sorted(CATALOGS))
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    catalog = CATALOGS[arguments.catalog]
    makers: dict[str, Maker] = {
        "objects": {name: make for name, (make, _) in catalog.objects.items()},
        "receptacles": {name: make for name, (_, make) in catalog.receptacles.items()},
        "fixtures": dict(catalog.fixtures),
    }[arguments.what]
    write_picture(arguments.out, class_sheet(makers, centered=arguments.what == "objects"))


if __name__ == "__main__":
    main()
