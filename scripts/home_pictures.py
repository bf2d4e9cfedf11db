"""Render docs/images/homes-*.png: ten homes of ovmm-v1 and of ovmm-large-v1, and all classes.

Run `python scripts/home_pictures.py [--only NAME]` from the repository's root. Needs Pillow, which
reduces the images to 256 colours.
"""

import argparse
from pathlib import Path

# Imported first: it configures MuJoCo to render without a display.
from helios_sim.home.home_pictures import Image, overview  # isort: skip
from helios_sim.home import PRESETS, generate_home
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.class_sheets import class_sheet
from PIL import Image as Pillow

FOLDER = Path(__file__).parents[1] / "docs" / "images"
SEEDS = range(10)


def homes(preset: str) -> Image:
    return overview([generate_home(seed, PRESETS[preset]) for seed in SEEDS], tile_px=260)


PICTURES = {
    "homes-ovmm": lambda: homes("ovmm-v1"),
    "homes-large": lambda: homes("ovmm-large-v1"),
    "homes-objects": lambda: class_sheet(
        {name: make for name, (make, _) in CATALOGS["ovmm"].objects.items()}, centered=True
    ),
    "homes-receptacles": lambda: class_sheet(
        {name: make for name, (_, make) in CATALOGS["ovmm"].receptacles.items()}, centered=False
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=sorted(PICTURES), help="one of the pictures")
    only = parser.parse_args().only
    for name in [only] if only else list(PICTURES):
        picture = Pillow.fromarray(PICTURES[name]())
        few = picture.quantize(256, dither=Pillow.Dither.FLOYDSTEINBERG)
        few.save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
