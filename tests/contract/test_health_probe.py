"""The health check of a container: a service is on the bus, is not, or cannot be asked."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from helios_client.certs.names import Names
from helios_core.zenoh_bus import ZenohBus

from tests.contract.certified_router import Certified, certified_router
from tests.support import free_port

NAMES = Names(("127.0.0.1",), 7447, 10).with_robots(("r",), (), simulated=False)


@pytest.fixture(scope="module")
def router(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Certified]:
    with certified_router(tmp_path_factory.mktemp("certs") / "c", NAMES) as out:
        yield out


def probe(variables: Mapping[str, str], *flags: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "helios_core.health_probe", "planner", *flags],
        env=_environment() | dict(variables),
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done.returncode, done.stderr


def _environment() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if not k.startswith("HELIOS_")}


def test_a_service_is_found_with_its_own_certificate_as_long_as_it_runs(
    router: Certified, tmp_path: Path
) -> None:
    link = router.link("planner.r")
    settings = tmp_path / "helios.toml"
    settings.write_text(f'[all]\nrobot = "r"\nrouter = "{link.endpoint}"\n[planner]\ntau_g = 0.4\n')
    variables = {"HELIOS_CONFIG": str(settings), "HELIOS_PLANNER_CERTS": str(link.session)}
    status, said = probe(variables)
    assert status == 1
    assert "no planner of r on the bus" in said
    bus = ZenohBus(link, "r")
    try:
        bus.announce("planner", "x")
        assert probe(variables) == (0, "")
    finally:
        bus.close()


def test_a_dead_router_counts_unless_told_otherwise() -> None:
    variables = {"HELIOS_PLANNER_ROUTER": f"tcp/127.0.0.1:{free_port()}"}
    status, said = probe(variables)
    assert status == 1
    assert "no router at" in said
    assert probe(variables, "--unless-cut-off")[0] == 0


def test_a_wrong_setting_ends_with_status_2() -> None:
    status, said = probe({"HELIOS_PLANNER_ROBOT": "no such/name"})
    assert status == 2
    assert "planner" in said
