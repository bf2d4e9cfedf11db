"""Tests that the units of `deploy/systemd` are valid, sandboxed, and start what exists."""

from __future__ import annotations

import configparser
import importlib.util
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support import settings_of

FOLDER = Path(__file__).parents[2] / "deploy/systemd"
UNITS = ("helios@.service", "helios-router.service", "helios.target")
SETTINGS = tomllib.loads((FOLDER / "helios.toml").read_text())


def unit(name: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read(FOLDER / name)
    return parser


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd is not installed")
def test_systemd_takes_every_unit_as_it_is(tmp_path: Path) -> None:
    for name in UNITS:  # the interpreter of /opt/helios is not there in a test
        text = (FOLDER / name).read_text().replace("/opt/helios/bin/python", sys.executable)
        (tmp_path / name.replace("@.", "@planner.")).write_text(text)
        (tmp_path / name).write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *(str(p) for p in sorted(tmp_path.iterdir()))],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    ours = [line for line in done.stderr.splitlines() if "helios" in line]
    assert not ours


@pytest.mark.parametrize("name", ["helios@.service", "helios-router.service"])
def test_each_service_runs_in_a_sandbox(name: str) -> None:
    service = unit(name)["Service"]
    for key in ("NoNewPrivileges", "ProtectHome", "PrivateTmp", "RestrictSUIDSGID"):
        assert service[key] == "yes"
    assert service["ProtectSystem"] == "strict"
    assert service["CapabilityBoundingSet"] == ""
    assert service["User"] == "helios"


@pytest.mark.parametrize("name", ["helios@.service", "helios-router.service"])
def test_each_service_starts_again_however_often_it_ends(name: str) -> None:
    assert unit(name)["Unit"]["StartLimitIntervalSec"] == "0"
    assert unit(name)["Service"]["Restart"] == "always"


def test_the_target_starts_services_that_exist() -> None:
    wanted = unit("helios.target")["Unit"]["Wants"].split()
    assert wanted[0] == "helios-router.service"
    for instance in wanted[1:]:
        name = instance.removeprefix("helios@").removesuffix(".service")
        assert importlib.util.find_spec(f"helios_{name}.__main__") is not None
        assert name in SETTINGS


@pytest.mark.parametrize("name", [name for name in SETTINGS if name != "all"])
def test_each_service_accepts_the_settings(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HELIOS_CONFIG", str(FOLDER / "helios.toml"))
    settings = settings_of(f"helios_{name}").load([])
    for key, value in SETTINGS[name].items():
        assert str(getattr(settings, key)) == str(value)


def test_all_state_lies_in_the_folder_that_the_unit_may_write() -> None:
    assert unit("helios@.service")["Service"]["StateDirectory"] == "helios"
    folders = [
        v
        for table in SETTINGS.values()
        for k, v in table.items()
        if k in ("state_dir", "out", "faults", "audit", "fleet_queue")
    ]
    assert len(folders) == 8
    assert all(folder.startswith("/var/lib/helios/") for folder in folders)


def test_a_service_may_open_the_devices_of_the_machine() -> None:
    """ProtectClock closes /dev before systemd 253, which Ubuntu 22.04 lacks."""
    closing = {"PrivateDevices", "ProtectClock", "DevicePolicy", "DeviceAllow"}
    assert closing.isdisjoint(unit("helios@.service")["Service"])
