"""Search context of `helios replay`, from its flags."""

from __future__ import annotations

import math
import uuid

from helios_core.name_rules import plain
from helios_core.types import Role, SearchClass, SearchContext

from helios_client.usage_errors import UsageError

DEFAULT_THRESHOLD = 0.25


def search_context_from_flags(classes: str, thresholds: str) -> SearchContext:
    """Search context from flags such as `"cup,dining table"` and `"cup=0.25"`. Raises
    UsageError."""
    names = [plain(name) for name in classes.split(",")]
    if not all(names):
        raise UsageError(f"--classes is {classes!r}; wanted names separated by commas")
    if len(set(names)) < len(names):
        raise UsageError(f"--classes is {classes!r}; name each class once")
    by_name = _thresholds(thresholds)
    if unknown := sorted(set(by_name) - set(names)):
        raise UsageError(f"--thresholds names {', '.join(unknown)}, which --classes does not")
    return SearchContext(
        id=f"replay-{uuid.uuid4().hex[:8]}",
        classes=tuple(
            SearchClass(name, Role.WATCH, by_name.get(name, DEFAULT_THRESHOLD)) for name in names
        ),
    )


def _thresholds(text: str) -> dict[str, float]:
    out: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, _, number = part.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not name.strip() or not 0 <= value <= 1:
            raise UsageError(f"--thresholds has {part!r}; wanted class=number, 0 to 1")
        out[plain(name)] = value
    return out
