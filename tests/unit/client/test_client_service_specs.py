"""Which processes `helios up` starts, and with which settings."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helios_client.supervision.service_specs import StackOptions
from helios_core.agent_presets import AGENT_NAMES, DEFAULT_AGENT, service_settings
from helios_core.settings import ServiceSettings
from helios_detector.settings import Settings as DetectorSettings
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.settings import Settings as PlannerSettings

SETTINGS: dict[str, type[ServiceSettings]] = {
    "planner": PlannerSettings,
    "objectmap": ObjectMapSettings,
}


def flags_of(service: str, agent: str | None) -> list[str]:
    """Arguments of the service's process after `python -m MODULE`."""
    specs = StackOptions("sim", 7447, Path("state"), port=8080, agent=agent).processes()
    (flags,) = (spec.argv[3:] for spec in specs if spec.name == service)
    return list(flags)


@pytest.mark.parametrize("agent", [None, *AGENT_NAMES])
@pytest.mark.parametrize("service", SETTINGS)
def test_every_service_starts_with_the_settings_of_the_agent(
    service: str, agent: str | None
) -> None:
    started = SETTINGS[service].load(flags_of(service, agent)).model_dump()
    plain = SETTINGS[service](**{k: started[k] for k in ("router", "state_dir")}).model_dump()
    own = service_settings(service, agent or DEFAULT_AGENT)
    assert started == plain | {"agent": agent or DEFAULT_AGENT} | own


@pytest.mark.parametrize("service", SETTINGS)
def test_every_service_refuses_a_misspelt_agent_name(
    service: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        SETTINGS[service].load(["--agent", "heliso"])
    assert ended.value.code == 2
    assert "choose one of helios, helios-paper" in capsys.readouterr().err


def test_compact_puts_all_services_in_one_process_but_router_world_and_ros() -> None:
    options = {"port": 8080, "ros2_python": "/ros/python", "ros2_output": True}
    apart = StackOptions("sim", 7447, Path("state"), **options).processes()
    compact = StackOptions("sim", 7447, Path("state"), **options, compact=True).processes()
    assert [spec.name for spec in compact] == ["router", "world", "ros2", "services"]
    assert compact[-1].services == (
        "bridge",
        "detector",
        "objectmap",
        "map2d",
        "planner",
        "gateway",
    )
    command_lines = json.loads(compact[-1].argv[-1])
    of_each = {spec.name: list(spec.argv[2:]) for spec in apart}
    assert command_lines == [of_each[name] for name in compact[-1].services]


def test_each_simulated_home_has_errors_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names of objects repeat across homes, and the errors are drawn by name and seed."""

    def noise_seed(seed: int) -> int:
        specs = StackOptions("sim", 7447, Path("state"), port=8080, seed=seed).processes()
        (flags,) = (list(spec.argv[3:]) for spec in specs if spec.name == "detector")
        return DetectorSettings.load(flags).noise_seed

    assert [noise_seed(k) for k in (0, 7)] == [0, 7]
    monkeypatch.setenv("HELIOS_DETECTOR_NOISE_SEED", "3")
    assert noise_seed(7) == 3
