"""The study that gives recorded observations to the object map again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import observation_from_proto
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole, lift_pixels
from helios_core.types import Detection, Frame, FrameId, Observation
from helios_eval.studies import map_histories, small_histories
from helios_eval.studies.map_histories import Moment, events_of, figures_of, main, record, replay
from helios_eval.studies.small_histories import thinned
from helios_objectmap.settings import ObjectMapSettings
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray


def moment(score: tuple[float, ...], at: tuple[str, ...]) -> Moment:
    return Moment("object", score, at)


def observation(depth_m: NDArray[np.float32], mask: NDArray[np.bool_]) -> Observation:
    height, width = depth_m.shape
    camera = Pinhole(20.0, 20.0, (width - 1) / 2, (height - 1) / 2, width, height)
    color = np.full((height, width, 3), 9, np.uint8)
    eye = np.eye(4)
    frame = Frame(FrameId("a", 0, 1), 1, True, color, depth_m, camera, eye, eye)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
    return Observation(frame, "search", (Detection("mug", 0.5, box, mask),), {}, "of a test")


def test_the_figures_count_ranking_best_instances_and_lost_ones() -> None:
    found = figures_of(
        [
            [
                moment((0.6, 0.2), ("mug_0", "")),
                moment((0.1, 0.3), ("mug_0", "")),
                moment((), ()),
                moment((0.4,), ("",)),
            ]
        ]
    )["object"]
    assert found.row() == ["0.500", "0.50", "0.75", "5"]


def test_a_thing_never_believed_cannot_be_lost() -> None:
    found = figures_of([[moment((0.1,), ("mug_0",)), moment((0.0,), ("mug_0",))]])["object"]
    assert found.below_half == []
    assert found.row()[0] == "nan"


def test_another_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "helios-1.history.gz"
    path.write_bytes(map_histories.gzip.compress(b"X\x00\x00\x00\x00"))
    with pytest.raises(InvalidInput, match="is no history"):
        list(events_of(path))
    path.unlink()
    assert main(["replay", str(tmp_path)]) == 2
    assert "has no histories; `record` writes them" in capsys.readouterr().err


@given(st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_a_smaller_observation_shows_the_same_points_and_masks(step: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.5, 4, (12, 16)).astype(np.float32)
    mask = rng.random((12, 16)) < 0.1
    mask[rng.integers(12), rng.integers(16)] = True
    whole = observation(depth_m, mask)
    small = thinned(whole, step)
    view, depth = small.frame, small.frame.depth_m
    points = lift_pixels(depth, view.camera, np.eye(4))
    first = step // 2
    expected = lift_pixels(depth_m, whole.frame.camera, np.eye(4))[first::step, first::step]
    np.testing.assert_allclose(points, expected, rtol=1e-5)
    kept = mask[first::step, first::step]
    assert len(small.detections) == kept.any()
    for detection in small.detections:
        x0, y0, x1, y1 = detection.box_xyxy
        np.testing.assert_array_equal(detection.mask, kept)
        assert kept[y0:y1, x0:x1].sum() == kept.sum()


def test_a_smaller_history_keeps_the_chosen_observations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = Path(__file__).parents[1] / "objectmap" / "histories" / "helios-201.history.gz"
    given = [str(source), "--out", str(tmp_path), "--step", "2", "--observations", "10-19"]
    assert small_histories.main(given) == 0
    assert source.name in capsys.readouterr().out
    kept = [e for e in events_of(tmp_path / source.name) if isinstance(e, pb.Observation)]
    before = [e for e in events_of(source) if isinstance(e, pb.Observation)][10:20]
    assert [e.frame.id for e in kept] == [e.frame.id for e in before]
    small = observation_from_proto(kept[0])
    assert small.frame.depth_m.shape == (30, 40)
    assert small_histories.main([str(tmp_path / "none.gz"), "--out", str(tmp_path)]) == 2
    assert "none.gz" in capsys.readouterr().err


@pytest.mark.timeout(300)
def test_a_recorded_episode_replays_to_the_beliefs_that_it_had(tmp_path: Path) -> None:
    path = record(3, "trusting", "demo-v1", "", tmp_path, {})
    moments = replay(path, ObjectMapSettings(agent="trusting"))
    assert {m.role for m in moments} == {"object", "start", "goal"}
    assert any(any(m.at) for m in moments)
    assert moments == replay(path, ObjectMapSettings(agent="trusting"))
