"""Contract tests of scorers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helios_core.types import Embedding, Frame
from helios_detector.backend import Judgement, Seen
from helios_detector.output_checks import checked_judgement

from helios_contract.bench import ScorerBench, odd, views
from helios_contract.model_claims import BackEndContract

PROMPTS = {"pick": "Seems like there is a mug ahead", "place": "Seems like there is a sofa ahead"}
SEEN = (Seen("table", 0.9), Seen("shelf", 0.4))
ODD_PROMPTS = {"pick": "", "place": "杯子 " * 200}
ALIKE = 1e-6  # margin between two scores of one prompt


class ScorerContract(BackEndContract[ScorerBench]):
    """All contract tests of one scorer.

    Subclass it under a name that begins with Test, and construct the scorer in `stand`.
    """

    def test_every_layer_gets_a_score_and_nothing_else_does(self, bench: ScorerBench) -> None:
        for frame in _frames(bench):
            assert set(_scores(bench, frame)) == set(PROMPTS)
            assert set(_scores(bench, frame, {"another": "a bed"})) == {"another"}

    def test_scores_are_numbers_from_0_to_1(self, bench: ScorerBench) -> None:
        for frame in _frames(bench):
            for score in _scores(bench, frame).values():
                assert np.isfinite(score)
                assert 0 <= score <= 1

    def test_the_service_finds_nothing_to_refuse(self, bench: ScorerBench) -> None:
        for frame in _frames(bench):
            judged = bench.scorer.judge(frame, SEEN, PROMPTS)
            _, wrong = checked_judgement(judged, PROMPTS)
            assert not wrong, wrong.sentence

    def test_without_a_prompt_there_is_no_score(self, bench: ScorerBench) -> None:
        assert _scores(bench, views(())[0], {}) == {}

    def test_where_nothing_is_seen_there_is_a_score_all_the_same(self, bench: ScorerBench) -> None:
        assert set(_scores(bench, views(())[0], PROMPTS, ())) == set(PROMPTS)

    def test_a_prompt_of_any_text_gets_a_score(self, bench: ScorerBench) -> None:
        assert set(_scores(bench, views(())[0], ODD_PROMPTS)) == set(ODD_PROMPTS)

    @pytest.mark.parametrize("kind", sorted(odd()))
    def test_an_odd_frame_is_scored(self, bench: ScorerBench, kind: str) -> None:
        assert set(_scores(bench, odd()[kind])) == set(PROMPTS)

    def test_one_prompt_gets_one_score_under_whatever_layer(self, bench: ScorerBench) -> None:
        text = PROMPTS["pick"]
        a, b = (_scores(bench, views(())[0], {"a": text, "b": text})[k] for k in "ab")
        alone = _scores(bench, views(())[0], {"c": text})["c"]
        assert a == pytest.approx(b, abs=ALIKE)
        if bench.deterministic:
            assert alone == pytest.approx(a, abs=1e-3), "it depends on the other prompts"

    def test_the_same_frame_gives_the_same(self, bench: ScorerBench) -> None:
        if not bench.deterministic:
            pytest.skip("it is said to be not deterministic")
        for frame in views(bench.pictures):
            assert _scores(bench, frame) == _scores(bench, frame)

    def test_two_threads_at_once_get_what_one_gets(self, bench: ScorerBench) -> None:
        frames = views(bench.pictures) * 4
        alone = [_scores(bench, frame) for frame in frames]
        with ThreadPoolExecutor(2) as pool:
            together = list(pool.map(lambda frame: _scores(bench, frame), frames))
        if bench.deterministic:
            assert together == alone

    def test_a_frame_stays_as_it_was(self, bench: ScorerBench) -> None:
        for frame in views(bench.pictures):
            color, prompts = frame.color.copy(), dict(PROMPTS)
            _scores(bench, frame, prompts)
            np.testing.assert_array_equal(frame.color, color)
            assert prompts == PROMPTS

    def test_an_image_embedding_goes_with_those_of_texts(self, bench: ScorerBench) -> None:
        image = bench.scorer.judge(views(())[0], SEEN, PROMPTS).image
        if image is None:
            pytest.skip("it gives no embeddings")
        assert isinstance(image, Embedding)
        made = bench.scorer.embed_text(list(PROMPTS.values()))
        assert len(made.texts) == len(PROMPTS)
        for one in (image, *made.texts):
            assert one.model == image.model, "only embeddings of one model may be compared"
            assert np.linalg.norm(one.vectors, axis=1) == pytest.approx(1.0, abs=1e-2)

    def test_warming_up_twice_is_as_once(self, bench: ScorerBench) -> None:
        bench.scorer.warm_up()
        assert set(_scores(bench, views(())[0])) == set(PROMPTS)

    def test_it_works_again_after_its_memory_was_freed(self, bench: ScorerBench) -> None:
        bench.scorer.unload()
        bench.scorer.unload()
        assert set(_scores(bench, views(())[0])) == set(PROMPTS)


def _frames(bench: ScorerBench) -> Iterator[Frame]:
    yield from views(bench.pictures)
    yield from odd().values()


def _scores(
    bench: ScorerBench,
    frame: Frame,
    prompts: Mapping[str, str] = PROMPTS,
    seen: Sequence[Seen] = SEEN,
) -> dict[str, float]:
    judged = bench.scorer.judge(frame, seen, prompts)
    assert isinstance(judged, Judgement), "judge returns a Judgement"
    assert isinstance(judged.scores, dict), "score returns a dict of layer to score"
    return judged.scores
