"""Tests playing one episode: the same result in any process, and no leftovers."""

from __future__ import annotations

import os
import tempfile
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_eval import provenance
from helios_eval.episodes.episode_player import PlayedEpisode, play, running_stack
from helios_eval.episodes.episode_record import EpisodeRecord, Semantics
from helios_eval.episodes.episode_spec import WALKER, EpisodeSpec, noise_of
from helios_eval.runs import ray_pool
from helios_eval.runs.process_pool import play_all
from helios_planner.service import PlannerService

NOISE = noise_of("demo-v1", 1.0, None)
TIMES = frozenset({"wall_s", "step_ms", "cpu_s", "stage_ms", "commit"})


def spec(agent: str = "helios", steps: int = 16) -> EpisodeSpec:
    return EpisodeSpec("ovmm", agent, "noisy", "demo-v1", 0, NOISE, {"max_steps": steps})


def facts(record: EpisodeRecord) -> dict:
    return record.model_dump(exclude=set(TIMES))


@pytest.fixture(scope="module")
def played_episode() -> PlayedEpisode:
    return play(spec(), "here")


def test_an_episode_is_the_same_in_any_process(played_episode: PlayedEpisode) -> None:
    """Also as the second episode of a process, and in parallel with another process."""
    again = [came for _, came in play_all([spec()] * 3, 2, provenance.commit())]
    assert len(again) == 3
    for came in again:
        assert isinstance(came, PlayedEpisode)
        assert facts(came.record) == facts(played_episode.record)
        assert came.snapshot is not None
        assert played_episode.snapshot is not None
        assert (came.snapshot.occupancy == played_episode.snapshot.occupancy).all()
        assert came.snapshot.beliefs == played_episode.snapshot.beliefs


def test_an_episode_is_the_same_with_color(
    played_episode: PlayedEpisode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EpisodeSpec, "colored", True)
    assert facts(play(spec(), "here").record) == facts(played_episode.record)


@pytest.mark.parametrize(
    ("agent", "semantics", "scorer", "colored"),
    [
        ("helios", "noisy", "simulated:itc-v1", False),
        ("trusting", "ground-truth", "lexical", False),
        (WALKER, "ground-truth", "lexical", False),
        ("helios", "detector", "lexical", True),
        ("helios", "noisy", "blip2:some/model", True),
        ("package:agent", "noisy", "lexical", True),
    ],
)
def test_color_is_rendered_where_something_may_read_it(
    agent: str, semantics: Semantics, scorer: str, colored: bool
) -> None:
    asked = EpisodeSpec("ovmm", agent, semantics, "demo-v1", 0, None, {"detector.scorer": scorer})
    assert asked.colored is colored


def test_the_record_describes_the_episode(played_episode: PlayedEpisode) -> None:
    record = played_episode.record
    assert (record.steps, record.success, record.state) == (16, False, "failed")
    assert record.cause == "object not found"
    assert record.noise == NOISE
    assert record.structure_hash
    assert record.step_ms > 0
    stages = {
        "world_act",
        "world_capture",
        "world_segmentation",
        "detector_detect",
        "objectmap_update",
        "map2d_occupancy",
        "map2d_value",
    }
    assert stages <= set(record.stage_ms)


def test_a_failed_episode_has_a_snapshot_for_the_report(played_episode: PlayedEpisode) -> None:
    kept = played_episode.snapshot
    assert kept is not None
    assert {-1, 0, 100} == set(kept.occupancy.ravel().tolist())
    assert len(kept.trajectory_m) == 1 + played_episode.record.steps
    assert kept.candidates
    assert kept.goals
    assert kept.camera_jpeg.startswith(b"\xff\xd8")


def test_an_episode_leaves_no_files_and_no_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = set(threading.enumerate())
    play(spec(steps=2), "here")
    assert not list(tmp_path.iterdir())
    assert not {t.name for t in set(threading.enumerate()) - before}


def test_a_stack_that_cannot_open_leaves_no_files_and_no_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = set(threading.enumerate())
    with pytest.raises(InvalidInput, match="no scorer table 'nope'"):
        play(replace(spec(), settings={"detector.scorer": "simulated:nope"}), "here")
    assert not list(tmp_path.iterdir())
    assert not {t.name for t in set(threading.enumerate()) - before}


def test_every_service_ends_although_one_cannot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before, close = set(threading.enumerate()), PlannerService.close

    def broken(service: PlannerService) -> None:
        close(service)
        raise OSError("the disk is full")

    monkeypatch.setattr(PlannerService, "close", broken)
    with pytest.raises(OSError, match="the disk is full"):
        play(spec(steps=2), "here")
    assert not list(tmp_path.iterdir())
    assert not {t.name for t in set(threading.enumerate()) - before}


def test_variables_of_a_robot_have_no_effect_on_a_stack_that_films(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HELIOS_DETECTOR_SCORER", "simulated:nope")
    threads = cv2.getNumThreads()
    with running_stack(spec(steps=1)):
        assert "HELIOS_DETECTOR_SCORER" not in os.environ
        assert cv2.getNumThreads() == 1
    assert os.environ["HELIOS_DETECTOR_SCORER"] == "simulated:nope"
    assert cv2.getNumThreads() == threads


def test_the_walker_solves_the_task_with_ground_truth() -> None:
    record = play(EpisodeSpec("ovmm", WALKER, "noisy", "demo-v1", 0, NOISE), "here").record
    assert record.success
    assert record.cause == ""
    assert record.picks == 1


def test_the_walker_keeps_its_step_limit() -> None:
    record = play(spec(WALKER, steps=5), "here").record
    assert (record.steps, record.success, record.state) == (5, False, "failed")
    assert record.message == "5 steps are used up"
    assert record.cause == "object not found"


def test_object_navigation_records_the_shortest_path() -> None:
    asked = EpisodeSpec("objectnav", "helios", "ground-truth", "demo-v1", 0, None, {"max_steps": 4})
    record = play(asked, "here").record
    assert record.instruction == f"Find the {record.object_class}"
    assert record.shortest_path_m is not None
    assert record.shortest_path_m >= 1.0
    assert record.spl == 0.0
    assert record.goal_receptacle_class == ""


def test_a_process_that_loads_other_code_than_the_run_began_with_plays_nothing() -> None:
    with pytest.raises(Unavailable, match="the run began with abc1234; give the command again"):
        list(play_all([spec()], 1, "abc1234"))


def test_a_machine_of_a_ray_cluster_with_other_code_plays_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ray_pool, "prepare", lambda: None)  # it changes this process
    with pytest.raises(Unavailable, match="the run began with abc1234; give the command again"):
        ray_pool._played(spec(), "abc1234")


def test_an_episode_refuses_a_noise_table_that_changed_after_the_start_of_the_run() -> None:
    changed = NOISE.model_copy(update={"digest": "0123456789abcdef"})
    with pytest.raises(Unavailable, match="demo-v1 has changed since the run began"):
        play(replace(spec(), noise=changed), "here")
