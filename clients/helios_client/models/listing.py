"""Rows of `helios models list`."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from helios_core.models.catalogue import (
    CATALOGUE,
    MINILM_PACKAGE,
    PACKAGE,
    CatalogueModel,
    size_text,
)
from helios_core.models.model_folder import LockedModel, fetched, in_hub_cache, read_lock

MB = 1e6


@dataclass(frozen=True)
class Row:
    """One model."""

    id: str
    use: str  # detector, masks, scorer, depth; empty for one that is not recommended
    setting: str
    size: str  # for people; an estimate begins with ~
    bytes: int | None  # exact; None until it is fetched
    licence: str
    state: str  # yes, incomplete, in the hub's cache, no
    revision: str
    note: str


def rows(folder: Path) -> list[Row]:
    """The recommended models, then the other fetched ones. Raises InvalidInput for a broken lock
    file."""
    lock = read_lock(folder)
    recommended = [_row(model, lock.get(model.id), folder) for model in CATALOGUE]
    names = {model.id for model in CATALOGUE}
    others = [
        Row(
            id,
            "",
            f"transformers:{id}",
            size_text(m.bytes / MB),
            m.bytes,
            m.licence,
            "yes" if fetched(id, folder) else "incomplete",
            m.revision,
            "",
        )
        for id, m in lock.items()
        if id not in names
    ]
    return recommended + others


def _row(model: CatalogueModel, made: LockedModel | None, folder: Path) -> Row:
    size = size_text(made.bytes / MB) if made else f"~{size_text(model.about_mb)}"
    return Row(
        model.id,
        model.use,
        model.setting,
        size,
        made.bytes if made else None,
        made.licence if made else model.licence,
        _state(model, made, folder),
        made.revision if made else "",
        model.note,
    )


def _state(model: CatalogueModel, made: LockedModel | None, folder: Path) -> str:
    if model.kind == PACKAGE:
        return "yes" if importlib.util.find_spec(MINILM_PACKAGE) else "no"
    if fetched(model.id, folder):
        return "yes"
    if made:
        return "incomplete"
    return "in the hub's cache" if in_hub_cache(model.id) else "no"
