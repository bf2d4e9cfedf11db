"""Figures of a run: percentiles, slopes, growth, and the limits that decide whether it passed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helios_chaos.chaos_result import ChaosResult, PlayedFault
from helios_chaos.figures import percentiles
from helios_chaos.load_run import QUEUE, TASKS, LoadResult, Run
from helios_chaos.resources import Sample, as_csv, growth, slope_per_h
from helios_chaos.soak_run import SoakResult, growths
from helios_chaos.tasks import PlayedTask
from helios_chaos.witness import length_m
from hypothesis import given
from hypothesis import strategies as st

FINE_QUEUES = {QUEUE: 2000.0}
FINE = PlayedTask("a", "go home", "succeeded", "")
STUCK = PlayedTask("c", "Move the mug from the desk to the bed", "failed", "holds a can")


def fault(again_s: float | None = 1.0, still_s: float | None = None) -> PlayedFault:
    return PlayedFault(1.0, "kill", "planner", 0.0, 0.0, again_s, still_s)


def result(*faults: PlayedFault, tasks: tuple[PlayedTask, ...] = (FINE,)) -> ChaosResult:
    return ChaosResult(1.0, 0, list(tasks), list(faults), [1.0], [])


@given(st.lists(st.floats(0, 100), min_size=1))
def test_percentiles_are_measured_values_in_order(values: list[float]) -> None:
    found = percentiles(values, 50, 95)
    assert None not in found.values()
    ordered = [value for value in found.values() if value is not None]
    assert ordered == sorted(ordered)
    assert ordered[-1] == round(max(values), 3)
    assert found["p50"] in {round(v, 3) for v in values}


def test_no_values_have_no_percentiles() -> None:
    assert percentiles([], 50) == {"p50": None, "max": None}


@given(st.floats(-50, 50), st.floats(0, 1000))
def test_the_slope_of_a_line_is_its_slope(slope: float, start: float) -> None:
    at_s = list(range(0, 7200, 60))
    assert slope_per_h(at_s, [start + slope * t / 3600 for t in at_s]) == pytest.approx(
        slope, abs=1e-6
    )


def test_a_jump_at_the_end_is_growth_and_noise_is_none() -> None:
    assert growth([10, 11, 10, 11] * 8) == 0
    assert growth([10] * 30 + [14] * 10) == 4
    assert growth([]) == 0


def test_the_length_of_a_path_adds_its_parts() -> None:
    assert length_m(np.array([[0, 0, 0], [1, 3, 4], [2, 3, 5]])) == pytest.approx(6.0)
    assert length_m(np.empty((0, 3))) == 0


def test_a_run_within_the_limits_passes() -> None:
    assert result(fault(), fault(4.9, 0.9)).misses() == []


@pytest.mark.parametrize(
    ("run", "miss"),
    [
        (result(fault(), fault(5.1)), "p95 of acting again is 5.1 s"),
        (result(fault(), fault(None)), "did not act again after 1 faults"),
        (result(fault(still_s=1.2)), "stood after 1.2 s"),
        (result(tasks=(PlayedTask("b", "", "running", ""),)), "task b is lost: running"),
        (result(tasks=(PlayedTask("b", "", "succeeded", "", "no mug moved"),)), "no mug moved"),
        (result(tasks=(STUCK,) * 5), "none of 5 tasks to move a thing succeeded"),
    ],
)
def test_each_limit_is_checked(run: ChaosResult, miss: str) -> None:
    [said] = run.misses()
    assert miss in said


def test_what_could_not_be_judged_and_what_was_driving_are_counted() -> None:
    unjudged = PlayedTask("d", "Put the mug on the bed", "failed", "not known", unjudged=True)
    moved = PlayedTask("e", "Put the mug on the bed", "succeeded", "")
    drove = PlayedFault(1.0, "kill", "planner", 0.0, 0.0, 1.0, 0.6, driving=True)
    figures = result(fault(), drove, tasks=(FINE, STUCK, unjudged, moved)).as_json()
    assert (figures["unjudged"], figures["lost"]) == (1, 0)
    assert (figures["moves"], figures["moves_succeeded"]) == (3, 1)
    assert figures["hit_while_driving"] == 1
    assert figures["commit"]
    assert figures["machine"]


def test_a_failed_task_is_not_lost() -> None:
    assert not PlayedTask("a", "", "failed", "the cup is nowhere").lost


def sample(at_s: float, rss_mb: float, handles: int = 20, pid: int = 1) -> Sample:
    return Sample(at_s, "planner", pid, rss_mb, handles, 9, 1.0, 2.0, 5.0)


def soak(samples: list[Sample]) -> list[str]:
    return SoakResult(1.0, growths(samples), 5.0, [FINE]).misses()


def test_the_warm_up_of_a_soak_is_left_out() -> None:
    times = range(0, 7200, 10)
    warming = [sample(t, 100 + 50 * (1 - math.exp(-t / 120))) for t in times]
    assert soak(warming) == []


@pytest.mark.parametrize(
    ("samples", "miss"),
    [
        ([sample(t, 100 + 2 * t / 3600) for t in range(0, 7200, 10)], "2.00 MB of memory"),
        ([sample(t, 100, 20 + t // 600) for t in range(0, 7200, 10)], "open handles"),
        ([sample(t, 100, pid=1 + t // 6000) for t in range(0, 7200, 10)], "started 2 times"),
    ],
)
def test_a_soak_misses_a_limit(samples: list[Sample], miss: str) -> None:
    [said] = soak(samples)
    assert miss in said


def test_only_samples_at_rest_count_for_the_growth() -> None:
    busy = [
        replace(sample(t, 100 + 50 * (t > 3600), 20 + 9 * (t > 3600)), at_rest=t <= 3600)
        for t in range(0, 7200, 10)
    ]
    assert soak(busy) == []
    assert soak([replace(s, at_rest=True) for s in busy]) != []


def test_samples_become_lines_of_csv() -> None:
    head, line = as_csv([sample(10.0, 100.5)]).splitlines()
    assert head.startswith("at_s,service,pid,rss_mb")
    assert line.startswith("10.0,planner,1,100.5")


def test_a_step_that_slows_by_more_than_a_tenth_is_named() -> None:
    base = Run(TASKS, TASKS, 10.0, {"map2d/fuse": 10.0, "bridge/act": 100.0, "tiny/x": 0.01})
    steps = {"map2d/fuse": 11.5, "bridge/act": 109.0, "tiny/x": 1.0}
    load = Run(TASKS, TASKS, 12.0, steps, FINE_QUEUES)
    [said] = LoadResult(base, load).misses()
    assert "map2d/fuse takes 1.15 times" in said


def test_clients_that_could_not_send_their_requests_are_told() -> None:
    run = Run(TASKS, TASKS, 10.0)
    clients = {"requests": 100, "late": 90, "requests_per_s": 105.0}
    slow = Run(TASKS, TASKS, 10.0, queues=FINE_QUEUES, clients=clients)
    [said] = LoadResult(run, slow).misses()
    assert "only 105 requests a second of 200" in said


def test_a_queue_beyond_its_bound_is_told() -> None:
    queues = {QUEUE: 2001.0}
    [said] = LoadResult(Run(TASKS, TASKS, 1.0), Run(TASKS, TASKS, 1.0, queues=queues)).misses()
    assert "2001 events waited for one reader" in said
