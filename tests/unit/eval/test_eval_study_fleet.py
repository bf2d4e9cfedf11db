"""The calculation of the study of a fleet."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from helios_core.errors import Unavailable
from helios_eval.studies.fleet import Cost, Reading, cost, limits, main, report


def reading(at_s: float, busy_s: float, steps: int) -> Reading:
    """Two robots of which each service and world has used so many seconds."""
    rows = ("router", "gateway", "supervisor", "a/world", "a/planner", "b/world", "b/planner")
    pss = {row: 100.0 if "/" in row else 40.0 for row in rows}
    return Reading(at_s, dict.fromkeys(rows, busy_s), pss, steps)


def test_costs_are_per_step_and_robot_and_limits_follow_from_them() -> None:
    rest = reading(0, 0, 0), reading(10, 1, 0)
    work = reading(10, 1, 0), reading(30, 5, 20)
    found = cost(2, 12.5, rest, work, 50.0)
    assert found.steps_per_s == pytest.approx(0.5)
    assert found.services_ms_per_step == found.world_ms_per_step == pytest.approx(400)
    assert found.gateway_ms_per_step == pytest.approx(200)
    assert found.idle_services_cores == pytest.approx(0.1)
    assert found.idle_shared_cores == pytest.approx(0.3)
    assert (found.services_pss_mb, found.shared_pss_mb) == (100, 120)
    ends = limits(found, found, steps_per_s=0.5, cores=4, memory_mb=1120)
    assert ends["processor"] == pytest.approx(4 / 0.4)
    assert ends["processor, simulated"] == pytest.approx(4 / 0.6)
    assert ends["memory"] == pytest.approx(10)
    assert ends["memory, simulated"] == pytest.approx(5)
    assert ends["gateway"] == pytest.approx(10)
    assert ends["network of 1 Gbit/s"] == pytest.approx(110_000 / (3 * 50 * 0.5))
    assert "| gateway |" in report([found])


def test_the_memory_that_each_robot_takes_in_the_shared_processes_counts() -> None:
    large = Cost(10, *[1.0] * 10, services_pss_mb=100, world_pss_mb=50, shared_pss_mb=1100)
    small = replace(large, robots=2, shared_pss_mb=300)  # 100 MB for each robot, 100 MB for all
    ends = limits(large, small, steps_per_s=1.0, cores=2, memory_mb=2100)
    assert ends["memory"] == pytest.approx(10)
    assert ends["memory, simulated"] == pytest.approx(8)


def test_the_committed_fleet_has_the_limits_that_the_page_names(
    capsys: pytest.CaptureFixture[str],
) -> None:
    docs = Path(__file__).parents[3] / "docs"
    assert main(["--report", str(docs / "results/robustness/fleet.json")]) == 0
    printed = capsys.readouterr().out
    page = (docs / "how-to/fleets.md").read_text()
    said = {
        "network of 1 Gbit/s": "a network of 1 Gbit/s, if every frame crosses",
        "processor, simulated": "the processor's time, with the simulated worlds",
        "processor": "the processor's time, without them",
        "memory, simulated": "memory, with the simulated worlds",
        "memory": "memory, without them",
        "gateway": "the gateway, one process",
        "router on all cores": "the router, on both cores",
    }
    for row, words in said.items():
        (ends,) = re.findall(rf"^\| {re.escape(row)} \| ([\d.]+) \|$", printed, re.MULTILINE)
        (written,) = re.findall(rf"^\| {words}.* \| ([\d.]+) \|$", page, re.MULTILINE)
        assert float(written) == pytest.approx(float(ends), rel=0.02)


def test_a_fleet_that_made_no_step_has_no_cost() -> None:
    still = reading(0, 0, 7), reading(10, 1, 7)
    with pytest.raises(Unavailable, match="made no step"):
        cost(2, 1.0, still, still, 50.0)
