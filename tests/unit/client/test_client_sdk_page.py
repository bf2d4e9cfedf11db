"""The generated SDK page lists every public method."""

from __future__ import annotations

import inspect

import pytest
from helios_client.sdk import Helios

pytest.importorskip("sphinx", reason="the documentation's packages are not installed")

from scripts import page_of_sdk


def test_every_public_method_is_on_the_page() -> None:
    text = page_of_sdk.methods()
    names = [n for n, _ in inspect.getmembers(Helios, callable) if not n.startswith("_")]
    assert not [name for name in names if f"{name}(" not in text and f".{name}" not in text]
