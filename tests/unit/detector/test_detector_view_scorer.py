"""The simulated image-text scorer: rates what is in view, with smooth errors of its own."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from detector_scene import BOWL, MUG, TABLE, looking
from helios_core.errors import InvalidInput
from helios_detector.backend import DetectorOptions, Seen
from helios_detector.model_loading import open_scorer
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.view_noise import key_of
from helios_detector.simulation.view_noise_detector import ViewNoiseDetector
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from helios_detector.simulation.view_scorer import (
    ViewScorer,
    areas_in_view,
    load_scorer_table,
    view_field,
)
from hypothesis import given
from hypothesis import strategies as st
from test_detector_view_simulated import NamedTruth

PROMPT = "Seems like there is a {} ahead"
POSES = [looking(float(x), float(y), 0.1) for x in (-1, 0, 0.5) for y in (-0.4, 0, 0.4)]


TRUTH = NamedTruth()
FRAMES = [TRUTH.frame(pose, n) for n, pose in enumerate(POSES, 1)]


def scorer(spread: float | None = None, seed: int = 0) -> ViewScorer:
    """Scorer of the scene; spread: in place of the table's."""
    made = ViewScorer(TRUTH, seed=seed)
    if spread is not None:
        error = made.table.error.model_copy(update={"spread": spread})
        made.table = made.table.model_copy(update={"error": error})
    return made


def scores(of: ViewScorer, sought: str, seen: tuple[Seen, ...] = ()) -> list[float]:
    return [of.score(f, seen, {"pick": PROMPT.format(sought)})["pick"] for f in FRAMES]


def test_the_published_table_and_its_scores_do_not_change() -> None:
    """A failure means that a published table has changed: give the new table a new name."""
    assert load_scorer_table("itc-v1")[1] == "227edf32dd3e62ae"
    reported = {sought: scores(scorer(seed=5), sought) for sought in ("mug", "bed", "dining table")}
    rounded = {sought: [round(s, 6) for s in values] for sought, values in reported.items()}
    assert hashlib.sha256(json.dumps(rounded).encode()).hexdigest()[:16] == "96d65927135dbfaf"


def test_the_exact_table_is_the_published_one_without_its_error() -> None:
    published, exact = load_scorer_table("itc-v1")[0], load_scorer_table("itc-exact")[0]
    assert exact.error.spread == 0.0 < published.error.spread
    error = published.error.model_copy(update={"spread": 0.0})
    assert exact == published.model_copy(update={"name": "itc-exact", "error": error})


def test_without_error_the_sought_class_scores_above_its_kin_and_kin_above_a_stranger() -> None:
    free = scorer(0.0)
    share = 0.02
    same, kin, other = (free.signal({name: share}, "mug") for name in ("cup", "bowl", "shoe"))
    assert same > kin > other


@given(st.floats(1e-5, 0.4), st.floats(1.01, 10))
def test_a_thing_that_covers_more_of_the_image_never_scores_less(
    share: float, factor: float
) -> None:
    free = scorer(0.0)
    nearer = min(1.0, share * factor)
    assert free.signal({"mug": share}, "mug") <= free.signal({"mug": nearer}, "mug") <= 1


def test_furniture_that_usually_carries_the_object_raises_the_score() -> None:
    free = scorer(0.0)
    assert free.signal({"kitchen counter": 0.1}, "mug") > free.signal({"bed": 0.1}, "mug")


def test_the_detector_does_not_change_the_scores() -> None:
    """Neither what it reports nor the severity of its noise."""
    silent = scores(scorer(), "mug")
    assert scores(scorer(), "mug", (Seen("mug", 1.0), Seen("bed", 0.9))) == silent


def test_the_errors_do_not_repeat_those_of_the_detector() -> None:
    """Over 400 seeds the scorer's error is uncorrelated with the detector's miss of the mug."""
    table = load_noise("ovmm-v1")
    assert isinstance(table, ViewNoiseTable)
    frame = FRAMES[0]
    missed, error = [], []
    for seed in range(400):
        detector = ViewNoiseDetector(TRUTH, table, seed)
        found = detector.verdicts(frame, TRUTH.segmentation(frame.stamp_ns), ())
        missed.append(all(not v.names for v in found if v.thing.instance.class_name == "mug"))
        error.append(scorer(seed=seed)._error(frame, "mug"))
    assert 0.1 < np.mean(missed) < 0.9
    assert abs(np.corrcoef(missed, error)[0, 1]) < 0.15  # 3 standard errors


def test_the_error_has_mean_0_and_variance_1_over_seeds() -> None:
    frame = FRAMES[0]
    drawn = np.array([scorer(seed=seed)._error(frame, "mug") for seed in range(1500)])
    assert abs(drawn.mean()) < 0.1
    assert abs(drawn.var() - 1) < 0.15


@pytest.mark.parametrize(
    ("step_m", "turn_rad", "wanted"),
    [(0, 0, 1.0), (1.5, 0, math.exp(-0.5)), (0, math.pi / 4, math.exp(-0.5)), (6, 0, 0.0)],
)
def test_the_field_correlates_by_distance_and_heading_as_the_table_says(
    step_m: float, turn_rad: float, wanted: float
) -> None:
    fields = [view_field(key_of(f"field {n}"), 1.5, math.pi / 4) for n in range(1500)]
    here = [field(2.0, 1.0, 0.3) for field in fields]
    there = [field(2.0 + step_m, 1.0, 0.3 + turn_rad) for field in fields]
    assert abs(np.corrcoef(here, there)[0, 1] - wanted) < 0.09


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-math.pi, math.pi))
def test_the_field_is_smooth_and_a_full_turn_changes_nothing(x: float, y: float, a: float) -> None:
    field = view_field(7, 1.5, math.pi / 4)
    assert field(x, y, a + math.tau) == pytest.approx(field(x, y, a), abs=1e-9)
    assert abs(field(x + 0.01, y, a) - field(x, y, a)) < 0.1


def test_seeds_and_classes_draw_different_fields() -> None:
    assert scores(scorer(seed=1), "mug") != scores(scorer(seed=2), "mug")
    spread = scorer()
    frame = FRAMES[0]
    assert spread._error(frame, "mug") != spread._error(frame, "bed")


def test_a_class_that_no_table_knows_scores_low_but_in_range() -> None:
    assert all(0 <= s <= 1 for s in scores(scorer(), "flux capacitor"))
    assert scores(scorer(0.0), "flux capacitor") == [0.1] * len(POSES)


def test_areas_count_the_largest_thing_of_a_class() -> None:
    truth = TRUTH.segmentation(FRAMES[0].stamp_ns)
    frame_truth = replace(truth, ids=np.array([[1, 1, 1, 2], [0, 3, 3, 3]], np.uint16))
    areas = areas_in_view(frame_truth)
    assert areas == {"dining table": 3 / 8, "mug": 1 / 8, "bowl": 3 / 8}
    assert {TABLE.class_name, MUG.class_name, BOWL.class_name} == areas.keys()


def test_the_scorer_needs_ground_truth() -> None:
    with pytest.raises(InvalidInput, match="needs the simulator's truth"):
        open_scorer("simulated", DetectorOptions())
    made = open_scorer("simulated:itc-v1", DetectorOptions(truth=NamedTruth()))
    assert made.name.startswith("simulated:itc-v1@")


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (None, "there is no scorer table"),
        ("name = 3 = 4", "is no TOML"),
        ('name = "x"', "signal: Field required"),
    ],
)
def test_a_wrong_table_is_refused_with_its_fault(tmp_path, content, reported) -> None:
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InvalidInput, match=reported):
        load_scorer_table(str(path))


def test_shares_that_do_not_add_up_are_refused(tmp_path) -> None:
    from importlib import resources

    text = resources.files("helios_detector").joinpath("scorer_tables/itc-v1.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("view = 0.8", "view = 0.9"))
    with pytest.raises(InvalidInput, match=r"add up to 1\.1, not to 1"):
        load_scorer_table(str(path))
