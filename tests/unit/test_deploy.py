"""Tests that the modules, flags, variables and writable folders of `deploy/` exist."""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helios_core.settings import ServiceSettings

from tests.support import settings_of

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

ROOT = Path(__file__).parents[2]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "deploy/compose.yaml").read_text())
IMAGE = (ROOT / "deploy/Dockerfile").read_text()
SERVICES = {name: s for name, s in COMPOSE["services"].items() if name != "router"}
TARGETS = re.findall(r"^FROM source AS ([a-z0-9]+)-build$", IMAGE, re.M)
EXTRAS: dict[str, list[str]] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
    "optional-dependencies"
]
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
        "helios_core.router",
        "--listen",
        "tcp/0.0.0.0:7447",
    ]


def test_each_state_folder_has_its_own_volume() -> None:
    assert set(STATE_DIRS) == {"bridge", "objectmap", "map2d", "planner"}
    for name, folder in STATE_DIRS.items():
        assert f"{name}-state:{folder}" in SERVICES[name]["volumes"]
        assert f"{name}-state" in COMPOSE["volumes"]


def of_compose(name: str) -> ServiceSettings:
    module, *flags = SERVICES[name]["command"]
    return settings_of(module).load(flags)


def of_image(name: str) -> ServiceSettings:
    [command] = re.findall(rf"^FROM \w+ AS {name}\n.*?^CMD (\[.*?\])$", IMAGE, re.M | re.S)
    module, *flags = json.loads(command.replace("\\\n", ""))
    return settings_of(module).load(flags)


def of_file(folder: str) -> Callable[[str], ServiceSettings]:
    def load(name: str) -> ServiceSettings:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("HELIOS_CONFIG", str(ROOT / "deploy" / folder / "helios.toml"))
            return settings_of(f"helios_{name}").load([])

    return load


@pytest.mark.parametrize("load", [of_compose, of_image, of_file("systemd"), of_file("kubernetes")])
@pytest.mark.parametrize(
    ("name", "setting"),
    [
        ("bridge", "state_dir"),  # a stop
        ("planner", "state_dir"),
        ("objectmap", "state_dir"),
        ("map2d", "state_dir"),
        ("gateway", "faults"),
        ("gateway", "audit"),
        ("gateway", "fleet_queue"),
        ("recorder", "out"),
    ],
)
def test_stops_tasks_maps_and_records_are_kept_where_the_service_may_write(
    load: Callable[[str], ServiceSettings], name: str, setting: str
) -> None:
    path = getattr(load(name), setting)
    folders = (f"/state/{name}", "/var/lib/helios")
    assert any(path.is_relative_to(folder) for folder in folders)


@pytest.mark.parametrize("name", COMPOSE["services"])
def test_each_container_runs_closed_from_the_image_of_its_service(name: str) -> None:
    service = COMPOSE["services"][name]
    assert service["build"]["target"] == name
    assert service["image"] == f"helios-{name}"
    assert service["read_only"]
    assert service["cap_drop"] == ["ALL"]


@pytest.mark.parametrize("target", TARGETS)
def test_each_image_runs_as_a_user_and_installs_extras_that_exist(target: str) -> None:
    installed = re.search(rf"^FROM source AS {target}-build\n(?:ARG .*\n)?RUN (.*)$", IMAGE, re.M)
    assert installed is not None
    named = re.search(r"\.\[(.*)\]", installed[1])
    extras = named[1].replace("${DETECTOR_EXTRAS}", "detector").split(",") if named else []
    assert set(extras) <= EXTRAS.keys()
    assert ("tracing" in extras) == (target != "router")
    last_user = re.findall(r"^USER (.*)$", IMAGE, re.M)[-1]
    assert last_user == "1000"


@pytest.mark.parametrize("target", sorted(set(TARGETS) - {"all"}))
def test_each_image_of_a_service_checks_its_health(target: str) -> None:
    stage = re.search(rf"^FROM \w+ AS {target}\n(.*?)^CMD", IMAGE, re.M | re.S)
    assert stage is not None
    assert "HEALTHCHECK" in stage[1]


def test_no_image_of_a_single_service_brings_torch() -> None:
    for target in set(TARGETS) - {"all"}:
        [line] = re.findall(rf"^FROM source AS {target}-build\n(?:ARG .*\n)?RUN (.*)$", IMAGE, re.M)
        for extra in re.findall(r"[\w-]+", (re.findall(r"\.\[(.*)\]", line) or [""])[0]):
            assert not any(need.startswith("torch") for need in EXTRAS.get(extra, [])), extra


def test_a_release_publishes_every_image_of_a_service() -> None:
    release = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text())
    published = release["jobs"]["images"]["strategy"]["matrix"]["target"]
    assert set(published) == set(TARGETS) - {"all"}


def test_the_image_contains_the_state_folders_owned_by_its_user() -> None:
    """The volume of a folder that is missing in the image would belong to root."""
    before_user, _, _ = IMAGE.partition("USER 1000")
    made = re.search(r"mkdir -p ([^&]*)&& chown -R helios /state /kernels$", before_user, re.M)
    assert made is not None
    assert set(made[1].replace("\\", "").split()) >= {*STATE_DIRS.values(), "/kernels"}


def test_the_build_context_holds_what_the_image_copies_and_no_more() -> None:
    copied = re.findall(r"^COPY (?!--from)(.*) \S+$", IMAGE, re.M)
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    everything, *taken, caches = (line for line in lines if not line.startswith("#"))
    assert (everything, caches) == ("*", "**/__pycache__")
    assert {line.removeprefix("!") for line in taken} == set(" ".join(copied).split())


def test_the_image_installs_the_package_versions_of_the_tests() -> None:
    assert "--constraint constraints.txt" in IMAGE
    assert re.search(r"^COPY .*\bconstraints\.txt\b", IMAGE, re.MULTILINE)
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert re.fullmatch(r"#.*|[\w.-]+==[\w.]+", line), f"{line!r} holds on this machine alone"
