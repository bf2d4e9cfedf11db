"""`helios doctor --robot` through real processes, with faults injected into the simulated robot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_client.cli import run

from tests.helios_up import Up, helios_up
from tests.support import wait_until

pytestmark = pytest.mark.timeout(420)
FLAGS = ("--robot", "sim", "--seed", "3", "--detector", "ground-truth")


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    faults = {"HELIOS_WORLD_FAULTS": "pitch_deg=1.6,delay_ms=40"}
    with helios_up(tmp_path_factory.mktemp("state"), *FLAGS, environment=faults) as up:
        wait_until(up.ready, 180, "all services are ready")
        yield up


def test_the_doctor_names_the_faults_and_status_repeats_them(
    up: Up, capsys: pytest.CaptureFixture[str]
) -> None:
    port = up.address.rsplit(":", 1)[1]
    assert run(["doctor", "--robot", "--no-drive", "--json", "--port", port]) == 1
    told = json.loads(capsys.readouterr().out)
    checks = {check["name"]: check for check in told["checks"]}
    assert told["wrong"]
    assert {n for n, c in checks.items() if c["verdict"] == "wrong"} == {"pitch", "time offset"}
    assert checks["pitch"]["value"] == pytest.approx(1.6, rel=0.2)
    assert checks["time offset"]["value"] == pytest.approx(0.04, rel=0.2)
    assert checks["depth scale"]["value"] is None  # nothing was driven
    assert run(["status", "--port", port]) == 0
    assert "set-up: the camera looks 1.6 deg further down" in capsys.readouterr().out


def test_the_doctor_prints_a_table_of_words(up: Up, capsys: pytest.CaptureFixture[str]) -> None:
    port = up.address.rsplit(":", 1)[1]
    assert run(["doctor", "--robot", "--port", port]) == 1
    said = capsys.readouterr()
    assert "drives to and fro" in said.err
    assert "depth and driven distances agree" in said.out


def test_options_of_the_robot_need_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", "--no-drive"]) == 2
    assert "--robot" in capsys.readouterr().err
