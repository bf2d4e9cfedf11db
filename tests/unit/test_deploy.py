"""What `deploy/` starts is there: modules, flags, variables, and folders that may be written."""

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
def test_each_service_understands_its_command_and_finds_the_router(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, *flags = SERVICES[name]["command"]
    for variable, value in SERVICES[name]["environment"].items():
        monkeypatch.setenv(variable, value)
    settings = settings_of(module).load(flags)
    assert settings.router == "tcp/router:7447"
    assert importlib.util.find_spec(f"{module}.__main__") is not None


def test_the_router_listens_where_the_services_look() -> None:
    assert COMPOSE["services"]["router"]["command"] == [
        "helios_core.router", "--listen", "tcp/0.0.0.0:7447"
    ]  # fmt: skip


def test_what_survives_a_restart_is_kept_in_a_volume_of_its_own() -> None:
    assert set(STATE_DIRS) == {"objectmap", "map2d", "planner"}
    for name, folder in STATE_DIRS.items():
        assert SERVICES[name]["volumes"] == [f"{name}-state:{folder}"]
        assert f"{name}-state" in COMPOSE["volumes"]


def test_the_image_holds_these_folders_as_its_user_owns_them() -> None:
    """A volume of a folder that the image lacks would belong to root."""
    before_user, _, _ = IMAGE.partition("USER helios")
    made = re.search(r"mkdir -p ([^&]*)&& chown -R helios /state$", before_user, re.MULTILINE)
    assert made is not None
    assert set(made[1].split()) == set(STATE_DIRS.values())


def test_the_image_takes_the_versions_that_the_tests_run_with() -> None:
    assert "--constraint constraints.txt" in IMAGE
    assert re.search(r"^COPY .*\bconstraints\.txt\b", IMAGE, re.MULTILINE)
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert re.fullmatch(r"#.*|[\w.-]+==[\d.]+", line), f"{line!r} holds on this machine alone"
