"""Which processes `helios up` starts, and with which settings."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_client.supervision.service_specs import ServiceSpecs
from helios_core.agent_presets import AGENT_SETTINGS


def flags_of(service: str, agent: str | None) -> dict[str, str]:
    """What the service's process is called with, after `python -m MODULE`."""
    specs = ServiceSpecs("sim", 7447, Path("state"), port=8080, agent=agent).specs()
    (argv,) = (spec.argv[3:] for spec in specs if spec.name == service)
    return dict(zip(argv[::2], argv[1::2], strict=True))


@pytest.mark.parametrize("agent", AGENT_SETTINGS)
def test_a_house_runs_with_the_settings_of_its_agent(agent: str) -> None:
    assert flags_of("planner", agent)["--agent"] == agent
    for name, value in AGENT_SETTINGS[agent].items():
        service, field = name.split(".")
        assert flags_of(service, agent)[f"--{field.replace('_', '-')}"] == str(value)


def test_without_an_agent_nothing_is_set() -> None:
    assert "--agent" not in flags_of("planner", None)
    assert "--evidence" not in flags_of("objectmap", None)
