"""Shape of a piece of furniture from its own OBJ model in the plan's archive."""

from __future__ import annotations

import hashlib
import io
import re
from dataclasses import replace

import cv2
import numpy as np
from helios_core.errors import InvalidInput

from helios_sim.assets.collision_boxes import levelled, merged_boxes
from helios_sim.assets.flat_surfaces import flat_tops
from helios_sim.assets.image_header import pixels_of
from helios_sim.assets.mesh_simplification import refined, with_normals
from helios_sim.assets.obj_reader import Part, load_parts
from helios_sim.assets.sweethome_library import Entry
from helios_sim.home.home_types import (
    CollisionPrimitive,
    Material,
    Mesh,
    Picture,
    Rgb,
    Shape,
    Surface,
    Visual,
)
from helios_sim.plans.plan_archive import PlanArchive
from helios_sim.plans.plan_types import Piece

MOST_MODEL_BYTES = 6 << 20
MOST_TRIANGLES = 120_000  # of a model as drawn; it is then simplified
_SIMPLE_TRIANGLES = 2000
_WITHOUT_SIMPLIFYING = 8000  # a model with fewer triangles needs no simplification
_MOST_PIXELS = 16 << 20
_PITCH_M, _BOXES = 0.04, 40
_HEIGHTS_M = (0.08, 1.6)
_SOFT = frozenset({"sofa", "armchair", "bed", "chair", "bench", "stool"})
_UNEVEN_M = {True: 0.03, False: 0.008}
_LEAST_SURFACE_HALF_M = 0.085
# Colours of materials that Sweet Home 3D's own models name without a file, by a part of the name.
_NAMED_RGB: tuple[tuple[str, Rgb], ...] = (
    ("white", (0.93, 0.93, 0.92)), ("bone", (0.88, 0.85, 0.78)), ("ltgrey", (0.75, 0.75, 0.75)),
    ("dkdkgrey", (0.25, 0.25, 0.26)), ("dkgrey", (0.38, 0.38, 0.39)),
    ("grey", (0.58, 0.58, 0.58)), ("silver", (0.76, 0.77, 0.78)), ("black", (0.12, 0.12, 0.12)),
    ("blonde", (0.80, 0.66, 0.45)), ("ltbrown", (0.66, 0.49, 0.33)), ("brown", (0.46, 0.31, 0.2)),
    ("redwood", (0.50, 0.26, 0.18)), ("tan", (0.80, 0.67, 0.50)), ("sand", (0.82, 0.74, 0.58)),
    ("amber", (0.80, 0.55, 0.22)), ("yellow", (0.88, 0.78, 0.32)), ("orange", (0.86, 0.52, 0.20)),
    ("red", (0.66, 0.20, 0.18)), ("ruby", (0.60, 0.14, 0.20)), ("iris", (0.38, 0.40, 0.62)),
    ("lavend", (0.66, 0.62, 0.78)), ("blue", (0.28, 0.40, 0.62)), ("green", (0.33, 0.52, 0.30)),
)  # fmt: skip
_LIBRARIES = re.compile(r"^mtllib\s+(.*\S)", re.MULTILINE)
_USED = re.compile(r"^usemtl +(\S.*?)\s*$", re.MULTILINE)


def own_shape(archive: PlanArchive, piece: Piece, class_name: str) -> Shape:
    """Shape of a piece in the furniture frame, scaled to its size, with its support surfaces.

    class_name: of soft furniture, a surface may be less flat. Raises InvalidInput if the model is
    missing, no OBJ file, damaged or too large.
    """
    files = _files(archive, piece.model)
    parts = load_parts(files, _entry(piece))
    if sum(len(part.faces) for part in parts) > MOST_TRIANGLES:
        raise InvalidInput(f"its model has more than {MOST_TRIANGLES} triangles")
    if not all(np.isfinite(part.vertices).all() for part in parts):
        raise InvalidInput("its model has invalid coordinates")
    if piece.rgb is not None:
        parts = [replace(part, rgb=piece.rgb, picture=None, uv=None) for part in parts]
    parts = _thinned(parts)
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=False)])
    surfaces = flat_tops(
        vertices, faces, uneven_m=_UNEVEN_M[class_name in _SOFT], heights_m=_HEIGHTS_M
    )
    pitch = min(max(_PITCH_M, max(piece.size_m) / 60), max(piece.size_m) / 9)
    boxes = levelled(merged_boxes(vertices, faces, pitch, _BOXES), surfaces)
    return Shape(
        piece.size_m,
        tuple(visual for part in parts if (visual := _visual(part)) is not None),
        tuple(_solid(box) for box in boxes),
        _mean_rgb(parts),
        tuple(
            Surface((float(x), float(y)), (float(hx), float(hy)), 0.0, float(z))
            for x, y, hx, hy, z in surfaces
            if min(hx, hy) >= _LEAST_SURFACE_HALF_M
        ),
    )


def _entry(piece: Piece) -> Entry:
    return Entry(
        key=piece.name,
        name=piece.name,
        category="",
        size_m=piece.size_m,
        rotation=piece.rotation,
        model=piece.model,
        author="",
        licence="",
    )


def _files(archive: PlanArchive, model: str) -> dict[str, io.BytesIO]:
    """The model and the files beside it, without images too large to decode."""
    files, own = archive.folder(model), model.rpartition("/")[2]
    data = files[own].getvalue()
    if len(data) > MOST_MODEL_BYTES:
        raise InvalidInput(f"its model has more than {MOST_MODEL_BYTES >> 20} MiB")
    if not re.search(rb"^v\s", data, re.MULTILINE) or not re.search(rb"^f\s", data, re.MULTILINE):
        raise InvalidInput("its model is no OBJ file")
    texts = {own, *_LIBRARIES.findall(data.decode("latin-1"))}
    for name in files.keys() - texts:  # a texture may have any name
        size = pixels_of(files[name].getvalue())
        if size is None or size[0] * size[1] > _MOST_PIXELS:
            del files[name]
    if not any(name.lower().endswith(".mtl") for name in files):
        _add_named_materials(files, own)
    return files


def _add_named_materials(files: dict[str, io.BytesIO], own: str) -> None:
    """Add a material file for the materials that an OBJ file only names."""
    text = files[own].getvalue().decode("latin-1")
    lines = []
    for name in dict.fromkeys(_USED.findall(text)):
        rgb = next((rgb for word, rgb in _NAMED_RGB if word in name.lower()), None)
        if rgb is not None:
            lines += [f"newmtl {name}", "Kd {} {} {}".format(*rgb)]
    files["named.mtl"] = io.BytesIO("\n".join(lines).encode("latin-1"))
    files[own] = io.BytesIO(f"mtllib named.mtl\n{text}".encode("latin-1"))


def _thinned(parts: list[Part]) -> list[Part]:
    """Parts with about `_SIMPLE_TRIANGLES` triangles together."""
    count = sum(len(part.faces) for part in parts)
    try:
        thin = refined(parts, _SIMPLE_TRIANGLES if count > _SIMPLE_TRIANGLES else 10 * count)
    except ImportError as error:
        if count > _WITHOUT_SIMPLIFYING:
            raise InvalidInput(
                f"its model has {count} triangles, which pip install 'helios-ovmm[assets]' thins "
                "out"
            ) from error
        thin = parts
    if not thin:
        raise InvalidInput("its model has no area")
    return thin


def _visual(part: Part) -> Visual | None:
    split, normals = with_normals(part)
    if len(split.vertices) < 4 or np.ptp(split.vertices, axis=0).max() < 1e-3:
        return None
    uv = np.zeros((len(normals), 2)) if split.uv is None else split.uv
    mesh = Mesh(
        split.vertices.astype(np.float32),
        normals.astype(np.float32),
        uv.astype(np.float32),
        split.faces.astype(np.int32),
    )
    picture = None
    if part.picture is not None and split.uv is not None:
        digest = hashlib.sha256(part.picture.tobytes()).hexdigest()[:16]
        picture = Picture(f"plan_{digest}", _aligned(part.picture))
    rgb = (1.0, 1.0, 1.0) if picture is not None else part.rgb
    return Visual(mesh, Material(rgb, specular=0.1, picture=picture))


def _aligned(picture: np.ndarray) -> np.ndarray:
    """Picture whose sides are multiples of four pixels, as OpenGL aligns its rows."""
    height, width = (max(4, round(side / 4) * 4) for side in picture.shape[:2])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)


def _solid(box: np.ndarray) -> CollisionPrimitive:
    x, y, z, hx, hy, hz = (float(v) for v in box)
    return CollisionPrimitive("box", (hx, hy, hz), (x, y, z))


def _mean_rgb(parts: list[Part]) -> Rgb:
    rows = [
        np.asarray(p.rgb) if p.picture is None else p.picture.reshape(-1, 3).mean(axis=0) / 255
        for p in parts
    ]
    weights = [len(p.faces) for p in parts]
    r, g, b = (float(v) for v in np.average(rows, axis=0, weights=weights))
    return r, g, b
