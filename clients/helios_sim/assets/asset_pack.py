"""Packs of baked models with visuals, boxes and surfaces, in a folder of the user's cache.

$XDG_CACHE_HOME/helios/furniture/current -> sweethome3d-KEY/
    models.npz       triangles and textures
    models.json      all other data, with the SHA-256 of models.npz
    ATTRIBUTIONS.md  author and licence of each model
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from helios_core.errors import InvalidInput, Unavailable
from numpy.typing import NDArray

FORMAT = "helios-furniture-1"
NAME = "sweethome3d"
ARRAYS, INDEX, ATTRIBUTIONS = "models.npz", "models.json", "ATTRIBUTIONS.md"
BAKE_FIRST = "bake it with: helios assets bake"


@dataclass(frozen=True)
class ModelVisual:
    """Visual mesh of one material; vertices and normals [n, 3], uv [n, 2], faces [m, 3]."""

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    uv: NDArray[np.float32]
    faces: NDArray[np.int32]
    rgb: tuple[float, float, float]
    picture: str = ""  # texture: key of `Pack.pictures`


@dataclass(frozen=True)
class Model:
    """Baked model in the furniture frame: floor at z = 0, back at +y, metres."""

    key: str
    classes: tuple[str, ...]
    title: str
    author: str
    licence: str
    size_m: tuple[float, float, float]
    rgb: tuple[float, float, float]
    boxes: tuple[tuple[float, ...], ...]  # centre and half extents, 6 values each
    surfaces: tuple[tuple[float, ...], ...]  # centre x, y, half extents x, y, height
    looks: tuple[ModelVisual, ...] = field(repr=False, compare=False)


@dataclass(frozen=True)
class Pack:
    """All baked models. `digest` identifies the models and the baking procedure."""

    digest: str
    models: tuple[Model, ...]
    pictures: Mapping[str, NDArray[np.uint8]]  # key -> [h, w, 3], row 0 at v = 0

    def of_class(self, class_name: str) -> tuple[Model, ...]:
        return tuple(model for model in self.models if class_name in model.classes)


def default_cache() -> Path:
    """Folder `$XDG_CACHE_HOME/helios/furniture`, or `~/.cache/helios/furniture`."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    return root / "helios" / "furniture"


def write(pack: Pack, attributions: str, cache: Path) -> Path:
    """Replace the current pack atomically; return the folder of the new one."""
    cache.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=".baking-", dir=cache))
    try:
        arrays: dict[str, NDArray[Any]] = {}
        index = []
        for k, model in enumerate(pack.models):
            row = asdict(model) | {"looks": []}
            for j, look in enumerate(model.looks):
                arrays |= _packed(f"{k}.{j}.", look, model.size_m)
                row["looks"].append({"rgb": look.rgb, "picture": look.picture})
            index.append(row)
        for key, picture in pack.pictures.items():
            coded, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 82])
            assert coded
            arrays[f"picture.{key}"] = data.ravel()
        np.savez_compressed(scratch / ARRAYS, allow_pickle=False, **arrays)
        head = {
            "format": FORMAT,
            "digest": pack.digest,
            "arrays_sha256": _sha256(scratch / ARRAYS),
            "models": index,
        }
        (scratch / INDEX).write_text(json.dumps(head, indent=1))
        (scratch / ATTRIBUTIONS).write_text(attributions)
        return _put(scratch, cache, pack.digest)
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise


def _put(scratch: Path, cache: Path, digest: str) -> Path:
    """Rename the folder into place, then point the link `current` to it; both are atomic."""
    target = cache / f"{NAME}-{digest[:12]}"
    if target.exists():  # a damaged copy of the same pack
        target.rename(scratch.with_name(scratch.name + ".old"))
    scratch.chmod(0o755)
    scratch.rename(target)
    link = scratch.with_name(scratch.name + ".link")
    link.symlink_to(target.name)
    link.replace(cache / "current")
    for other in cache.iterdir():
        ours = other.name.startswith((f"{NAME}-", ".baking-"))
        if ours and other.is_dir() and not other.is_symlink() and other != target:
            shutil.rmtree(other, ignore_errors=True)
    return target


def read(cache: Path | None = None) -> Pack:
    """Current pack. Raises Unavailable if there is none, InvalidInput if damaged or foreign."""
    folder = (cache or default_cache()) / "current"
    head = read_index(folder)
    try:
        if _sha256(folder / ARRAYS) != head["arrays_sha256"]:
            raise ValueError(f"{ARRAYS} is not what {INDEX} says")
        with np.load(folder / ARRAYS, allow_pickle=False) as arrays:
            models = tuple(_model(k, row, arrays) for k, row in enumerate(head["models"]))
            pictures = {
                name.partition(".")[2]: _decoded(arrays[name])
                for name in arrays.files
                if name.startswith("picture.")
            }
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InvalidInput(
            f"the furniture in {folder} is damaged ({error}); {BAKE_FIRST}"
        ) from error
    return Pack(head["digest"], models, pictures)


def read_index(folder: Path) -> dict[str, Any]:
    """Content of `models.json`. Raises Unavailable without the file, InvalidInput if foreign."""
    path = folder / INDEX
    try:
        head = json.loads(path.read_text())
    except FileNotFoundError:
        raise Unavailable(f"no realistic furniture in {folder.parent}; {BAKE_FIRST}") from None
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{path} cannot be read ({error}); {BAKE_FIRST}") from error
    came = head.get("format") if isinstance(head, dict) else None
    if came != FORMAT:
        raise InvalidInput(f"{path} has format {came!r}; {FORMAT!r} is wanted: {BAKE_FIRST}")
    return head


def _packed(
    prefix: str, look: ModelVisual, size_m: tuple[float, float, float]
) -> dict[str, NDArray[Any]]:
    """Quantized arrays: positions in 1/65535 of twice the box, normals in 1/127, uv in 1/1024."""
    span = np.array(size_m) * 2
    return {
        f"{prefix}v": np.round((look.vertices / span + 0.5) * 65535).clip(0, 65535).astype("u2"),
        f"{prefix}n": np.round(look.normals * 127).astype("i1"),
        f"{prefix}t": np.round(look.uv * 1024).astype("i4"),
        f"{prefix}f": look.faces.astype("u2" if len(look.vertices) < 65536 else "u4"),
    }


def _model(k: int, row: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Model:
    size = tuple(float(v) for v in row["size_m"])
    looks = []
    for j, look in enumerate(row["looks"]):
        prefix = f"{k}.{j}."
        vertices = (arrays[f"{prefix}v"] / 65535.0 - 0.5) * np.array(size) * 2
        normals = arrays[f"{prefix}n"].astype(np.float32)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
        looks.append(
            ModelVisual(
                vertices.astype(np.float32),
                normals,
                (arrays[f"{prefix}t"] / 1024.0).astype(np.float32),
                arrays[f"{prefix}f"].astype(np.int32),
                (look["rgb"][0], look["rgb"][1], look["rgb"][2]),
                look["picture"],
            )
        )
    return Model(
        key=row["key"],
        classes=tuple(row["classes"]),
        title=row["title"],
        author=row["author"],
        licence=row["licence"],
        size_m=(size[0], size[1], size[2]),
        rgb=(row["rgb"][0], row["rgb"][1], row["rgb"][2]),
        boxes=tuple(tuple(box) for box in row["boxes"]),
        surfaces=tuple(tuple(surface) for surface in row["surfaces"]),
        looks=tuple(looks),
    )


def _decoded(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    image = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("a picture cannot be decoded")
    return np.ascontiguousarray(image[..., ::-1]).astype(np.uint8)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
