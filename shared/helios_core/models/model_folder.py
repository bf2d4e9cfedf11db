"""The folder of fetched models, with its lock file.

    FOLDER/models.lock.json      revision, licence, sizes and checksums of every fetched model
    FOLDER/OWNER/NAME/…          files of a model of the hub
    FOLDER/onnx/NAME.onnx        an ONNX file

The folder is `$HELIOS_MODELS`, or `$XDG_DATA_HOME/helios/models`. It has no links and no absolute
paths, so you can copy it to another machine.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from helios_core.models.catalogue import ONNX

VARIABLE = "HELIOS_MODELS"
LOCK = "models.lock.json"
FORMAT = 1
PUBLISHER, FIRST_DOWNLOAD = "publisher", "first download"


@dataclass(frozen=True)
class LockedFile:
    """Size and checksum of one file."""

    bytes: int
    sha256: str
    checked_by: str  # PUBLISHER: compared with its checksum; FIRST_DOWNLOAD: computed here


@dataclass(frozen=True)
class LockedModel:
    """A fetched model."""

    source: str  # address that it came from
    revision: str  # commit of the hub; empty for an ONNX file
    licence: str
    fetched_at: str  # ISO 8601, UTC
    files: Mapping[str, LockedFile] = field(default_factory=dict)  # path in the model's folder

    @property
    def bytes(self) -> int:
        return sum(f.bytes for f in self.files.values())


def default_folder() -> Path:
    """The folder that services and `helios models` use."""
    if named := os.environ.get(VARIABLE, ""):
        return Path(named).expanduser()
    base = os.environ.get("XDG_DATA_HOME", "")
    root = Path(base) if os.path.isabs(base) else Path.home() / ".local" / "share"
    return root / "helios" / "models"


def place_of(folder: Path, id: str) -> Path:
    """Folder of a model's files. Raises InvalidInput for an id that would leave the folder."""
    if id.endswith(".onnx") and "/" not in id:
        return folder / ONNX
    owner, slash, name = id.partition("/")
    if not slash or "/" in name or {owner, name} & {"", ".", ".."} or "\\" in id:
        raise InvalidInput(f"{id!r} is no model of the hub; wanted OWNER/NAME")
    return folder / owner / name


def read_lock(folder: Path) -> dict[str, LockedModel]:
    """The fetched models by id; empty without a lock file. Raises InvalidInput for a broken one."""
    path = folder / LOCK
    try:
        stored = json.loads(path.read_text())
        if stored["format"] != FORMAT:
            raise ValueError(f"format {stored['format']}")
        return {id: _model(entry) for id, entry in stored["models"].items()}
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidInput(
            f"{path} is damaged ({error}); delete it and fetch the models again"
        ) from error


def write_lock(folder: Path, models: Mapping[str, LockedModel]) -> None:
    """Replace the lock file. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    stored = {"format": FORMAT, "models": {id: asdict(m) for id, m in sorted(models.items())}}
    write_file(folder / LOCK, json.dumps(stored, indent=1) + "\n")


def fetched(id: str, folder: Path | None = None) -> Path | None:
    """Folder of a completely fetched model; None if a file is missing or has another size.

    Raises InvalidInput for a broken lock file.
    """
    folder = folder or default_folder()
    model = read_lock(folder).get(id)
    if model is None:
        return None
    place = place_of(folder, id)
    return place if all(_has(place / name, f.bytes) for name, f in model.files.items()) else None


def onnx_file(named: str) -> Path:
    """Path of an ONNX file: as named, or else the fetched one of that name."""
    path = Path(named)
    if path.exists() or path.name != named:
        return path
    place = fetched(named)
    return place / named if place else path


def in_hub_cache(id: str) -> bool:
    """True if the cache of the hub's library has a revision of this model."""
    env = os.environ
    home = Path(env.get("HF_HOME") or Path(env.get("XDG_CACHE_HOME") or "~/.cache") / "huggingface")
    cache = Path(env.get("HF_HUB_CACHE") or home / "hub").expanduser()
    entry = cache / f"models--{id.replace('/', '--')}"
    try:
        revision = (entry / "refs" / "main").read_text().strip()
    except OSError:
        return False
    return (entry / "snapshots" / revision / "config.json").exists()


def _has(path: Path, size: int) -> bool:
    try:
        return path.stat().st_size == size
    except OSError:
        return False


def _model(entry: Mapping[str, Any]) -> LockedModel:
    files = {name: LockedFile(**f) for name, f in entry["files"].items()}
    if any(Path(name).is_absolute() or ".." in Path(name).parts for name in files):
        raise ValueError("a file lies outside the folder")
    return LockedModel(**{**entry, "files": files})
