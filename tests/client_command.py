"""Run the `helios` command against one gateway, for tests."""

from __future__ import annotations

import json

import pytest
from helios_client.cli import run

from tests.gateway_process import Served


class Helios:
    """Runs the `helios` command against one gateway. `error`: its last standard error."""

    def __init__(self, gateway: Served, capsys: pytest.CaptureFixture[str]) -> None:
        self.gateway, self._capsys = gateway, capsys
        self.error = ""

    def __call__(self, *args: str, status: int = 0) -> str:
        assert run([*args, "--port", str(self.gateway.port)]) == status
        said = self._capsys.readouterr()
        self.error = said.err
        return said.out

    def json(self, *args: str) -> dict:
        return json.loads(self(*args, "--json"))
