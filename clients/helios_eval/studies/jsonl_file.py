"""Files with one JSON object a line, to which an interrupted study adds."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def whole_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Objects of a file, none without it. Lines that a killed process left torn are left out, so
    what they stand for is played again."""
    if not path.exists():
        return
    for line in path.read_bytes().splitlines():
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict):
            yield found
