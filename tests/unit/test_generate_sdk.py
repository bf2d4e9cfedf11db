"""Tests that the blocking SDK is the asynchronous SDK without `await`."""

from __future__ import annotations

import inspect

import pytest
from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios

from scripts import generate_sdk


def test_the_committed_file_matches_the_generated_source() -> None:
    assert generate_sdk.TARGET.read_text() == generate_sdk.generated()


def test_both_sdks_have_the_same_methods_and_parameters() -> None:
    def surface(kind: type) -> dict[str, list[tuple[str, object]]]:
        return {
            name: [(p.name, p.default) for p in inspect.signature(method).parameters.values()]
            for name, method in inspect.getmembers(kind, inspect.isfunction)
            if not name.startswith("_")
        }

    assert surface(Helios) == surface(AsyncHelios)


def test_a_replacement_that_matches_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate_sdk, "REPLACED", (("nowhere at all", ""),))
    with pytest.raises(ValueError, match="nowhere at all"):
        generate_sdk.generated()
