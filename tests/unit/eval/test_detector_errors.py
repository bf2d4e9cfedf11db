"""Tests the study of detectors' errors: judgement, persistence, agreement, and the command."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helios_core.geometry import Pinhole
from helios_core.types import Detection
from helios_eval.studies.detector_errors import persistence
from helios_eval.studies.detector_errors.__main__ import main
from helios_eval.studies.detector_errors.error_summary import summary
from helios_eval.studies.detector_errors.persistence import (
    RELATIONS,
    both_below,
    expected,
    latent_correlation,
    pairs_of,
)
from helios_eval.studies.detector_errors.repeat_rates import (
    ANGLES_DEG,
    LoggedImage,
    SeenPlace,
    repeat_rates,
)
from helios_eval.studies.detector_errors.sightings import (
    SightingLog,
    Sightings,
    Visible,
    depth_in,
    overlaps,
)
from helios_eval.studies.realism_views import looking
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import multivariate_normal

from tests.unit.detector.tiny_onnx import yolox

RIGHT = {"mug": frozenset({"cup"}), "sofa": frozenset({"couch"})}


# --- judgement ------------------------------------------------------------------------------------
def detection(name: str, score: float, box: tuple[int, int, int, int]) -> Detection:
    return Detection(name, score, box, np.zeros((4, 4), bool))


def judged(*found: Detection) -> tuple[Sightings, SightingLog]:
    log = SightingLog(RIGHT, asked=2)
    T = np.eye(4)
    T[:3, 3] = 1.0, 0.0, 1.0
    things = (
        Visible("mug_1", "mug", (0, 0, 10, 10), 80, (0.0, 0.0, 1.0), True),
        Visible("sofa_1", "sofa", (50, 50, 90, 90), 900, (1.0, 3.0, 0.4), False),
    )
    log.add(7, 0, T, things, found)
    return log.sightings(), log


def test_a_detection_counts_for_the_object_that_it_covers() -> None:
    seen, log = judged(
        detection("cup", 0.6, (0, 0, 10, 9)),
        detection("couch", 0.3, (1, 0, 10, 10)),
        detection("cup", 0.9, (200, 200, 210, 210)),
    )
    assert seen.class_name.tolist() == ["mug", "sofa"]
    assert seen.right.tolist() == [0.6, 0.0]
    assert seen.wrong.tolist() == [0.3, 0.0]
    assert seen.wrong_name.tolist() == ["couch", ""]
    assert seen.wrong_names.tolist() == [1, 0]
    assert seen.distance_m[0] == pytest.approx(1.0)
    assert seen.angle_rad[0] == pytest.approx(0.0)
    alarms = log.false_alarms()
    assert (alarms.images, alarms.asked, alarms.score.tolist()) == (1, 2, [0.9])
    assert alarms.box_px.tolist() == [100.0]
    assert np.isnan(alarms.distance_m).all()
    assert log.scores().tolist() == [0.6, 0.3, 0.9]


def test_a_false_alarm_lies_as_far_as_the_middle_depth_in_its_box() -> None:
    depth_m = np.full((300, 300), 4.0, np.float32)
    depth_m[200:210, 200:208] = 2.5
    depth_m[200:210, 208:210] = 0.0  # not known
    box = (200, 200, 210, 210)
    assert depth_in(box, depth_m) == 2.5
    assert math.isnan(depth_in((0, 0, 5, 5), 0 * depth_m))
    log = SightingLog(RIGHT, asked=2)
    mug = Visible("mug_0", "mug", (0, 0, 10, 10), 100, (1.0, 0.0, 0.0), True)
    for _ in range(4):
        log.add(0, 0, np.eye(4), [mug], [detection("cup", 0.9, box)], depth_m)
    said = summary(log.sightings(), log.false_alarms())
    assert said.alarms_by_distance == (0.0, 0.0, 0.0, 100.0, 0.0, 0.0, 0.0)
    assert said.alarms_by_pixels[0] == 100.0


def test_without_images_every_figure_is_empty() -> None:
    log = SightingLog(RIGHT, asked=2)
    assert len(log.sightings()) == 0
    assert log.false_alarms().images == 0


boxes = st.tuples(*(st.floats(0, 50),) * 2, *(st.floats(1, 50),) * 2).map(
    lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
)


@given(st.lists(boxes, min_size=1, max_size=4))
def test_overlaps_are_symmetric_and_1_of_a_box_with_itself(some: list) -> None:
    share = overlaps(some, some)
    assert np.allclose(share, share.T)
    assert np.allclose(np.diag(share), 1)
    assert ((share >= 0) & (share <= 1 + 1e-12)).all()


# --- persistence ----------------------------------------------------------------------------------
@pytest.mark.parametrize("rho", [-0.2, 0.0, 0.3, 0.7, 0.95])
def test_both_below_is_the_bivariate_normal_distribution(rho: float) -> None:
    for h, k in ((0.3, -0.4), (-1.5, 1.0), (2.0, 2.0)):
        covariance: Any = [[1, rho], [rho, 1]]
        exact = multivariate_normal([0, 0], covariance).cdf([h, k])
        assert both_below(np.array([h]), np.array([k]), rho)[0] == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_latent_correlation_is_found_from_outcomes(rho: float) -> None:
    rng = np.random.default_rng(3)
    n = 6000
    p = rng.uniform(0.1, 0.8, n)
    z = rng.multivariate_normal([0, 0], [[1, rho], [rho, 1]], n)
    first, second = (z[:, k] < ndtri(p) for k in range(2))
    found = latent_correlation(first, second, p, p, rng.integers(0, 20, n))
    assert found.value == pytest.approx(rho, abs=0.06)
    assert found.low <= found.value <= found.high
    assert found.pairs == n


def test_without_pairs_the_correlation_is_not_a_number() -> None:
    none = np.empty(0)
    found = latent_correlation(none > 0, none > 0, none, none, none.astype(int))
    assert math.isnan(found.value)


def around(
    angles_deg: list[float], distances_m: list[float], views: list[int], thing: int = 0
) -> Sightings:
    """Sightings of one mug."""
    n = len(angles_deg)
    return Sightings(
        home=np.zeros(n, np.int64),
        thing=np.full(n, thing),
        view=np.array(views),
        class_name=np.array(["mug"] * n),
        pixels=np.full(n, 500.0),
        distance_m=np.array(distances_m),
        angle_rad=np.radians(angles_deg),
        unobstructed=np.ones(n, bool),
        right=np.full(n, 0.5),
        wrong=np.zeros(n),
        wrong_name=np.array([""] * n),
        wrong_names=np.zeros(n, np.int64),
    )


@pytest.mark.parametrize(
    ("angle_deg", "distance_m", "view", "relation"),
    [
        (1, 1.0, 0, "same view, next frame"),
        (4, 1.6, 1, "same side, other distance"),
        (-30, 1.0, 1, "30° further, same distance"),
        (330, 1.0, 1, "30° further, same distance"),
        (90, 1.05, 1, "90° further, same distance"),
        (180, 1.0, 1, "180° further, same distance"),
        (175, 1.6, 1, "opposite side, other distance"),
        (45, 1.0, 1, ""),
        (4, 1.0, 1, ""),
    ],
)
def test_pairs_are_sorted_by_how_the_view_changes(
    angle_deg: float, distance_m: float, view: int, relation: str
) -> None:
    pairs = pairs_of(around([0, angle_deg], [1.0, distance_m], [0, view]))
    assert [name for name, rows in pairs.items() if len(rows)] == [relation] * bool(relation)


def test_other_objects_of_a_class_are_paired_within_a_home() -> None:
    a, b = around([0], [1.0], [0]), around([0], [1.0], [1], thing=1)
    both = Sightings(
        *(np.concatenate(x) for x in zip(vars(a).values(), vars(b).values(), strict=True))
    )
    assert len(pairs_of(both)[RELATIONS[-1]])
    apart = Sightings(**{**vars(both), "home": np.array([0, 1])})
    assert not len(pairs_of(apart)[RELATIONS[-1]])


def test_expected_outcomes_follow_class_and_size() -> None:
    rng = np.random.default_rng(0)
    n = 4000
    names = np.array(["mug", "bed"])[rng.integers(0, 2, n)]
    pixels = np.exp(rng.uniform(5, 9, n))
    true = 1 / (1 + np.exp(-(np.where(names == "bed", 1.0, -1.0) + np.log(pixels / 1000))))
    seen = around([0.0] * n, rng.uniform(1, 3, n).tolist(), list(range(n)))
    seen = Sightings(**{**vars(seen), "class_name": names, "pixels": pixels})
    p = expected(seen, rng.uniform(size=n) < true)
    for name in ("mug", "bed"):
        for large in (False, True):
            rows = (names == name) & ((pixels > 1000) == large)
            assert p[rows].mean() == pytest.approx(true[rows].mean(), abs=0.06)


def test_a_summary_tells_persistent_from_independent_errors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(persistence, "MOST_PAIRS", 3000)
    rng = np.random.default_rng(5)
    things, turns = 60, 24
    kind = rng.uniform(size=things) < 0.5
    log_p = {"fixed": np.repeat(kind, turns), "drawn": rng.uniform(size=things * turns) < 0.5}
    found = {}
    for name, right in log_p.items():
        n = things * turns
        seen = around(np.tile(np.arange(turns) * 15.0, things).tolist(), [1.0] * n, list(range(n)))
        seen = Sightings(
            **{
                **vars(seen),
                "thing": np.repeat(np.arange(things), turns),
                "home": np.repeat(np.arange(things) % 6, turns),
                "right": 0.5 * right,
            }
        )
        alarms = SightingLog(RIGHT, asked=2).false_alarms()
        found[name] = summary(seen, alarms).right_persists["90° further, same distance"].value
    assert found["fixed"] > 0.9
    assert abs(found["drawn"]) < 0.15


# --- agreement without truth ----------------------------------------------------------------------
CAMERA = Pinhole(fx=500.0, fy=500.0, cx=320.0, cy=240.0, width=640, height=480)
PLACE_M = np.array([0.0, 0.0, 1.0])


def image(
    eye_m: tuple[float, float, float],
    *names: str,
    at_m: NDArray[np.float64] = PLACE_M,
    depth_m: float | None = None,
) -> LoggedImage:
    """Image that looks at the place, with detections in its middle that mark `at_m`."""
    away_m = float(np.linalg.norm(np.array(eye_m) - PLACE_M)) if depth_m is None else depth_m
    seen = tuple(SeenPlace(name, 0.5, (300, 220, 340, 260), at_m) for name in names)
    depth = np.full((120, 160), away_m, np.float32)
    return LoggedImage(CAMERA, looking(np.array(eye_m), PLACE_M), depth, seen)


@pytest.mark.parametrize(
    ("names", "depth_m", "counts"),
    [
        (("cup",), None, (1, 1, 0)),
        (("vase",), None, (1, 0, 1)),
        (("vase", "cup"), None, (1, 1, 0)),
        ((), None, (1, 0, 0)),
        (("cup",), 0.5, (0, 0, 0)),  # something stands before the place
    ],
)
def test_another_image_repeats_a_name_or_not(
    names: tuple[str, ...], depth_m: float | None, counts: tuple[int, int, int]
) -> None:
    elsewhere = np.array([0.0, 0.0, -50.0])
    first = image((2.0, 0.0, 1.2), "cup")
    second = image((0.0, 2.0, 1.2), *names, at_m=elsewhere, depth_m=depth_m)
    found = repeat_rates([first, second])
    assert (found.pairs.sum(), found.same.sum(), found.other.sum()) == counts
    assert found.pairs[ANGLES_DEG.index(70)] == counts[0]


def test_images_from_other_distances_do_not_count() -> None:
    far = image((0.0, 4.0, 1.2), "cup", at_m=np.array([0.0, 0.0, -50.0]))
    assert repeat_rates([image((2.0, 0.0, 1.2), "cup"), far]).pairs.sum() == 0


# --- command --------------------------------------------------------------------------------------
def test_the_command_needs_a_real_detector(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--detector", "simulated:ovmm-v1", "--out", str(tmp_path)]) == 2
    assert "add --detector onnx:FILE" in capsys.readouterr().err


def test_the_command_compares_detectors_on_the_same_images(tmp_path: Path) -> None:
    model = yolox(tmp_path / "tiny.onnx", [((300.0, 220.0, 340.0, 260.0), 0, 0.9)], 80)
    arguments = ["--detector", f"onnx:{model}", "--detector", "simulated:ovmm-v1"]
    arguments += ["--preset", "demo-v1", "--seeds", "0", "--things", "2", "--out", str(tmp_path)]
    assert main(arguments) == 0
    figures = json.loads((tmp_path / "detector-errors.json").read_text())
    real, simulated = figures["detectors"].values()
    assert real["sightings"] == simulated["sightings"] > 0
    assert real["all"]["right"] == 0  # it reports a person in every image
    assert simulated["all"]["right"] > 0
    assert "simulated:ovmm-v1" in (tmp_path / "detector-errors.md").read_text()
    assert (tmp_path / "detector-errors.png").read_bytes().startswith(b"\x89PNG")
