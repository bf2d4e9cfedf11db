"""Tests that the modules, flags, variables and writable folders of `deploy/` exist."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

from tests.support import settings_of

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

ROOT = Path(__file__).parents[2]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "deploy/compose.yaml").read_text())
IMAGE = (ROOT / "deploy/Dockerfile").read_text()
SERVICES = {name: s for name, s in COMPOSE["services"].items() if name != "router"}
STATE_DIRS = {
    name: service["command"][service["command"].index("--state-dir") + 1]
    for name, service in SERVICES.items()
    if "--state-dir" in service["command"]
}


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_accepts_its_command_and_connects_to_the_router(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, *flags = SERVICES[name]["command"]
    for variable, value in SERVICES[name]["environment"].items():
        monkeypatch.setenv(variable, value)
    settings = settings_of(module).load(flags)
    assert settings.router == "tcp/router:7447"
    assert importlib.util.find_spec(f"{module}.__main__") is not None


def test_the_router_listens_on_the_port_of_the_services() -> None:
    assert COMPOSE["services"]["router"]["command"] == [
        "helios_core.router", "--listen", "tcp/0.0.0.0:7447"
    ]  # fmt: skip


def test_each_state_folder_has_its_own_volume() -> None:
    assert set(STATE_DIRS) == {"objectmap", "map2d", "planner"}
    for name, folder in STATE_DIRS.items():
        assert SERVICES[name]["volumes"] == [f"{name}-state:{folder}"]
        assert f"{name}-state" in COMPOSE["volumes"]


def test_the_image_contains_the_state_folders_owned_by_its_user() -> None:
    """The volume of a folder that is missing in the image would belong to root."""
    before_user, _, _ = IMAGE.partition("USER helios")
    made = re.search(r"mkdir -p ([^&]*)&& chown -R helios /state$", before_user, re.MULTILINE)
    assert made is not None
    assert set(made[1].split()) == set(STATE_DIRS.values())


def test_the_image_installs_the_package_versions_of_the_tests() -> None:
    assert "--constraint constraints.txt" in IMAGE
    assert re.search(r"^COPY .*\bconstraints\.txt\b", IMAGE, re.MULTILINE)
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert re.fullmatch(r"#.*|[\w.-]+==[\d.]+", line), f"{line!r} holds on this machine alone"
