"""Tests that the generated reference pages explain every setting, option, parameter and field."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

pytest.importorskip("sphinx", reason="the documentation's packages are not installed")

from scripts import page_of_commands, page_of_http, page_of_settings
from scripts.site_reference import PARTS, written


@pytest.mark.parametrize("make", [page_of_settings.page, page_of_commands.options])
def test_each_row_of_a_generated_table_has_a_meaning(make: Callable[[], str]) -> None:
    without, rows = [], 0
    for block in re.split(r"\n\n+", make()):
        lines = [line for line in block.splitlines() if line.startswith("|")]
        if len(lines) < 3:
            continue
        at = [cell.strip() for cell in lines[0].split("|")].index("meaning")
        for line in lines[2:]:
            rows += 1
            if not re.split(r"(?<!\\)\|", line)[at].strip():
                without.append(line)
    assert rows > 100
    assert not without


def test_each_parameter_and_field_over_http_has_a_meaning() -> None:
    without = [
        f"{method} {path} {parameter['name']}"
        for method, path, reported in page_of_http.operations()
        for parameter in reported.get("parameters", ())
        if not parameter.get("description")
    ]
    schemas = page_of_http.description()["components"]["schemas"]
    without += [
        f"{kind}.{name}"
        for kind, schema in schemas.items()
        for name, field in schema.get("properties", {}).items()
        if not (field.get("description") or field.get("examples"))
    ]
    assert not without


@pytest.mark.parametrize("name", sorted(PARTS))
def test_each_generated_part_has_text(name: str) -> None:
    assert PARTS[name][1]().strip()


def test_a_page_without_its_mark_is_refused() -> None:
    with pytest.raises(Exception, match="methods"):
        written("reference/python-sdk", "# SDK\n")
