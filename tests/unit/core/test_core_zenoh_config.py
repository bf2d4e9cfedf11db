"""Wrong endpoints are refused as settings, before anything waits for a router."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_core.zenoh_config import client_config, router_config, router_config_of_file

WRONG = ("7447", "127.0.0.1:7447", "tcp")


@pytest.mark.parametrize("endpoint", WRONG)
def test_a_text_that_is_no_endpoint_is_refused_with_an_example(
    endpoint: str, tmp_path: Path
) -> None:
    file = tmp_path / "router.json5"
    file.write_text('{"mode": "router"}')
    file.chmod(0o600)
    for make in (client_config, router_config, lambda text: router_config_of_file(file, text)):
        with pytest.raises(InvalidInput, match=f"'{endpoint}' is no endpoint; wanted for example"):
            make(endpoint)


def test_an_endpoint_is_accepted() -> None:
    assert "tcp/127.0.0.1:7447" in str(client_config("tcp/127.0.0.1:7447"))
