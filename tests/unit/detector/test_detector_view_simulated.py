"""The detector with view noise (errors by object, side and view) in a small room."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from detector_scene import (
    BOWL,
    CAMERA,
    MUG,
    ROOM,
    TABLE,
    WALL,
    Box,
    SceneTruth,
    context_of,
    looking,
)
from helios_core.geometry import se2_to_se3
from helios_core.name_rules import plain
from helios_core.types import Detection, Frame, Role, SearchClass, SearchContext
from helios_detector.backend import DetectorOptions, Findings, Seen
from helios_detector.lexical_scorer import PRIOR, LexicalScorer
from helios_detector.model_loading import open_detector, open_scorer
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector, visible
from helios_detector.simulation.mask_errors import eroded, leaked, partial
from helios_detector.simulation.view_noise_detector import ViewNoiseDetector
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from helios_detector.simulator_truth import Truth, TruthInstance
from helios_sim.home.catalogs import CATALOGS

_loaded = load_noise("ovmm-v1")
assert isinstance(_loaded, ViewNoiseTable)
NOISE: ViewNoiseTable = _loaded
_loaded = load_noise("ovmm-v1-smooth")
assert isinstance(_loaded, ViewNoiseTable)
BOTH_NOISES = pytest.mark.parametrize("noise", [NOISE, _loaded], ids=lambda n: n.name)
CONTEXT = context_of("mug", "bowl", "teapot", threshold=0.05)


@dataclass
class NamedTruth(SceneTruth):
    """Ground truth with instance names, and with body ids raised by `shift`."""

    shift: int = 0

    def segmentation(self, stamp_ns: int) -> Truth:
        truth = super().segmentation(stamp_ns)
        moved = {
            k + self.shift: replace(i, id=k + self.shift, name=f"{i.class_name} {k}")
            for k, i in truth.instances.items()
        }
        ids = np.where(truth.ids > 0, truth.ids + self.shift, 0).astype(np.uint16)
        return Truth(ids, moved, truth.T_world_cam)


def scaled(table: ViewNoiseTable = NOISE, **scale: float) -> ViewNoiseTable:
    whole = {"confuse": 0.0, "second": 0.0, "miss": 0.0, "false": 0.0} | scale
    file = table.file.model_copy(update={"scale": table.file.scale.model_copy(update=whole)})
    return replace(table, file=file)


def only_false_positives(
    on_structure: float, on_furniture: float, noise: ViewNoiseTable = NOISE
) -> ViewNoiseTable:
    """A table whose only errors are false positives, at these rates."""
    table = scaled(noise, false=1.0).scaled(1, 1.0)
    false = table.file.false_positive.model_copy(
        update={"on_structure": on_structure, "on_furniture": on_furniture, "min_px": 20}
    )
    return replace(table, file=table.file.model_copy(update={"false_positive": false}))


def reported(found: Findings) -> list[tuple]:
    return [(d.class_name, round(d.score, 9), d.box_xyxy, d.mask.sum()) for d in found.detections]


def middle_m(d: Detection, frame: Frame) -> np.ndarray:
    """The world position of the middle of a detection."""
    v, u = np.argwhere(d.mask).mean(0)
    ray = np.array([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0])
    p_cam = ray * np.median(frame.depth_m[d.mask])
    return frame.T_world_cam[:3, :3] @ p_cam + frame.T_world_cam[:3, 3]


def test_the_vocabulary_covers_every_class_of_the_homes():
    ovmm = CATALOGS["ovmm"]
    things = {plain(n) for n in (*ovmm.objects, *ovmm.receptacles, *ovmm.fixtures)}
    assert things <= set(ViewNoiseDetector(NamedTruth(), NOISE).vocabulary())


@BOTH_NOISES
def test_level_0_gives_exactly_the_ground_truth(noise):
    truth = NamedTruth()
    for n, x in enumerate(np.linspace(-2, 1, 12), 1):
        frame = truth.frame(looking(float(x)), n)
        got = ViewNoiseDetector(truth, noise.scaled(0), seed=n).detect(frame, CONTEXT)
        exact = GroundTruthDetector(truth).detect(frame, CONTEXT)
        assert reported(got) == reported(exact)
        assert got.seen == exact.seen
        for a, b in zip(got.detections, exact.detections, strict=True):
            np.testing.assert_array_equal(a.mask, b.mask)


@BOTH_NOISES
def test_equal_seeds_give_equal_errors_and_different_seeds_do_not(noise):
    truth = NamedTruth()
    frames = [truth.frame(looking(float(x)), n) for n, x in enumerate(np.linspace(-2, 1, 30), 1)]
    runs = [
        [reported(ViewNoiseDetector(truth, noise, s).detect(f, CONTEXT)) for f in frames]
        for s in (1, 1, 2)
    ]
    assert runs[0] == runs[1] != runs[2]


def test_body_ids_do_not_change_the_detections():
    for n in range(1, 6):
        here, there = NamedTruth(), NamedTruth(shift=37)
        frame = here.frame(looking(0.1 * n), n)
        there.frame(looking(0.1 * n), n)
        found = [ViewNoiseDetector(t, NOISE, n).detect(frame, CONTEXT) for t in (here, there)]
        assert reported(found[0]) == reported(found[1])


@pytest.mark.parametrize("name", ["demo-v1", "ovmm-v1", "ovmm-v1-smooth"])
def test_a_robot_whose_poses_have_another_origin_meets_the_same_errors(name):
    """Errors depend on the true place of the camera, not on where the robot thinks that it is."""
    truth, T = NamedTruth(), se2_to_se3(-7.0, 5.0, 1.5)
    options = DetectorOptions(truth=truth, noise=name, noise_seed=3)
    detector, scorer = open_detector("simulated", options), open_scorer("simulated:itc-v1", options)
    prompts = {"object": "Seems like there is a mug ahead."}
    for n, x in enumerate(np.linspace(-2, 1, 20), 1):
        frame = truth.frame(looking(float(x)), n)
        lost = replace(frame, T_world_cam=T @ frame.T_world_cam)
        here, there = (detector.detect(f, CONTEXT) for f in (frame, lost))
        assert reported(here) == reported(there)
        assert scorer.score(frame, here.seen, prompts) == scorer.score(lost, there.seen, prompts)


def test_another_process_gives_the_same_detections():
    """The other process has another hash salt (PYTHONHASHSEED)."""
    here = Path(__file__).parent
    code = (
        f"import sys; sys.path.insert(0, {str(here)!r})\n"
        "import test_detector_view_simulated as t; print(t.fingerprint())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "77"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True
    )
    assert done.stdout.strip() == fingerprint()


def fingerprint() -> str:
    truth = NamedTruth()
    table = NOISE.scaled(2.0)
    frames = [truth.frame(looking(float(x)), n) for n, x in enumerate(np.linspace(-2, 1, 8), 1)]
    return str([reported(ViewNoiseDetector(truth, table, 5).detect(f, CONTEXT)) for f in frames])


def test_an_object_turned_in_the_hand_shows_the_sides_that_a_walk_around_it_shows() -> None:
    eye_m, center_m = np.array([0.0, 0.0, 1.3]), np.array([0.5, 0.1, 1.1])
    still = TruthInstance(2, "mug", center_m, True, "mug_1")
    for turn_rad in (0.3, 2.0, -1.0):
        turned = replace(still, turn_rad=turn_rad)
        seen_m = eye_m - turned.center_seen_from(eye_m)
        assert np.linalg.norm(seen_m) == pytest.approx(np.linalg.norm(eye_m - center_m))
        turned_rad = np.arctan2(*(eye_m - center_m)[1::-1]) - np.arctan2(*seen_m[1::-1])
        assert np.exp(1j * turned_rad) == pytest.approx(np.exp(1j * turn_rad))
    assert np.array_equal(still.center_seen_from(eye_m), center_m)


def test_an_additional_object_does_not_change_the_errors_of_the_others():
    guest = Box(9, "candle", (1.75, 0.35, 0.75), (1.83, 0.43, 0.85), True)
    alone, together = NamedTruth(), NamedTruth((*ROOM, guest))
    table = scaled(confuse=1.5, miss=1.0)
    for n in range(1, 25):
        frames = [t.frame(looking(0.4), n) for t in (alone, together)]
        found = []
        for truth, frame in zip((alone, together), frames, strict=True):
            detector = ViewNoiseDetector(truth, table, n)
            verdicts = detector.verdicts(frame, truth.segmentation(frame.stamp_ns), ())
            named = {v.thing.instance.name: v.names for v in verdicts}
            found.append({k: v for k, v in named.items() if k in ("mug 2", "bowl 3")})
        assert found[0] == found[1]


@BOTH_NOISES
def test_false_positives_keep_their_place_while_the_camera_moves(noise):
    truth = NamedTruth((TABLE,))
    table = only_false_positives(0.0, 0.12, noise)
    places: dict[int, list[np.ndarray]] = {}
    for seed in range(30):
        for n, x in enumerate((0.45, 0.50, 0.55), 1):
            frame = truth.frame(looking(x), n)
            found = ViewNoiseDetector(truth, table, seed).detect(frame, context_of("teapot"))
            if len(found.detections) == 1:
                places.setdefault(seed, []).append(middle_m(found.detections[0], frame))
    lasting = [np.array(p) for p in places.values() if len(p) == 3]
    assert len(lasting) >= 3
    assert max(np.ptp(p, axis=0).max() for p in lasting) < 0.1


@pytest.mark.parametrize(("structure", "furniture", "host"), [(1.0, 0.0, WALL), (0.0, 1.0, TABLE)])
def test_false_positives_lie_on_walls_and_on_furniture(structure, furniture, host):
    truth = NamedTruth()
    frame = truth.frame(looking(0.2))
    found = ViewNoiseDetector(truth, only_false_positives(structure, furniture)).detect(
        frame, context_of("teapot")
    )
    ids = truth.ids[frame.stamp_ns]
    assert found.detections
    assert all((ids[d.mask] == host.id).all() for d in found.detections)
    assert "teapot" in {s.class_name for s in found.seen}


def test_no_false_positive_lies_on_an_object_of_its_class_or_on_a_graspable_object():
    truth = NamedTruth()
    frame = truth.frame(looking(0.2))
    detector = ViewNoiseDetector(truth, only_false_positives(0.0, 1.0))
    role = SearchContext("c", (SearchClass("table", Role.GOAL_RECEPTACLE, 0.05),))
    assert {d.score for d in detector.detect(frame, role).detections} != set()
    assert len(detector.detect(frame, role).detections) == 1  # the table itself
    things = NamedTruth((MUG, BOWL))
    frame = things.frame(looking(0.2))
    haunts = ViewNoiseDetector(things, only_false_positives(1.0, 1.0)).detect(
        frame, context_of("teapot")
    )
    assert haunts.detections == ()


@BOTH_NOISES
def test_the_rate_of_false_positives_is_that_of_the_table(noise):
    truth = NamedTruth((WALL,))
    frame = truth.frame(looking(1.5))
    per_cell = 0.05
    context = context_of("ball", threshold=0.0)

    def count(rate: float, seed: int) -> int:
        return len(
            ViewNoiseDetector(truth, only_false_positives(rate, 0.0, noise), seed)
            .detect(frame, context)
            .detections
        )

    sure = np.mean([count(1.0, seed) for seed in range(40)])
    counts = [count(per_cell, seed) for seed in range(150)]
    expected = per_cell * sure * len(counts)
    assert sure >= 8
    assert abs(sum(counts) - expected) < 4.5 * np.sqrt(expected)


def test_an_object_may_be_reported_under_two_names_with_one_mask():
    truth = NamedTruth()
    frame = truth.frame(looking(0.7))
    context = context_of("mug", *NOISE.rows["mug"].names, threshold=0.0)
    doubled = 0
    for seed in range(80):
        table = scaled(second=0.5).scaled(1, 1.0)
        found = ViewNoiseDetector(truth, table, seed).detect(frame, context)
        own = [d for d in found.detections if (truth.ids[frame.stamp_ns][d.mask] == MUG.id).any()]
        if len(own) == 2:
            doubled += 1
            assert own[0].class_name != own[1].class_name
            np.testing.assert_array_equal(own[0].mask, own[1].mask)
    assert 1 <= doubled <= 24


def test_partial_masks_keep_about_the_requested_share():
    crop = np.ones((40, 60), bool)
    for side in range(4):
        box, kept = partial((10, 20, 70, 60), crop, 0.5, side)
        assert 0.4 < kept.sum() / crop.sum() < 0.6
        assert (box[2] - box[0], box[3] - box[1]) == kept.shape[::-1]
    one = np.ones((1, 1), bool)
    assert all(partial((0, 0, 1, 1), one, 0.4, side)[1].any() for side in range(4))


def test_leaking_masks_extend_only_onto_near_support_below_the_object():
    depth_m = np.full((100, 100), 2.0, np.float32)
    depth_m[:, 60:] = 3.0  # far behind
    support = np.ones((100, 100), bool)
    support[50:60, 40:45] = False  # another object below
    crop = np.ones((10, 20), bool)
    box, mask = leaked(
        (40, 40, 60, 50), crop, 6, lambda b: support[b[1] : b[3], b[0] : b[2]], depth_m, 0.3
    )
    whole = np.zeros((100, 100), bool)
    whole[box[1] : box[3], box[0] : box[2]] = mask
    assert whole[40:50, 40:60].all()
    extra = whole.copy()
    extra[40:50, 40:60] = False
    assert extra[50:56, 50].all()
    assert not extra[50:60, 40:45].any()
    assert not extra[:, 60:].any()
    assert not extra[:40].any()
    assert not extra[56:].any()


def test_partial_and_leaking_masks_occur_at_the_stated_rates():
    truth = NamedTruth()
    frame = truth.frame(looking(0.9))
    inside = truth.ids[frame.stamp_ns] == MUG.id
    (mug,) = (t for t in visible(truth.segmentation(frame.stamp_ns)) if t.instance.id == MUG.id)
    whole = eroded(mug.box_xyxy, mug.crop, NOISE.file.mask.erode_px)[1].sum()
    kinds = {"partial": 0, "leak": 0, "whole": 0}
    table, context = scaled().scaled(1, 1.0), context_of("mug", threshold=0.0)
    for seed in range(300):
        (d,) = ViewNoiseDetector(truth, table, seed).detect(frame, context).detections
        outside = (d.mask & ~inside).any()
        smaller = (d.mask & inside).sum() < whole
        kinds["leak" if outside else "partial" if smaller else "whole"] += 1
    for kind, share in (("partial", NOISE.file.mask.partial), ("leak", NOISE.file.mask.leak)):
        assert abs(kinds[kind] - 300 * share) < 4.5 * np.sqrt(300 * share), kinds


def test_the_scorer_uses_the_reported_names_and_tolerates_unknown_names():
    truth = NamedTruth()
    scorer = LexicalScorer()
    prompts = {"near": "a mug ahead", "far": "a toilet ahead"}
    values = {"near": [], "far": []}
    for seed in range(60):
        frame = truth.frame(looking(0.5), seed + 1)
        found = ViewNoiseDetector(truth, NOISE, seed).detect(frame, context_of("mug"))
        for layer, value in scorer.score(frame, found.seen, prompts).items():
            assert 0 <= value <= 1
            values[layer].append(value)
    assert np.mean(values["near"]) > np.mean(values["far"]) + 0.1
    frame = truth.frame()
    odd = [Seen("flurbwozzle", 0.9), Seen("", 0.1)]
    assert scorer.score(frame, odd, {"a": "a mug", "b": "a flurb"}) == {"a": PRIOR, "b": PRIOR}


def test_unknown_classes_in_the_truth_are_reported_as_they_are():
    truth = NamedTruth((Box(3, "flurb", (1.0, -0.5, 0.0), (2.0, 0.5, 0.9)),))
    found = ViewNoiseDetector(truth, NOISE.scaled(0)).detect(truth.frame(), context_of("flurb"))
    assert {s.class_name for s in found.seen} == {"flurb"}


@BOTH_NOISES
def test_the_noise_table_selects_the_simulated_detector(noise):
    truth = NamedTruth()
    mine = open_detector("simulated", DetectorOptions(truth, noise=noise.name, noise_level=0.5))
    demo = open_detector("simulated", DetectorOptions(truth))
    assert mine.name == f"simulated:{noise.name}@{noise.digest}"
    assert demo.name.startswith("simulated:demo-v1@")
    assert set(demo.vocabulary() or ()) <= set(mine.vocabulary() or ())


def test_any_object_may_be_confused_with_the_asked_object_but_furniture_never():
    truth = NamedTruth()
    frame = truth.frame(looking(0.7))
    table = scaled(second=1.0).scaled(1, 1.0)
    confusion = table.file.confusion.model_copy(update={"anything": 0.3})
    whole = table.file.mask.model_copy(update={"partial": 0.0, "leak": 0.0})
    file = table.file.model_copy(update={"confusion": confusion, "mask": whole})
    table = replace(table, file=file)
    context = context_of("teddy bear", threshold=0.0)
    things = [k for k, i in truth.segmentation(frame.stamp_ns).instances.items() if i.graspable]
    hits = 0
    for seed in range(60):
        for found in ViewNoiseDetector(truth, table, seed).detect(frame, context).detections:
            shown = truth.ids[frame.stamp_ns][found.mask]
            assert np.isin(shown, things).all()
            hits += 1
    assert 0.15 * 60 * len(things) < hits < 0.45 * 60 * len(things)
