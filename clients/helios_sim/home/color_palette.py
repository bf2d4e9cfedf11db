"""Colour palette of one home, drawn from its seed, so that its furniture matches."""

from dataclasses import dataclass

import numpy as np

from helios_sim.home.home_types import Material, Rgb

_WOODS: tuple[Rgb, ...] = (
    (0.80, 0.62, 0.42),
    (0.66, 0.46, 0.29),
    (0.47, 0.31, 0.20),
    (0.87, 0.74, 0.56),
    (0.58, 0.36, 0.22),
)
_PAINTS: tuple[Rgb, ...] = (
    (0.94, 0.93, 0.90),
    (0.86, 0.88, 0.89),
    (0.55, 0.66, 0.64),
    (0.36, 0.44, 0.52),
    (0.90, 0.86, 0.77),
)
_FABRICS: tuple[Rgb, ...] = (
    (0.52, 0.58, 0.64),
    (0.76, 0.72, 0.65),
    (0.30, 0.42, 0.50),
    (0.66, 0.42, 0.33),
    (0.45, 0.53, 0.41),
    (0.72, 0.58, 0.36),
    (0.45, 0.42, 0.44),
)
_ACCENTS: tuple[Rgb, ...] = (
    (0.85, 0.55, 0.22),
    (0.24, 0.50, 0.60),
    (0.72, 0.28, 0.26),
    (0.40, 0.56, 0.36),
    (0.88, 0.76, 0.42),
    (0.56, 0.42, 0.62),
)
_WALLS: tuple[Rgb, ...] = (
    (0.95, 0.93, 0.88),
    (0.86, 0.90, 0.92),
    (0.93, 0.88, 0.80),
    (0.84, 0.89, 0.82),
    (0.94, 0.90, 0.89),
    (0.88, 0.87, 0.84),
)

WHITE = Material((0.95, 0.95, 0.94), "ceramic", 0.3, 0.5)
STEEL = Material((0.72, 0.74, 0.76), "", 0.6, 0.6)
BLACK = Material((0.10, 0.10, 0.11), "", 0.4, 0.5)
LINEN = Material((0.95, 0.94, 0.91), "fabric", 0.02, 0.05)


@dataclass(frozen=True)
class Palette:
    """Materials and wall colours of a home."""

    woods: tuple[Material, ...]
    paints: tuple[Material, ...]
    fabrics: tuple[Material, ...]
    accents: tuple[Material, ...]
    walls: tuple[Rgb, ...]

    def wood(self, rng: np.random.Generator) -> Material:
        return self.woods[int(rng.integers(len(self.woods)))]

    def paint(self, rng: np.random.Generator) -> Material:
        return self.paints[int(rng.integers(len(self.paints)))]

    def wood_or_paint(self, rng: np.random.Generator) -> Material:
        return self.wood(rng) if rng.random() < 0.65 else self.paint(rng)

    def fabric(self, rng: np.random.Generator) -> Material:
        return self.fabrics[int(rng.integers(len(self.fabrics)))]

    def accent(self, rng: np.random.Generator) -> Material:
        return self.accents[int(rng.integers(len(self.accents)))]

    def wall(self, rng: np.random.Generator) -> Rgb:
        return self.walls[int(rng.integers(len(self.walls)))]


def draw_palette(rng: np.random.Generator) -> Palette:
    """Random palette: two woods, two paints, three fabrics, four accents, three wall colours."""
    return Palette(
        woods=tuple(Material(c, "wood", 0.12, 0.25) for c in _pick(rng, _WOODS, 2)),
        paints=tuple(Material(c, "ceramic", 0.15, 0.3) for c in _pick(rng, _PAINTS, 2)),
        fabrics=tuple(Material(c, "fabric", 0.02, 0.05) for c in _pick(rng, _FABRICS, 3)),
        accents=tuple(
            Material(c, str(rng.choice(["fabric", "stripes", "checks"])), 0.02, 0.05)
            for c in _pick(rng, _ACCENTS, 4)
        ),
        walls=_pick(rng, _WALLS, 3),
    )


def tinted(rgb: Rgb, rng: np.random.Generator, spread: float = 0.05) -> Rgb:
    """Random colour near `rgb`, each channel within `spread`."""
    r, g, b = (float(np.clip(c + rng.uniform(-spread, spread), 0.03, 0.97)) for c in rgb)
    return r, g, b


def darker(material: Material, factor: float) -> Material:
    """Copy of the material with its colour multiplied by `factor`."""
    r, g, b = material.rgb
    return Material(
        (r * factor, g * factor, b * factor),
        material.texture,
        material.specular,
        material.shininess,
        material.emission,
    )


def _pick(rng: np.random.Generator, colors: tuple[Rgb, ...], count: int) -> tuple[Rgb, ...]:
    return tuple(tinted(colors[int(i)], rng, 0.03) for i in rng.permutation(len(colors))[:count])
