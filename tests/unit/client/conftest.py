"""Fixtures: a gateway with fake services, and the command line connected to it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.client_command import Helios
from tests.gateway_process import Served, served


@pytest.fixture
def gateway(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with served() as gateway:
        yield gateway


@pytest.fixture
def helios(gateway: Served, capsys: pytest.CaptureFixture[str]) -> Helios:
    return Helios(gateway, capsys)
