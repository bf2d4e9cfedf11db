"""Baking of selected models into a pack: simplification, collision boxes, surfaces, attribution."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from numpy.typing import NDArray

from helios_sim.assets import asset_pack as packs
from helios_sim.assets.asset_pack import Model, ModelVisual, Pack
from helios_sim.assets.asset_report import attributions
from helios_sim.assets.collision_boxes import levelled, merged_boxes
from helios_sim.assets.flat_surfaces import flat_tops
from helios_sim.assets.mesh_simplification import refined, with_normals
from helios_sim.assets.model_selection import CHOICES, Choice, Kind, digest
from helios_sim.assets.obj_reader import Part, load_parts
from helios_sim.assets.surface_sampling import face_normals
from helios_sim.assets.sweethome_library import Entry, Library, open_libraries

VERSION = 1  # version of the baking procedure; raise it with every change of the result


@dataclass(frozen=True)
class _Grade:
    """Level of detail for one kind of model."""

    triangles: int
    pitch_m: float
    boxes: int
    uneven_m: float


_GRADES: dict[Kind, _Grade] = {
    "hard": _Grade(2000, 0.035, 60, 0.008),
    "seat": _Grade(2000, 0.035, 60, 0.03),
    "soft": _Grade(2000, 0.05, 48, 0.03),
    "thing": _Grade(700, 0.02, 14, 0.0),
}
_MOST_TRIANGLES = 2.5  # limit, as a multiple of the requested number
_HEIGHTS_M = (0.08, 1.6)


@dataclass(frozen=True)
class Baked:
    """Result of a bake. `left_out`: model -> reason why it is missing."""

    folder: Path
    pack: Pack
    left_out: Mapping[str, str]
    fresh: bool  # False: the cache already held this pack


def bake(
    source: Path | None = None,
    cache: Path | None = None,
    choices: Sequence[Choice] = CHOICES,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Baked:
    """Bake the selected models of a source into the cache, unless the cache holds them already.

    Raises Unavailable without the extra `assets`, InvalidInput if no selected model can be baked,
    and both as `open_libraries` does.
    """
    try:  # from the extra `assets`; used in `mesh_simplification`
        import fast_simplification  # noqa: F401
    except ImportError as error:
        raise Unavailable(
            f"{error}; furniture is baked with: pip install 'helios-ovmm[assets]'"
        ) from error
    cache = cache or packs.default_cache()
    with open_libraries(source) as libraries:
        made_of = {library.name: library.sha256 for library in libraries}
        inputs = json.dumps(
            [packs.FORMAT, VERSION, digest(tuple(choices)), made_of], sort_keys=True
        )
        recipe = hashlib.sha256(inputs.encode()).hexdigest()
        there = _current(cache, recipe)
        if there is not None:
            return Baked(cache / "current", there, {}, fresh=False)
        oven = _ModelBaker(libraries)
        jobs = [(choice, keys) for choice in choices for keys in choice.keys]
        for done, (choice, keys) in enumerate(jobs):
            progress(done, len(jobs))
            oven.bake(choice, (keys,) if isinstance(keys, str) else keys)
        progress(len(jobs), len(jobs))
    if not oven.models:
        raise InvalidInput(
            f"none of the {len(jobs)} chosen models can be baked from {sorted(made_of)}: "
            f"{next(iter(oven.left_out.values()), 'nothing was chosen')}"
        )
    pack = Pack(recipe, oven.models, oven.pictures)
    folder = packs.write(pack, attributions(pack), cache)
    return Baked(folder, packs.read(cache), oven.left_out, fresh=True)


def _current(cache: Path, recipe: str) -> Pack | None:
    try:
        pack = packs.read(cache)
    except HeliosError:
        return None
    return pack if pack.digest == recipe else None


class _ModelBaker:
    """Bakes models one by one; a model that serves several classes is baked once per kind."""

    def __init__(self, libraries: Sequence[Library]) -> None:
        self._home = {key: library for library in libraries for key in library.entries}
        self._done: dict[tuple[tuple[str, ...], Kind], Model] = {}
        self.pictures: dict[str, NDArray[np.uint8]] = {}
        self.left_out: dict[str, str] = {}

    def bake(self, choice: Choice, keys: tuple[str, ...]) -> None:
        name = "+".join(keys)
        try:
            model = self._done.get((keys, choice.kind)) or self._model(keys, choice.kind)
        except InvalidInput as error:
            self.left_out[name] = error.message
            return
        classes = (*model.classes, choice.class_name)
        self._done[keys, choice.kind] = replace(model, classes=classes)

    @property
    def models(self) -> tuple[Model, ...]:
        return tuple(self._done.values())

    def _model(self, keys: tuple[str, ...], kind: Kind) -> Model:
        missing = [key for key in keys if key not in self._home]
        if missing:
            raise InvalidInput(f"{missing[0]} is not in the source")
        entries = [self._home[key].entries[key] for key in keys]
        modules = [load_parts(self._home[e.key].folder(e), e) for e in entries]
        grade = _GRADES[kind]
        parts = refined(_in_a_row(modules, entries), grade.triangles)
        vertices = np.concatenate([p.vertices for p in parts])
        starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
        faces = np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=False)])
        # Simplification may move the outermost points inwards.
        shift = np.array(
            [*(vertices.min(axis=0) + vertices.max(axis=0))[:2] / 2, vertices[:, 2].min()]
        )
        vertices = vertices - shift
        parts = [replace(p, vertices=p.vertices - shift) for p in parts]
        if len(faces) > _MOST_TRIANGLES * grade.triangles:
            raise InvalidInput(f"{entries[0].key} cannot be thinned out: {len(faces)} triangles")
        size = np.ptp(vertices, axis=0)
        pitch = min(grade.pitch_m, float(size.max()) / 9)
        surfaces = (
            np.empty((0, 5))
            if kind == "thing"
            else flat_tops(vertices, faces, uneven_m=grade.uneven_m, heights_m=_HEIGHTS_M)
        )
        boxes = levelled(merged_boxes(vertices, faces, pitch, grade.boxes), surfaces)
        return Model(
            key="+".join(keys),
            classes=(),
            title=entries[0].name if len(entries) == 1 else f"{len(entries)} kitchen modules",
            author="; ".join(dict.fromkeys(entry.author for entry in entries)),
            licence="; ".join(dict.fromkeys(entry.licence for entry in entries)),
            size_m=(float(size[0]), float(size[1]), float(size[2])),
            rgb=_mean_rgb(parts),
            boxes=_rounded(boxes),
            surfaces=_rounded(surfaces),
            looks=tuple(self._look(part) for part in parts),
        )

    def _look(self, part: Part) -> ModelVisual:
        split, normals = with_normals(part)
        key = ""
        if part.picture is not None:
            key = hashlib.sha256(part.picture.tobytes()).hexdigest()[:16]
            self.pictures[key] = part.picture
        uv = np.zeros((len(normals), 2)) if split.uv is None else split.uv
        return ModelVisual(
            split.vertices.astype(np.float32),
            normals.astype(np.float32),
            uv.astype(np.float32),
            split.faces.astype(np.int32),
            part.rgb,
            key,
        )


def _in_a_row(modules: list[list[Part]], entries: list[Entry]) -> list[Part]:
    """Parts of modules placed side by side, with their backs aligned."""
    width = sum(entry.size_m[0] for entry in entries)
    deepest = max(entry.size_m[1] for entry in entries)
    x, out = -width / 2, []
    for parts, entry in zip(modules, entries, strict=True):
        move = (x + entry.size_m[0] / 2, (deepest - entry.size_m[1]) / 2, 0.0)
        out += [replace(part, vertices=part.vertices + move) for part in parts]
        x += entry.size_m[0]
    return out


def _mean_rgb(parts: list[Part]) -> tuple[float, float, float]:
    areas = [float(face_normals(p.vertices, p.faces)[1].sum()) for p in parts]
    colors = [
        np.asarray(p.rgb) if p.picture is None else p.picture.reshape(-1, 3).mean(axis=0) / 255
        for p in parts
    ]
    r, g, b = (float(round(v, 3)) for v in np.average(colors, axis=0, weights=areas))
    return r, g, b


def _rounded(rows: NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(round(float(v), 4) for v in row) for row in rows)
