"""Reader for Wavefront OBJ and MTL files of Sweet Home 3D libraries: triangles by material."""

from __future__ import annotations

import io
from dataclasses import dataclass, field

import cv2
import numpy as np
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_sim.assets.sweethome_library import Entry

Rgb = tuple[float, float, float]

_MAX_PICTURE_PX = 256
_MOST_REPEATS = 1000.0
_CUT_OUT_SHARE = 0.1
_GLASS_ALPHA = 0.6
_GLASS_RGB = (0.72, 0.80, 0.82)
_PLAIN_RGB: Rgb = (0.7, 0.7, 0.7)


@dataclass(frozen=True)
class Part:
    """Triangles of one material. `uv` refers to `picture`, [h, w, 3] uint8, row 0 at v = 0."""

    vertices: NDArray[np.float64]  # [n, 3]
    faces: NDArray[np.int64]  # [m, 3]
    rgb: Rgb
    uv: NDArray[np.float64] | None = None  # [n, 2]
    picture: NDArray[np.uint8] | None = None


@dataclass
class _Material:
    rgb: Rgb = _PLAIN_RGB
    alpha: float = 1.0
    picture: str = ""


@dataclass
class _Text:
    """Parsed OBJ file; corners are rows of (position, texture coordinate) indices, -1 for none."""

    positions: list[list[float]] = field(default_factory=list)
    texture: list[list[float]] = field(default_factory=list)
    # material name -> corners, three per triangle
    corners: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    libraries: list[str] = field(default_factory=list)


def load_parts(files: dict[str, io.BytesIO], entry: Entry) -> list[Part]:
    """Parts of a model in the furniture frame, scaled to the size in the catalogue.

    Frame: x right, +y the back, z up, origin on the floor at the centre of the footprint.
    Raises InvalidInput if the file is no mesh or has cut-out textures.
    """
    name = entry.model.rpartition("/")[2]
    try:
        text = _read(files[name])
        materials: dict[str, _Material] = {}
        for library in text.libraries:
            if library in files:
                materials |= _read_materials(files[library])
    except (KeyError, ValueError, IndexError) as error:
        raise InvalidInput(f"model {entry.key} cannot be read as OBJ: {error!r}") from error
    if not any(text.corners.values()):
        raise InvalidInput(f"model {entry.key} holds no triangles")
    positions = np.array(text.positions)
    texture = np.array(text.texture) if text.texture else np.zeros((0, 2))
    texture[~(np.abs(texture) < _MOST_REPEATS)] = 0.0  # a few files hold invalid coordinates
    parts = []
    for material_name, rows in text.corners.items():
        if rows:
            material = materials.get(material_name, _Material())
            picture = _picture(files, material.picture, entry)
            parts.append(_part(positions, texture, np.array(rows), material, picture))
    return _in_our_frame(parts, entry)


def _read(file: io.BytesIO) -> _Text:
    text, material = _Text(), ""
    for line in file.getvalue().decode("latin-1").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            x, y, z = words[1:4]
            text.positions.append([float(x), float(y), float(z)])
        elif words[0] == "vt":
            u, v = words[1], words[2] if len(words) > 2 else "0"
            text.texture.append([float(u), float(v)])
        elif words[0] == "f":
            polygon = [_corner(word, text) for word in words[1:]]
            rows = text.corners.setdefault(material, [])
            for k in range(1, len(polygon) - 1):
                rows += (polygon[0], polygon[k], polygon[k + 1])
        elif words[0] == "usemtl":
            material = " ".join(words[1:])
        elif words[0] == "mtllib":
            text.libraries.append(" ".join(words[1:]))
    return text


def _corner(word: str, text: _Text) -> tuple[int, int]:
    """Zero-based indices of "position/texture/normal", which count from 1 or from the end."""
    position, _, rest = word.partition("/")
    uv = rest.partition("/")[0]
    p, t = int(position), int(uv) if uv else 0
    p = p - 1 if p > 0 else len(text.positions) + p
    t = t - 1 if t > 0 else len(text.texture) + t if t < 0 else -1
    if not 0 <= p < len(text.positions) or t >= len(text.texture):
        raise IndexError(f"face corner {word}")
    return p, t


def _read_materials(file: io.BytesIO) -> dict[str, _Material]:
    found: dict[str, _Material] = {}
    material = _Material()
    for line in file.getvalue().decode("latin-1").splitlines():
        words = line.split()
        if len(words) < 2:
            continue
        if words[0] == "newmtl":
            material = found.setdefault(" ".join(words[1:]), _Material())
        elif words[0] == "Kd" and len(words) >= 4:
            material.rgb = (float(words[1]), float(words[2]), float(words[3]))
        elif words[0] == "d":
            material.alpha = float(words[-1])
        elif words[0] == "map_Kd":
            material.picture = " ".join(words[1:])
    return found


def _part(
    positions: NDArray[np.float64],
    texture: NDArray[np.float64],
    corners: NDArray[np.int64],
    material: _Material,
    picture: NDArray[np.uint8] | None,
) -> Part:
    rows, inverse = np.unique(corners, axis=0, return_inverse=True)
    faces = inverse.reshape(-1, 3)
    if picture is not None and (rows[:, 1] >= 0).all():
        return Part(positions[rows[:, 0]], faces, (1.0, 1.0, 1.0), texture[rows[:, 1]], picture)
    rgb = material.rgb
    if picture is not None:  # without texture coordinates: the mean colour
        r, g, b = (picture.reshape(-1, 3).mean(axis=0) / 255).tolist()
        rgb = (r, g, b)
    elif material.alpha < _GLASS_ALPHA:
        # Glass is drawn opaque, so that images and depth agree with the collision shape.
        r, g, b = (0.3 * x + 0.7 * y for x, y in zip(rgb, _GLASS_RGB, strict=True))
        rgb = (r, g, b)
    return Part(positions[rows[:, 0]], faces, rgb)


def _picture(files: dict[str, io.BytesIO], name: str, entry: Entry) -> NDArray[np.uint8] | None:
    """Texture, at most 256 px a side, row 0 at v = 0. Options before the file name are ignored."""
    file = files.get(name) or files.get(name.rpartition(" ")[2])
    if file is None:
        return None
    data = np.frombuffer(file.getvalue(), np.uint8)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None or image.dtype != np.uint8:
        return None
    if image.ndim == 2:
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    if image.shape[2] == 4 and float((image[..., 3] < 128).mean()) > _CUT_OUT_SHARE:
        raise InvalidInput(f"{entry.key} has a cut-out texture ({name}), which cannot be drawn")
    height, width = image.shape[:2]
    factor = min(1.0, _MAX_PICTURE_PX / max(height, width))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small = cv2.resize(image[::-1, :, :3], size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small[..., ::-1]).astype(np.uint8)


def _in_our_frame(parts: list[Part], entry: Entry) -> list[Part]:
    turned = [part.vertices @ entry.rotation.T for part in parts]
    low = np.min([v.min(axis=0) for v in turned], axis=0)
    high = np.max([v.max(axis=0) for v in turned], axis=0)
    width, depth, height = entry.size_m
    scale = np.array([width, height, depth]) / np.maximum(high - low, 1e-9)
    origin = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    # In the file, front is +z and up is +y; in the furniture frame, -y and +z.
    axes = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    mirrored = float(np.linalg.det(entry.rotation)) < 0
    out = []
    for vertices, part in zip(turned, parts, strict=True):
        placed = ((vertices - origin) * scale) @ axes.T
        faces = part.faces[:, ::-1] if mirrored else part.faces
        out.append(Part(placed, faces, part.rgb, part.uv, part.picture))
    return out
