"""Tests Spot's settings: their sources, and that a password is never shown."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_bridge.driver_loading import load_driver
from helios_bridge.settings import Settings as BridgeSettings
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_spot.settings import SpotSettings


@pytest.fixture(autouse=True)
def no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOST", "USERNAME", "PASSWORD", "CREDENTIALS_FILE"):
        monkeypatch.delenv(f"HELIOS_SPOT_{name}", raising=False)


def test_the_login_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HELIOS_SPOT_USERNAME", "user")
    monkeypatch.setenv("HELIOS_SPOT_PASSWORD", "hunter2")
    settings = SpotSettings.read("192.168.80.3")
    assert settings.login() == ("user", "hunter2")
    assert settings.host == "192.168.80.3"
    assert "hunter2" not in f"{settings!r} {settings}"


def test_the_login_comes_from_a_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "login"
    file.touch(mode=0o600)
    file.write_text("user\na pass word\n")
    monkeypatch.setenv("HELIOS_SPOT_CREDENTIALS_FILE", str(file))
    assert SpotSettings.read("spot").login() == ("user", "a pass word")
    file.write_text("user\n")
    with pytest.raises(InvalidInput, match="second"):
        SpotSettings.read("spot").login()
    file.unlink()
    with pytest.raises(InvalidInput, match="cannot read"):
        SpotSettings.read("spot").login()


@pytest.mark.parametrize("mode", [0o604, 0o640, 0o644])
def test_a_login_file_that_others_may_use_is_refused_without_its_content(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, mode: int
) -> None:
    file = tmp_path / "login"
    file.write_text("user\nhunter2\n")
    file.chmod(mode)
    monkeypatch.setenv("HELIOS_SPOT_CREDENTIALS_FILE", str(file))
    with pytest.raises(InvalidInput, match=f"mode {mode:04o}.*chmod 600 {file}") as refused:
        SpotSettings.read("spot").login()
    assert "hunter2" not in refused.value.message


def test_settings_come_from_the_spot_table_of_the_configuration_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text('[spot]\nhost = "robot.local"\nspeed_m_s = 0.3\n')
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    assert (SpotSettings.read().host, SpotSettings.read().speed_m_s) == ("robot.local", 0.3)
    assert SpotSettings.read("another").host == "another"


def test_an_invalid_setting_is_named_without_its_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HELIOS_SPOT_SPEED_M_S", "9.5")
    with pytest.raises(InvalidInput, match="speed_m_s") as wrong:
        SpotSettings.read("spot")
    assert "9.5" not in wrong.value.message


@pytest.mark.parametrize(
    ("host", "why"), [("", "--spot-host"), ("127.0.0.1", "HELIOS_SPOT_USERNAME")]
)
def test_the_bridge_names_a_missing_host_or_login(host: str, why: str) -> None:
    settings = BridgeSettings(driver="spot", address=host)
    with pytest.raises(InvalidInput, match=why):
        load_driver(settings, MemoryBus(MemoryHub()))


def test_the_bridge_loads_the_spot_driver_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    from helios_spot.driver import SpotDriver

    monkeypatch.setenv("HELIOS_SPOT_USERNAME", "user")
    monkeypatch.setenv("HELIOS_SPOT_PASSWORD", "hunter2")
    settings = BridgeSettings(driver="spot", address="127.0.0.1")
    assert isinstance(load_driver(settings, MemoryBus(MemoryHub())), SpotDriver)
