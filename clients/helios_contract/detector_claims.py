"""Contract tests of detectors."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from numbers import Integral

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.types import Detection, Frame
from helios_detector.backend import Findings, Seen
from helios_detector.output_checks import checked_findings

from helios_contract.bench import UNKNOWN, DetectorBench, odd, searching, views
from helios_contract.model_claims import BackEndContract

HIGH = 0.9  # a high threshold
SLACK = 1e-6  # rounding margin of a float32 score


class DetectorContract(BackEndContract[DetectorBench]):
    """All contract tests of one detector.

    Subclass it under a name that begins with Test, and construct the detector in `stand`.
    """

    # --- names ---------------------------------------------------------------------------------
    def test_its_vocabulary_is_none_or_a_tuple_of_names(self, bench: DetectorBench) -> None:
        names = bench.detector.vocabulary()
        if names is None:
            return
        assert isinstance(names, tuple), "None: any name may be asked for; else a tuple of names"
        assert names
        assert all(isinstance(name, str) and name.strip() for name in names)
        assert len(set(names)) == len(names), "a name is in it twice"

    def test_its_vocabulary_stays_the_same(self, bench: DetectorBench) -> None:
        before = bench.detector.vocabulary()
        _found(bench, views(bench.pictures)[0])
        assert bench.detector.vocabulary() == before

    def test_no_name_of_its_vocabulary_is_refused(self, bench: DetectorBench) -> None:
        for name in bench.class_names:
            assert not bench.detector.refused(searching([name]))

    def test_a_name_that_it_does_not_know_is_refused_with_a_sentence(
        self, bench: DetectorBench
    ) -> None:
        _need_fixed(bench)
        refused = bench.detector.refused(searching([bench.class_names[0], UNKNOWN]))
        assert set(refused) == {UNKNOWN}, "a dict of the refused names, and of no other"
        assert len(refused[UNKNOWN].split()) >= 3, "the value says why, in a sentence"

    def test_detect_raises_invalid_input_for_a_name_that_it_does_not_know(
        self, bench: DetectorBench
    ) -> None:
        _need_fixed(bench)
        with pytest.raises(InvalidInput):
            bench.detector.detect(views(())[0], searching([UNKNOWN]))

    # --- findings ------------------------------------------------------------------------------
    def test_it_gives_findings_of_detections_and_seen(self, bench: DetectorBench) -> None:
        for frame in _all_frames(bench):
            found = bench.detector.detect(frame, searching(bench.class_names))
            assert isinstance(found, Findings)
            assert all(isinstance(d, Detection) for d in found.detections)
            assert all(isinstance(s, Seen) and isinstance(s.class_name, str) for s in found.seen)

    def test_only_what_was_asked_for_is_detected(self, bench: DetectorBench) -> None:
        one = bench.class_names[:1]
        for frame in _all_frames(bench):
            for asked in (one, bench.class_names):
                found = bench.detector.detect(frame, searching(asked))
                assert {d.class_name for d in found.detections} <= set(asked)

    def test_masks_are_bool_and_as_large_as_the_image(self, bench: DetectorBench) -> None:
        for frame, d in _detections(bench):
            assert isinstance(d.mask, np.ndarray)
            assert (d.mask.dtype, d.mask.shape) == (bool, frame.depth_m.shape)
            assert d.mask.any() or not frame.depth_m.any(), "a detection without a pixel"

    def test_boxes_are_whole_pixels_within_the_image_around_their_masks(
        self, bench: DetectorBench
    ) -> None:
        for frame, d in _detections(bench):
            height, width = frame.depth_m.shape
            assert all(isinstance(v, Integral) for v in d.box_xyxy)
            x0, y0, x1, y1 = d.box_xyxy
            assert 0 <= x0 < x1 <= width
            assert 0 <= y0 < y1 <= height
            assert d.mask.sum() == d.mask[y0:y1, x0:x1].sum(), "the mask goes beyond its box"

    def test_scores_are_numbers_from_0_to_1(self, bench: DetectorBench) -> None:
        for frame in _all_frames(bench):
            found = _found(bench, frame)
            for score in [d.score for d in found.detections] + [s.score for s in found.seen]:
                assert np.isfinite(score)
                assert 0 <= score <= 1

    def test_nothing_below_the_threshold_of_its_class_is_detected(
        self, bench: DetectorBench
    ) -> None:
        for frame in _all_frames(bench):
            found = bench.detector.detect(frame, searching(bench.class_names, HIGH))
            assert all(d.score >= HIGH - SLACK for d in found.detections)

    def test_the_service_finds_nothing_to_refuse(self, bench: DetectorBench) -> None:
        for frame in _all_frames(bench):
            found = _found(bench, frame)
            _, wrong = checked_findings(found, frame.depth_m.shape, bench.class_names)
            assert not wrong, wrong.sentence

    def test_it_finds_something_in_the_pictures_that_were_given(self, bench: DetectorBench) -> None:
        if not bench.pictures:
            pytest.skip("no picture was given (--image FILE)")
        for frame in views(bench.pictures)[-len(bench.pictures) :]:
            assert _found(bench, frame).detections

    # --- unusual frames and searches -----------------------------------------------------------
    def test_a_search_for_nothing_detects_nothing(self, bench: DetectorBench) -> None:
        for frame in views(bench.pictures):
            assert not bench.detector.detect(frame, searching([])).detections

    @pytest.mark.parametrize("kind", sorted(odd()))
    def test_an_odd_frame_is_answered(self, bench: DetectorBench, kind: str) -> None:
        found = _found(bench, odd()[kind])
        assert isinstance(found, Findings)

    def test_a_frame_stays_as_it_was(self, bench: DetectorBench) -> None:
        for frame in views(bench.pictures):
            color, depth_m = frame.color.copy(), frame.depth_m.copy()
            _found(bench, frame)
            np.testing.assert_array_equal(frame.color, color)
            np.testing.assert_array_equal(frame.depth_m, depth_m)

    # --- as a part of a service ----------------------------------------------------------------
    def test_the_same_frame_gives_the_same(self, bench: DetectorBench) -> None:
        if not bench.deterministic:
            pytest.skip("it is said to be not deterministic")
        for frame in views(bench.pictures):
            assert _as_list(_found(bench, frame)) == _as_list(_found(bench, frame))

    def test_two_threads_at_once_get_what_one_gets(self, bench: DetectorBench) -> None:
        frames = views(bench.pictures) * 4
        alone = [_as_list(_found(bench, frame)) for frame in frames]
        with ThreadPoolExecutor(2) as pool:
            together = list(pool.map(lambda frame: _as_list(_found(bench, frame)), frames))
        if bench.deterministic:
            assert together == alone

    def test_warming_up_twice_is_as_once(self, bench: DetectorBench) -> None:
        bench.detector.warm_up()
        assert isinstance(_found(bench, views(())[0]), Findings)

    def test_it_works_again_after_its_memory_was_freed(self, bench: DetectorBench) -> None:
        bench.detector.unload()
        bench.detector.unload()
        assert isinstance(_found(bench, views(())[0]), Findings)


def _found(bench: DetectorBench, frame: Frame) -> Findings:
    return bench.detector.detect(frame, searching(bench.class_names))


def _all_frames(bench: DetectorBench) -> list[Frame]:
    return [*views(bench.pictures), *odd().values()]


def _detections(bench: DetectorBench) -> Iterator[tuple[Frame, Detection]]:
    for frame in _all_frames(bench):
        for d in _found(bench, frame).detections:
            yield frame, d


def _as_list(found: Findings) -> list[object]:
    """Findings as comparable values."""
    things = [(d.class_name, d.score, d.box_xyxy, d.mask.tobytes()) for d in found.detections]
    return [things, [(s.class_name, s.score) for s in found.seen]]


def _need_fixed(bench: DetectorBench) -> None:
    if bench.detector.vocabulary() is None:
        pytest.skip("any name may be asked of it")
