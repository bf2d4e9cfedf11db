"""Pictures of the realism study: a chart of the classes, and a sheet per kind of looks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from helios_core.atomic_file import replacing, write_file
from helios_sim.assets.asset_pack import Model
from numpy.typing import NDArray

from helios_eval.palette import SKY, VERMILION
from helios_eval.studies.realism_judging import Judged, Row

mpl.use("Agg")

COLORS = {"parametric": SKY, "realistic": VERMILION}
RIGHT_RGB, WRONG_RGB = (70, 220, 100), (255, 120, 90)
TILES_EACH = 6
TILE_PX = (480, 360)  # width, height
JPEG_QUALITY = 88
LEAST_SEEN = 5  # least number of views for a bar


class Album:
    """For each home and kind of looks, the view with the most judged objects."""

    def __init__(self) -> None:
        self._best: dict[str, dict[int, Judged]] = {}

    def add(self, judged: Judged) -> None:
        """Keep the view if it has more judged objects than the one kept before."""
        seed = judged.view.frame.id.world_epoch
        kept = self._best.setdefault(judged.looks, {})
        if seed not in kept or len(judged.sights) > len(kept[seed].sights):
            kept[seed] = judged

    def write(self, folder: Path) -> list[Model]:
        """Write `realism-<looks>.jpg` for each kind of looks; return the baked models they show."""
        shown: dict[str, Model] = {}
        for looks, kept in self._best.items():
            chosen = [kept[seed] for seed in sorted(kept)][:TILES_EACH]
            tiles = [drawn(judged, TILE_PX) for judged in chosen]
            tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % 3)
            rows = [np.hstack(tiles[i : i + 3]) for i in range(0, len(tiles), 3)]
            quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
            path = folder / f"realism-{looks}.jpg"
            _, picture = cv2.imencode(".jpg", np.vstack(rows)[..., ::-1], quality)
            write_file(path, picture.tobytes())
            for judged in chosen:
                shown |= {t.model.key: t.model for t in judged.view.things if t.model}
        return [shown[key] for key in sorted(shown)]


def drawn(judged: Judged, size_px: tuple[int, int]) -> NDArray[np.uint8]:
    """Image with the box of every judged object: green if it is recognised, else red."""
    color = judged.view.frame.color
    out = cv2.resize(color, size_px, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    scale = size_px[0] / color.shape[1]
    for thing, sight in judged.sights:
        x0, y0, x1, y1 = (round(v * scale) for v in thing.box_xyxy)
        rgb = RIGHT_RGB if sight.recognised else WRONG_RGB
        cv2.rectangle(out, (x0, y0), (x1 - 1, y1 - 1), rgb, 2)
        found = f"{sight.found} {sight.score:.2f}" if sight.found else "nothing"
        _label(out, found if sight.recognised else f"{thing.class_name}: {found}", x0, y0, rgb)
    return out


def _label(picture: NDArray[np.uint8], text: str, x: int, y: int, rgb: tuple[int, ...]) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    y = max(height + 4, y)
    cv2.rectangle(picture, (x, y - height - 4), (x + width + 4, y), rgb, -1)
    at = (x + 2, y - 3)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)


def chart(rows: Mapping[tuple[str, str], Row], detector: str, path: Path) -> None:
    """Draw the share of recognised views by class, for both kinds of looks."""
    from matplotlib import pyplot as plt

    kinds = [k for k in COLORS if any(looks == k for _, looks in rows)]
    shares = {key: row.recognised / row.seen for key, row in rows.items() if row.seen >= LEAST_SEEN}
    names = sorted({n for n, _ in shares}, key=lambda n: max(shares.get((n, k), 0) for k in kinds))
    figure, axes = plt.subplots(figsize=(8, 0.32 * len(names) + 1.2), layout="constrained", dpi=110)
    for i, looks in enumerate(kinds):
        at = np.arange(len(names)) + (0.2 if i else -0.2) * (len(kinds) > 1)
        values = [shares.get((n, looks), np.nan) for n in names]
        axes.barh(at, values, 0.38, color=COLORS[looks], label=looks)
        for y, value, name in zip(at, values, names, strict=True):
            if not np.isnan(value):
                axes.text(
                    value + 0.01, y, f"{value:.0%} of {rows[name, looks].seen}", va="center", size=7
                )
    axes.set(
        yticks=np.arange(len(names)),
        yticklabels=names,
        xlim=(0, 1.15),
        xlabel="recognised, of the views that show it whole",
        title=f"What {detector} recognises in simulated homes",
    )
    axes.legend(loc="lower right")
    with replacing(path) as temporary:
        figure.savefig(temporary)
    plt.close(figure)
