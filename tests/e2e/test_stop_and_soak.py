"""Short runs of `helios stop-distance` and `helios soak`. Times depend on the machine: see the
reports."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from helios_chaos import load_run

pytestmark = [pytest.mark.timeout(900), pytest.mark.long]

HELIOS = (sys.executable, "-m", "helios_client")
SERVICES = {
    "supervisor",
    "router",
    "world",
    "bridge",
    "detector",
    "objectmap",
    "map2d",
    "planner",
    "gateway",
}


def run(*args: str) -> str:
    done = subprocess.run(
        [*HELIOS, *args], capture_output=True, text=True, timeout=800, check=False
    )
    assert done.returncode in (0, 1), done.stderr  # 1: a limit was missed
    return done.stdout


def test_the_robot_stops_for_every_cause_and_the_stop_outlives_every_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HELIOS_GATEWAY_STOP_TIMEOUT_S", "20")  # the bridge may wait for a core
    path = tmp_path / "stop.json"
    run("stop-distance", "--trials", "1", "--json", str(path))
    told = json.loads(path.read_text())
    causes = {found["cause"]: found["trials"] for found in told["causes"]}
    assert causes == dict.fromkeys(("stop", "planner", "gateway", "bridge link", "router"), 1)
    assert set(told["latch"]) == SERVICES - {"supervisor", "world"}
    assert all(told["latch"].values())
    assert not told["unconfirmed"]["told_as_stopped"]
    assert "may still move" in told["unconfirmed"]["error"]


def test_a_soak_notes_every_service_and_loses_no_task(tmp_path: Path) -> None:
    out = tmp_path / "soak"
    run("soak", "--hours", "0.01", "--out", str(out))
    told = json.loads((out / "soak.json").read_text())
    assert told["tasks"] >= 1
    assert told["lost"] == 0
    with (out / "soak.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["service"] for row in rows} >= SERVICES
    assert all(float(row["rss_mb"]) > 1 for row in rows)
    picture = cv2.imread(str(out / "soak.png"))
    assert picture is not None
    assert min(picture.shape[:2]) > 200


def test_a_run_under_load_answers_every_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load_run, "TASKS", 4)
    monkeypatch.setattr(load_run, "TASK_S", 8.0)
    monkeypatch.setattr(load_run, "EXPLORE_S", 4.0)
    monkeypatch.setenv("HELIOS_GATEWAY_CALL_TIMEOUT_S", "60")  # a service may wait for a core
    monkeypatch.setenv("HELIOS_GATEWAY_SILENT_AFTER_S", "120")
    load_run.run_load(1, tmp_path, lambda _: None)
    told = json.loads((tmp_path / "load.json").read_text())
    assert (told["without"]["ended"], told["loaded"]["ended"]) == (4, 4)
    assert told["loaded"]["clients"]["requests"] > 100
    assert told["loaded"]["clients"]["failures"] == {}
    assert told["ratios"].keys() >= {"objectmap/update", "map2d/occupancy", "bridge/act"}
    assert told["loaded"]["queues"][load_run.QUEUE] <= load_run.MOST_EVENTS


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("stop-distance", "--json", "{}"), "name a file in it"),
        (("chaos", "--json", "{}"), "name a file in it"),
        (("soak", "--load", "--hours", "1", "--out", "{}"), "omit --hours"),
    ],
)
def test_wrong_use_is_told_before_the_long_run(
    tmp_path: Path, args: tuple[str, ...], said: str
) -> None:
    done = subprocess.run(
        [*HELIOS, *(arg.format(tmp_path) for arg in args)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2
    assert said in done.stderr
