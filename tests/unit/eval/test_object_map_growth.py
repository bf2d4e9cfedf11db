"""Tests the study of object map growth in short runs: `helios_eval.studies.object_map_growth`."""

from __future__ import annotations

import json
import tracemalloc

import numpy as np
import pytest
from helios_core.atomic_file import write_file
from helios_core.codec import context_to_proto, observation_to_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, OBSERVATION
from helios_eval.studies import object_map_growth
from helios_eval.studies.map_growth import (
    full_scene_comparison,
    long_run,
    memory_by_episode,
    observation_log,
    update_cost,
)
from helios_eval.studies.map_growth.long_run import LongRunResult, Sample
from helios_eval.studies.map_growth.memory_by_episode import ALL, FEW, EpisodeGrowth, Request
from helios_eval.studies.map_growth.simulated_walk import Walk, context_of, record
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings

STRIDE_PX = 4
FRAMES = 20


@pytest.fixture(scope="module")
def walk() -> Walk:
    return record("demo-v1", 0, FRAMES, STRIDE_PX)


def test_a_strided_frame_gives_the_same_map_as_the_whole_frame():
    whole, strided = (record("demo-v1", 0, 5, stride) for stride in (1, STRIDE_PX))
    maps = []
    for walk, stride in ((whole, STRIDE_PX), (strided, 1)):
        seen = ObjectMap(ObjectMapSettings(stride_px=stride))
        context = context_of("walk", walk.receptacles, walk.things)
        for observation in walk.again(0.0, 0, context.id):
            seen.update(observation, context)
        maps.append(seen.gaussians())
    assert len(maps[0].means)
    assert np.array_equal(maps[0].means, maps[1].means)
    assert np.array_equal(maps[0].concentration, maps[1].concentration)


def test_the_gaussians_in_view_of_an_update_do_not_grow_with_the_map(walk):
    run = update_cost.measure([walk], 3 * FRAMES, say=lambda _: None)
    assert run.in_view.shape == (3, FRAMES)
    assert run.mapped[2, -1] > 2.9 * run.mapped[0, -1]
    assert np.abs(run.in_view[2] - run.in_view[0]).max() <= 0.02 * run.in_view[0].max()


def test_an_objects_only_map_is_much_smaller_than_a_full_scene_map():
    maps = full_scene_comparison.measure(observation_log.play("demo-v1", 0, 45, STRIDE_PX))
    objects, everything = maps["objects only"], maps["full scene"]
    assert 0 < objects.gaussians[-1] < 0.5 * everything.gaussians[-1]
    assert objects.mb[-1] < 0.5 * everything.mb[-1]


def test_a_long_run_stays_within_the_gaussian_limit(walk):
    most = 1500
    lived = long_run.measure([walk], 5 * FRAMES, 2.0, most, say=lambda _: None)
    assert lived.samples[-1].frame == 5 * FRAMES
    assert all(s.gaussians <= most for s in lived.samples)
    assert max(s.gaussians for s in lived.samples) > 0.9 * most  # the limit was reached
    assert lived.growth() < 0.5


def test_a_full_map_keeps_no_memory_of_its_frames(walk):
    """Measures the memory of Python and numpy; a kept frame would be 0.1 MB."""
    hub = MemoryHub()
    settings = ObjectMapSettings(stride_px=1, max_gaussians=1500)
    ObjectMapService(MemoryBus(hub), settings, Health())
    bus = MemoryBus(hub)

    def laps(first: int, last: int) -> None:
        for lap in range(first, last):
            context = context_of(f"task {lap}", walk.receptacles[:4], walk.things[:4])
            bus.publish(CONTEXT, context_to_proto(context))
            for o in walk.again(lap * update_cost.SPACING_M, lap * FRAMES, context.id):
                bus.publish(OBSERVATION, observation_to_proto(o))

    laps(0, 2)  # compiles all kernels
    tracemalloc.start()
    laps(2, 5)
    early = tracemalloc.get_traced_memory()[0]
    laps(5, 8)
    late = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert late - early < 1e6, f"{(late - early) / 1e6:.1f} MB more after {3 * FRAMES} frames"


@pytest.mark.parametrize(("slope_mb", "steady"), [(0.0, True), (2.0, False)])
def test_memory_that_grows_to_the_end_is_not_steady(slope_mb, steady):
    samples = tuple(Sample(100 * k, 300 + slope_mb * k, 1000, 10) for k in range(1, 81))
    run = LongRunResult(2.0, samples)
    assert run.is_steady == steady
    assert run.summary()["robot_hours"] == pytest.approx(8000 * 2 / 3600, abs=0.01)


def test_the_command_writes_figures_and_a_plot(tmp_path):
    status = object_map_growth.main(
        ["--out", str(tmp_path), "--only", "cost", "--preset", "demo-v1", "--seeds", "0",
         "--walk", "4", "--frames", "8"]
    )  # fmt: skip
    assert status == 0
    assert (tmp_path / "cost.png").stat().st_size > 1000
    found = json.loads((tmp_path / "growth.json").read_text())
    assert found["cost"]["frames"] == 8


# --- memory over episodes -------------------------------------------------------------------------
def grown(seed: int, few: tuple[float, ...], every: tuple[float, ...], steps=(1, 3)):
    return EpisodeGrowth(
        preset="demo-v1",
        seed=seed,
        max_steps=4,
        stride_px=2,
        agent="helios-paper",
        noise=None,
        commit="abc",
        steps=steps,
        gaussians={FEW: (1,) * len(few), ALL: (2,) * len(every)},
        mb={FEW: few, ALL: every},
    )


REQUEST = Request("demo-v1", 500, 8, 4, 2)


def test_memory_by_step_is_that_of_the_newest_keyframe():
    mb = memory_by_episode.by_step([grown(500, (1.0, 0.5), (4.0, 6.0))], FEW, 4)
    assert mb.tolist() == [[0.0, 1.0, 1.0, 0.5, 0.5]]


def test_the_memory_table_has_the_highest_mean_the_maximum_and_the_papers_figures():
    records = [grown(500 + k, (1.0, 1.0 + k), (8.0, 10.0 + 2 * k)) for k in range(8)]
    mb = {name: memory_by_episode.by_step(records, name, 4) for name in (FEW, ALL)}
    few = memory_by_episode.Memory.of(mb[FEW])
    assert few.maximum == 8
    assert few.highest_mean == pytest.approx(np.arange(1, 9).mean())
    found = memory_by_episode.ratio(mb)
    assert found.value == pytest.approx(17 / 4.5)
    assert found.low < found.value < found.high
    rows = memory_by_episode.table(mb).splitlines()
    assert "8.0 | 24.0 | 3.0 " in rows[-1]
    assert "4.1 against 8.9" in rows[2]
    assert "4.6 against 24.3" in rows[3]
    assert "7.1 against 43.0" in rows[4]


def test_the_highest_mean_is_that_of_a_step_not_the_mean_of_the_maxima():
    """The map of one episode shrinks when that of the other has grown."""
    records = [grown(500, (9.0, 1.0), (9.0, 1.0)), grown(501, (1.0, 5.0), (1.0, 5.0))]
    mb = memory_by_episode.by_step(records, FEW, 4)
    assert memory_by_episode.Memory.of(mb).highest_mean == 5.0  # (9 + 1) / 2, not (9 + 5) / 2


def test_a_continued_memory_run_plays_only_the_missing_episodes(tmp_path, monkeypatch):
    played: list[int] = []

    def play(_: Request, seed: int, __: str) -> EpisodeGrowth:
        played.append(seed)
        if seed == 503 and played.count(503) == 1:
            raise InvalidInput("the machine went down")
        return grown(seed, (1.0, 2.0), (4.0, 6.0))

    monkeypatch.setattr(memory_by_episode, "_played", play)
    with pytest.raises(InvalidInput, match="went down"):
        memory_by_episode.play(tmp_path, REQUEST, say=lambda _: None)
    path = tmp_path / memory_by_episode.EPISODES
    assert json.loads((tmp_path / memory_by_episode.SUMMARY).read_text())["episodes"] == 3
    write_file(path, path.read_text()[:-30])  # the last line is torn
    memory_by_episode.play(tmp_path, REQUEST, say=lambda _: None)
    assert played == [500, 501, 502, 503, 502, 503, 504, 505, 506, 507]
    assert [r.seed for r in memory_by_episode.read(tmp_path, REQUEST)] == list(range(500, 508))
    assert (tmp_path / memory_by_episode.CHART).stat().st_size > 1000
    other = Request("demo-v1", 500, 8, 5, 2)
    assert memory_by_episode.read(tmp_path, other) == []


def test_a_file_of_other_episodes_is_refused(tmp_path):
    write_file(tmp_path / memory_by_episode.EPISODES, '{"benchmark": "ovmm"}\n')
    with pytest.raises(InvalidInput, match="take another folder"):
        memory_by_episode.read(tmp_path, REQUEST)


def test_the_command_measures_memory_over_episodes(tmp_path):
    status = object_map_growth.main(
        ["--out", str(tmp_path), "--only", "episodes", "--preset", "demo-v1", "--seed0", "0",
         "--homes", "1", "--max-steps", "15", "--stride", "4"]
    )  # fmt: skip
    assert status == 0
    found = json.loads((tmp_path / "growth.json").read_text())["episodes"]
    assert (found["episodes"], found["seeds"]) == (1, [0])
    assert 0 <= found["mb"][FEW]["maximum"] < found["mb"][ALL]["maximum"]
