"""The page of the SDK names all that it can do, and nothing else."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "command-line.md"
CALL = re.compile(r"`(\w+)\(([^)]*)\)`")


def methods(client: type) -> set[str]:
    return {name for name, _ in inspect.getmembers(client, callable) if not name.startswith("_")}


def reported() -> dict[str, list[str]]:
    """Parameters by method, of the table under "From Python"."""
    section = PAGE.read_text().partition("\n## From Python\n")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    calls = [match for row in rows for match in CALL.findall(row)]
    assert len(calls) == len({name for name, _ in calls}), "each is told once"
    return {name: re.findall(r"\w+", given) for name, given in calls}


def test_every_public_method_is_in_the_page() -> None:
    assert set(reported()) == methods(Helios) == methods(AsyncHelios)


def test_the_parameters_in_the_page_are_those_of_the_methods() -> None:
    for name, parameters in reported().items():
        known = list(inspect.signature(getattr(Helios, name)).parameters)[1:]
        assert set(parameters) <= set(known), name
