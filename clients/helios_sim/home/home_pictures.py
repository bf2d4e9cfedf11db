"""Images of homes: a view from above and views at eye level.

`python -m helios_sim.home.home_pictures --seeds 0-9 --out DIR` writes one PNG per seed;
`--sheet FILE` writes one image of all seeds.
"""

import argparse
import math
import os
from pathlib import Path

# Without a display MuJoCo renders through EGL; it reads the variable when first imported.
os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import numpy as np
from helios_core.atomic_file import write_file
from numpy.typing import NDArray

from helios_sim.home import PRESETS, Home, Receptacle, generate_home
from helios_sim.home.freespace import footprint
from helios_sim.home.mujoco_model import GROUP_CEILING, GROUP_COLLISION
from helios_sim.mujoco_library import mujoco

Image = NDArray[np.uint8]

_EYE_M = 1.31
_EYE_FOVY_DEG = 58.0
_TILT_RAD = -0.3


class Pictures:
    """Renderer of one home. Close it after use: it holds a GL context."""

    def __init__(self, home: Home, width_px: int = 640, height_px: int = 480) -> None:
        self.home = home
        self.model = home.spec().compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self._renderer = mujoco.Renderer(self.model, height_px, width_px)

    def close(self) -> None:
        self._renderer.close()

    def above(self) -> Image:
        """The whole home from above, without its ceiling."""
        x0, y0, x1, y1 = self.home.bounds
        camera = mujoco.MjvCamera()
        camera.lookat = [(x0 + x1) / 2, (y0 + y1) / 2 + 0.1, 0.8]
        camera.azimuth, camera.elevation = 90.0, -74.0
        half = max((x1 - x0) * 3 / 4, y1 - y0) / 2 + 0.5
        camera.distance = half / math.tan(math.radians(20)) + 2.0
        self.model.vis.map.zfar = 3 * camera.distance / self.model.stat.extent
        return self._render(camera, 40.0, ceiling=False)

    def at_eye_level(self, x: float, y: float, yaw_rad: float) -> Image:
        """View of a robot's camera at this pose."""
        camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation = math.degrees(yaw_rad), math.degrees(_TILT_RAD)
        camera.distance = 0.1
        flat = 0.1 * math.cos(_TILT_RAD)
        camera.lookat = [
            x + flat * math.cos(yaw_rad),
            y + flat * math.sin(yaw_rad),
            _EYE_M + 0.1 * math.sin(_TILT_RAD),
        ]
        return self._render(camera, _EYE_FOVY_DEG, ceiling=True)

    def _render(self, camera: mujoco.MjvCamera, fovy_deg: float, *, ceiling: bool) -> Image:
        self.model.vis.global_.fovy = fovy_deg
        option = mujoco.MjvOption()
        option.geomgroup[GROUP_CEILING] = ceiling
        option.geomgroup[GROUP_COLLISION] = 0
        self._renderer.update_scene(self.data, camera, option)
        return self._renderer.render()


def room_views(home: Home) -> list[tuple[float, float, float]]:
    """Free pose (x, y, yaw) for each room that overlooks it, if possible past tall furniture."""
    free, origin = home.free_space(home.preset.robot_radius_m)
    rows, columns = np.nonzero(free)
    x, y = origin[0] + (columns + 0.5) * 0.05, origin[1] + (rows + 0.5) * 0.05
    views = []
    for room in home.rooms:
        items = [item for item in home.receptacles if item.room == room.index]
        cx = float(np.mean([item.x for item in items] or [room.center_xy[0]]))
        cy = float(np.mean([item.y for item in items] or [room.center_xy[1]]))
        inside = (x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)
        away = np.where(inside, np.hypot(x - cx, y - cy), -1.0)
        open_view = inside & ~_behind_tall(home, x, y, (cx, cy))
        k = int(np.argmax(np.where(open_view, away, away - 100.0)))
        views.append((float(x[k]), float(y[k]), math.atan2(cy - y[k], cx - x[k])))
    return views


def _behind_tall(
    home: Home, x: NDArray[np.floating], y: NDArray[np.floating], to: tuple[float, float]
) -> NDArray[np.bool_]:
    """Mask [n] of points from which eye-high furniture or a door blocks the view to a point."""
    blocked = np.zeros(len(x), dtype=bool)
    ahead, away = np.arctan2(to[1] - y, to[0] - x), np.hypot(to[0] - x, to[1] - y)
    for item in (*home.receptacles, *home.fixtures):
        rect = footprint(item)
        if item.size_m[2] < _EYE_M or not (isinstance(item, Receptacle) or item.blocks):
            continue
        cos, sin = math.cos(rect.yaw_rad), math.sin(rect.yaw_rad)
        for u in np.linspace(-rect.half_x, rect.half_x, 7):
            for v in (-rect.half_y, rect.half_y):
                dx, dy = rect.x + cos * u - sin * v - x, rect.y + sin * u + cos * v - y
                aside = np.abs(np.angle(np.exp(1j * (np.arctan2(dy, dx) - ahead))))
                near = np.hypot(dx, dy)
                blocked |= (aside < 0.65) & (near < 1.3)
                blocked |= (aside < 0.25) & (near < 0.9 * away)
    return blocked


def object_views(home: Home, count: int) -> list[tuple[float, float, float]]:
    """Poses about 1.1 m from objects, facing them."""
    free, origin = home.free_space(home.preset.passage_radius_m)
    rows, columns = np.nonzero(free)
    x, y = origin[0] + (columns + 0.5) * 0.05, origin[1] + (rows + 0.5) * 0.05
    room_of = {item.name: home.rooms[item.room] for item in home.receptacles}
    views = []
    for thing in home.objects[:: max(1, len(home.objects) // count)][:count]:
        room = room_of[thing.receptacle]
        ox, oy, _ = thing.position_m
        inside = (x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)
        away = np.where(inside, np.hypot(x - ox, y - oy), 1e6)
        k = int(np.argmin(np.abs(away - 1.1)))
        views.append((float(x[k]), float(y[k]), math.atan2(oy - y[k], ox - x[k])))
    return views


def contact_sheet(home: Home) -> Image:
    """One image, three tiles wide: the home from above, every room, and some objects close up."""
    pictures = Pictures(home)
    try:
        rooms = room_views(home)
        views = rooms + object_views(home, max(3, 8 - len(rooms)))
        tiles = [pictures.above(), *(pictures.at_eye_level(*view) for view in views)]
    finally:
        pictures.close()
    return grid(tiles, 3)


def overview(homes: list[Home], columns: int = 5, tile_px: int = 400) -> Image:
    """One image of all homes from above, with one room of each below."""
    above, inside = [], []
    for number, home in enumerate(homes):
        pictures = Pictures(home)
        try:
            views = room_views(home)
            above.append(_small(pictures.above(), tile_px))
            view = views[number % len(views)]
            inside.append(_small(pictures.at_eye_level(*view), tile_px))
        finally:
            pictures.close()
    tiles: list[Image] = []
    for start in range(0, len(homes), columns):
        tiles += above[start : start + columns] + inside[start : start + columns]
    return grid(tiles, columns)


def _small(image: Image, width_px: int) -> Image:
    height = round(image.shape[0] * width_px / image.shape[1])
    return cv2.resize(image, (width_px, height), interpolation=cv2.INTER_AREA).astype(np.uint8)


def grid(tiles: list[Image], columns: int) -> Image:
    """Images of equal size arranged in rows, with white frames."""
    blank = np.full_like(tiles[0], 255)
    padded = tiles + [blank] * (-len(tiles) % columns)
    framed = [
        cv2.copyMakeBorder(t, 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=(255,) * 3) for t in padded
    ]
    rows = [np.hstack(framed[k : k + columns]) for k in range(0, len(framed), columns)]
    return np.vstack(rows).astype(np.uint8)


def write_picture(path: Path, image: Image) -> None:
    """Write an image as PNG or JPEG, by the file name. Raises OSError for other names."""
    path.parent.mkdir(parents=True, exist_ok=True)
    options = [cv2.IMWRITE_JPEG_QUALITY, 82] if path.suffix in (".jpg", ".jpeg") else []
    if path.suffix not in (".png", ".jpg", ".jpeg"):
        raise OSError(f"cannot write {path}: give a file name that ends in .png or .jpg")
    _, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    write_file(path, data.tobytes())


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def main() -> None:
    """Draw the images that the command line selects."""
    parser = argparse.ArgumentParser(description="Pictures of homes by seed")
    parser.add_argument("--seeds", default="0-9", type=_seeds, help="one seed, or FIRST-LAST")
    parser.add_argument("--preset", default="demo-v1", choices=sorted(PRESETS))
    parser.add_argument("--furniture", default="parametric", choices=("parametric", "realistic"))
    parser.add_argument("--out", type=Path, help="folder for one PNG per seed")
    parser.add_argument("--sheet", type=Path, help="file for one picture of all seeds")
    arguments = parser.parse_args()
    furniture_models = None
    if arguments.furniture == "realistic":
        from helios_sim.assets import realistic

        furniture_models = realistic()
    preset = PRESETS[arguments.preset]
    homes = [generate_home(seed, preset, furniture_models) for seed in arguments.seeds]
    if arguments.out:
        for home in homes:
            write_picture(arguments.out / f"home_{home.seed}.png", contact_sheet(home))
    if arguments.sheet:
        write_picture(arguments.sheet, overview(homes))


if __name__ == "__main__":
    main()
