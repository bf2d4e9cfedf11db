"""The ground-truth detector, and frame noise that is the same from the same view."""

import hashlib
import math
from dataclasses import replace

import numpy as np
import pytest
from detector_scene import BOWL, MUG, ROOM, SceneTruth, context_of, looking
from helios_core.errors import InvalidInput
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector.simulation.frame_noise import (
    Draws,
    NoiseTable,
    hashed,
    hashed_voxels,
    load_noise,
)
from helios_detector.simulation.frame_noise_detector import FrameNoiseDetector
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
from helios_detector.simulator_truth import truth_of

_loaded = load_noise("demo-v1")
assert isinstance(_loaded, NoiseTable)
DEMO: NoiseTable = _loaded
NEVER = replace(DEMO.miss_by_pixels, at=(1.0,), value=(0.0,))
FAITHFUL = replace(DEMO, miss_by_pixels=NEVER, miss_by_distance=NEVER, confusion={}, redrawn=0.0)


def simulated(truth: SceneTruth, table: NoiseTable = DEMO, seed: int = 0) -> FrameNoiseDetector:
    return FrameNoiseDetector(truth, table, seed)


def names(detections) -> list[str]:
    return sorted(d.class_name for d in detections)


def test_ground_truth_gives_the_masks_of_the_asked_classes():
    truth = SceneTruth()
    frame = truth.frame()
    found = GroundTruthDetector(truth).detect(frame, context_of("cup", "table"))
    assert names(found.detections) == ["cup", "table"]
    by_name = {d.class_name: d for d in found.detections}
    np.testing.assert_array_equal(by_name["cup"].mask, truth.ids[frame.stamp_ns] == MUG.id)
    x0, y0, x1, y1 = by_name["cup"].box_xyxy
    assert by_name["cup"].mask[y0:y1, x0:x1].sum() == by_name["cup"].mask.sum()
    assert {s.class_name for s in found.seen} == {b.class_name for b in ROOM}


def test_two_mugs_are_two_detections():
    other = replace(MUG, id=8, low_m=(1.75, 0.35, 0.75), high_m=(1.83, 0.43, 0.85))
    truth = SceneTruth((*ROOM, other))
    found = GroundTruthDetector(truth).detect(truth.frame(), context_of("mug"))
    assert names(found.detections) == ["mug", "mug"]


def test_ground_truth_of_another_image_size_is_refused():
    truth = SceneTruth()
    frame = truth.frame()
    truth.ids[frame.stamp_ns] = truth.ids[frame.stamp_ns][:-1]
    with pytest.raises(InvalidInput, match="render both with one camera"):
        truth_of(frame, truth)


def test_noise_level_0_gives_the_true_masks_with_scores_below_1():
    truth = SceneTruth()
    frame = truth.frame()
    context = context_of("mug", "bowl")
    found = simulated(truth, DEMO.scaled(0)).detect(frame, context)
    exact = GroundTruthDetector(truth).detect(frame, context)
    assert names(found.detections) == names(exact.detections)
    for a, b in zip(found.detections, exact.detections, strict=True):
        np.testing.assert_array_equal(a.mask, b.mask)
        assert a.score == pytest.approx(DEMO.true_score[0])


def test_equal_seeds_give_equal_errors_and_different_seeds_do_not():
    truth = SceneTruth()
    frames = [truth.frame(looking(x), n) for n, x in enumerate(np.linspace(-2, 1, 30), 1)]
    table = DEMO.scaled(3)

    def run(seed: int) -> list:
        detector = simulated(truth, table, seed)
        found = [detector.detect(f, context_of("mug", "bowl")).detections for f in frames]
        return [[(d.class_name, d.score, d.box_xyxy) for d in ds] for ds in found]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_a_camera_at_rest_repeats_every_error_at_full_correlation():
    truth = SceneTruth()
    table = replace(DEMO.scaled(5, correlation=1.0), score_jitter=0.0)
    detector = simulated(truth, table)
    runs = [detector.detect(truth.frame(seq=n), context_of("mug", "bowl")) for n in range(1, 9)]
    first = [(d.class_name, d.score) for d in runs[0].detections]
    assert all([(d.class_name, d.score) for d in r.detections] == first for r in runs)


def test_misses_are_redrawn_in_each_frame_without_correlation():
    truth = SceneTruth()
    half = replace(DEMO.miss_by_pixels, at=(1.0,), value=(0.5,))
    table = replace(FAITHFUL, miss_by_pixels=half, redrawn=1.0)
    detector = simulated(truth, table)
    seen = [
        len(detector.detect(truth.frame(seq=n), context_of("mug")).detections) for n in range(1, 81)
    ]
    assert 20 < sum(seen) < 60


def test_errors_of_views_in_different_sectors_are_independent():
    draws = [Draws(f"0/t/7/{(s, 2, 3)}", 0, 0.0).uniform("miss") for s in range(12)]
    assert len(set(draws)) == 12


def test_views_within_one_sector_and_band_share_a_noise_cell_and_others_do_not():
    cell = DEMO.cell(math.radians(40), 2.2, 300)
    assert DEMO.cell(math.radians(50), 2.9, 480) == cell
    assert DEMO.cell(math.radians(61), 2.2, 300) != cell
    assert DEMO.cell(math.radians(40), 3.1, 300) != cell
    assert DEMO.cell(math.radians(40), 2.2, 600) != cell
    assert DEMO.cell(math.radians(-320), 2.2, 300) == cell


def test_a_confused_mug_is_reported_as_a_bowl_only_if_a_bowl_was_asked_for():
    truth = SceneTruth()
    table = replace(FAITHFUL, confusion={"mug": {"bowl": 1.0}})
    detector = simulated(truth, table)
    found = detector.detect(truth.frame(), context_of("mug")).detections
    assert found == ()
    found = detector.detect(truth.frame(), context_of("bowl", threshold=0.05)).detections
    assert names(found) == ["bowl", "bowl"]


def test_false_positives_lie_on_furniture_and_keep_their_place_in_the_world():
    truth = SceneTruth()
    table = replace(FAITHFUL, false_positive=1.0, false_min_px=20)
    detector = simulated(truth, table)
    centers = []
    for n, x in enumerate((0.50, 0.52, 0.54), 1):
        frame = truth.frame(looking(x), n)
        found = detector.detect(frame, context_of("teapot", threshold=0.05)).detections
        ids = truth.ids[frame.stamp_ns]
        on_table = [d for d in found if (ids[d.mask] == 1).all()]
        assert len(on_table) == 1
        v, u = np.argwhere(on_table[0].mask).mean(0)
        ray = np.array([(u - 160) / 300, (v - 120) / 300, 1.0])
        depth = np.median(frame.depth_m[on_table[0].mask])
        centers.append(frame.T_world_cam[:3, :3] @ ray * depth + frame.T_world_cam[:3, 3])
    assert np.ptp(centers, axis=0).max() < 0.1


def test_false_positives_occur_for_objects_and_not_for_receptacles():
    truth = SceneTruth()
    detector = simulated(truth, replace(FAITHFUL, false_positive=1.0, false_min_px=20))
    context = SearchContext("c", (SearchClass("desk", Role.GOAL_RECEPTACLE, 0.05),))
    assert detector.detect(truth.frame(), context).detections == ()


def test_no_false_positive_lies_on_a_wall_or_on_an_object():
    truth = SceneTruth((*ROOM[1:],))  # mug, bowl and wall
    detector = simulated(truth, replace(FAITHFUL, false_positive=1.0, false_min_px=1))
    found = detector.detect(truth.frame(), context_of("teapot", threshold=0.05)).detections
    assert found == ()


def test_masks_are_eroded_and_never_empty():
    truth = SceneTruth()
    frame = truth.frame()
    for erode_px in (1, 3, 50):
        table = replace(FAITHFUL, erode_px=erode_px)
        (found,) = simulated(truth, table).detect(frame, context_of("mug")).detections
        inside = truth.ids[frame.stamp_ns] == MUG.id
        assert found.mask.any()
        assert not (found.mask & ~inside).any()


def test_the_miss_rate_rises_with_distance_and_falls_with_size():
    assert DEMO.miss(100, 6.0) > DEMO.miss(100, 2.0) > DEMO.miss(3000, 2.0)


def test_demo_noise_detects_a_mug_in_at_least_85_of_100_views():
    """The mug fills 500 pixels; nine of ten views are expected to detect it."""
    truth = SceneTruth()
    hits = 0
    for n in range(1, 101):
        detector = simulated(truth, DEMO, seed=n)
        found = detector.detect(truth.frame(looking(0.7)), context_of("mug")).detections
        hits += any((d.mask & (truth.ids[10**8] == MUG.id)).any() for d in found)
    assert hits >= 85


def test_hashes_are_the_same_on_every_machine():
    assert hashed("mug/1") == pytest.approx(0.93082971, abs=1e-7)
    voxels = np.array([[0, 0, 0], [-1, 2, 3]], np.int64)
    assert hashed_voxels(voxels, "k").tolist() == hashed_voxels(voxels.copy(), "k").tolist()
    assert len(set(hashed_voxels(voxels, "k").tolist())) == 2


def test_draws_are_uniform():
    draws = [hashed(str(n)) for n in range(2000)]
    counts = np.histogram(draws, 10, (0, 1))[0]
    assert counts.min() > 140


@pytest.mark.parametrize(
    ("text", "said"),
    [("name = 1", "KeyError"), ("not toml", "TOMLDecodeError")],
)
def test_an_invalid_noise_table_is_refused_with_the_cause(tmp_path, text, said):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=said):
        load_noise(str(path))


def test_an_unknown_noise_table_or_level_is_refused():
    with pytest.raises(InvalidInput, match="demo-v1"):
        load_noise("nothing")
    with pytest.raises(InvalidInput, match="0 to 10"):
        DEMO.scaled(-1)
    with pytest.raises(InvalidInput, match="correlation"):
        DEMO.scaled(1, 2.0)


def test_ground_truth_does_not_detect_a_bowl_as_a_mug():
    truth = SceneTruth((BOWL,))
    assert GroundTruthDetector(truth).detect(truth.frame(), context_of("mug")).detections == ()


@pytest.mark.parametrize(
    ("level", "correlation", "expected"),
    [
        (1.0, None, "5df6d3bccae90397"),
        (3.0, None, "01358aa9a7ccf57d"),
        (1.0, 0.0, "f5d10d55e0cbabee"),
    ],
)
def test_the_published_noise_table_gives_the_frozen_errors(level, correlation, expected):
    """demo-v1 is published: its detections on a drive towards a table never change."""
    truth, digest = SceneTruth(), hashlib.sha256()
    detector = simulated(truth, DEMO.scaled(level, correlation), seed=3)
    context = context_of("mug", "bowl", "teapot", threshold=0.05)
    for n, x in enumerate(np.linspace(-2, 1, 24), 1):
        found = detector.detect(truth.frame(looking(float(x)), n), context)
        for d in found.detections:
            reported = f"{d.class_name} {d.score:.6f} {d.box_xyxy} {np.count_nonzero(d.mask)}"
            digest.update(reported.encode())
        for s in found.seen:
            digest.update(f"{s.class_name} {s.score:.6f}".encode())
    assert digest.hexdigest()[:16] == expected
