"""The generated reference pages: each thing that a user can name has its meaning there."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("sphinx", reason="the documentation's packages are not installed")

from scripts.site_reference import PARTS, written


@pytest.mark.parametrize("name", sorted(PARTS))
def test_each_row_of_a_generated_table_has_a_meaning(name: str) -> None:
    _, make = PARTS[name]
    without, rows = [], 0
    for block in re.split(r"\n\n+", make()):
        lines = [line for line in block.splitlines() if line.startswith("|")]
        if len(lines) < 3 or "meaning" not in lines[0]:
            continue
        at = [cell.strip() for cell in lines[0].split("|")].index("meaning")
        for line in lines[2:]:
            cells = re.split(r"(?<!\\)\|", line)
            rows += 1
            if not cells[at].strip():
                without.append(line)
    assert not without
    assert rows or name in ("errors", "methods")


def test_a_page_without_its_mark_is_refused() -> None:
    with pytest.raises(Exception, match="settings"):
        written("reference/settings", "# Settings\n")
