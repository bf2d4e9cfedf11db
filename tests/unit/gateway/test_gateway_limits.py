"""Requests that a gateway without keys refuses before it reads their content."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient

from tests.gateway_backend import Backend


@pytest.mark.parametrize("broken", ["[", "[::1", "]:80", "[x]"])
def test_a_malformed_host_or_origin_is_refused(client: TestClient, broken: str) -> None:
    assert client.get("/v1/robot", headers={"host": broken}).status_code == 403
    for origin in (broken, f"http://{broken}"):
        refused = client.post("/v1/robot/clear-stop", headers={"origin": origin})
        assert refused.status_code == 403


def test_only_the_exact_addresses_accept_large_bodies(client: TestClient, backend: Backend) -> None:
    body = bytes(100_000)
    for verb, path in (
        ("PUT", "/v1/tasks/map.zip"),
        ("POST", "/v1/tasks/frames"),
        ("DELETE", "/v1/map.zip"),
        ("PUT", "/v1/frames"),
        ("POST", "/v1/tasks/robot/stop"),
    ):
        assert client.request(verb, path, content=body).status_code == 413
