"""Check that the models of a stack are on this machine, before any process starts."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from helios_core.errors import Unavailable
from helios_core.models.catalogue import HUB, missing_sentence
from helios_core.models.model_folder import fetched, in_hub_cache


def check_models(settings: Iterable[str | None]) -> None:
    """Raise Unavailable for the first `transformers:ID` whose files are not here. Other settings
    and folders are left to the detector."""
    for setting in settings:
        kind, _, id = (setting or "").partition(":")
        if kind != HUB or id.count("/") != 1 or id.startswith((".", "~", "/")):
            continue
        if not Path(id).exists() and not fetched(id) and not in_hub_cache(id):
            raise Unavailable(missing_sentence(id))
