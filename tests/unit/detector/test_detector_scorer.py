"""The lexical scorer compares the names of seen objects with the names in a prompt."""

import numpy as np
import pytest
from detector_scene import frame_of
from helios_core.errors import InvalidInput
from helios_detector.backend import DetectorOptions, Seen
from helios_detector.lexical_scorer import FLOOR, PRIOR, LexicalScorer, load_affinity, names_in
from helios_detector.model_loading import open_detector, open_scorer
from hypothesis import given, settings
from hypothesis import strategies as st

FRAME = frame_of(())


def score(prompt: str, *seen: str) -> float:
    scored = LexicalScorer().score(FRAME, [Seen(n, 0.7) for n in seen], {"pick": prompt})
    return scored["pick"]


def test_the_prompted_object_scores_above_its_usual_furniture_and_that_above_another_room():
    prompt = "Seems like there is a mug ahead."
    itself, host, other = (score(prompt, n) for n in ("cup", "kitchen counter", "toilet"))
    assert itself > host > other


def test_furniture_of_the_same_room_scores_above_furniture_of_another_room():
    prompt = "Seems like there is a coffee table ahead."
    assert score(prompt, "sofa", "TV stand") > score(prompt, "bed", "wardrobe")


def test_a_frame_without_detections_scores_the_prior_and_above_unrelated_objects():
    prompt = "Seems like there is a bed ahead."
    assert score(prompt) == PRIOR > score(prompt, "kitchen counter")


def test_walls_and_floors_do_not_change_the_score():
    prompt = "Seems like there is a bed ahead."
    assert score(prompt, "wall", "floor") == PRIOR
    assert score(prompt, "wall", "nightstand") == score(prompt, "nightstand")


def test_a_prompt_without_a_known_name_scores_the_prior():
    assert score("a flurb ahead", "bed") == PRIOR


def test_names_in_gives_the_longest_known_names_of_a_prompt():
    assert names_in("Seems like there is a coffee table ahead") == ("coffee table",)
    assert set(names_in("mugs on the Dining_Tables")) == {"mug", "dining table"}
    assert names_in("a carpet") == ()


def test_every_layer_is_scored_in_one_call():
    seen = [Seen("bed", 0.9)]
    scored = LexicalScorer().score(FRAME, seen, {"pick": "a bed", "place": "a sink", "x": "?"})
    assert scored.keys() == {"pick", "place", "x"}


@settings(max_examples=100, deadline=None)
@given(
    seen=st.lists(
        st.tuples(st.sampled_from(sorted(load_affinity().rooms)), st.floats(0, 1)), max_size=8
    ),
    prompt=st.text(max_size=40) | st.sampled_from(["a mug", "a desk", "the bed and the sofa"]),
)
def test_scores_are_from_0_to_1(seen, prompt):
    scored = LexicalScorer().score(FRAME, [Seen(n, s) for n, s in seen], {"l": prompt})
    assert 0 <= scored["l"] <= 1
    assert np.isfinite(scored["l"])


def test_a_detection_with_score_0_gives_the_floor_score():
    seen = [Seen("mug", 0.0), Seen("bed", 0.0)]
    assert LexicalScorer().score(FRAME, seen, {"pick": "a mug"}) == {"pick": FLOOR}


def test_the_prompt_cache_has_a_limit():
    for i in range(300):
        names_in(f"a mug with the number {i}")
    assert names_in.cache_info().currsize <= 256


def test_host_affinities_are_weights_up_to_1_and_room_affinities_add_up_to_1():
    table = load_affinity()
    assert all(0 < w <= 1 for row in table.hosts.values() for w in row.values())
    assert all(sum(row.values()) == pytest.approx(1) for row in table.rooms.values())


@pytest.mark.parametrize(
    "spec", ["transformers:", "transformers", "onnx", "onnx:", "", "simulated:x", "no"]
)
def test_an_unknown_detector_is_refused_with_the_choices(spec):
    with pytest.raises(
        InvalidInput, match="set simulated, ground-truth, onnx:FILE, transformers:ID, package:Class"
    ):
        open_detector(spec, DetectorOptions())


def test_an_unknown_scorer_is_refused_with_the_choices():
    with pytest.raises(InvalidInput, match="set lexical"):
        open_scorer("vectors")
    assert open_scorer("lexical").name == "lexical"


def test_the_simulated_detector_is_refused_without_ground_truth():
    with pytest.raises(InvalidInput, match="needs the simulator's truth"):
        open_detector("simulated", DetectorOptions())
