"""The lexical scorer: what is seen against what is sought, by names alone."""

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


def test_the_sought_thing_itself_scores_above_its_usual_furniture_above_another_room():
    prompt = "Seems like there is a mug ahead."
    itself, host, other = (score(prompt, n) for n in ("cup", "kitchen counter", "toilet"))
    assert itself > host > other


def test_furniture_of_the_same_room_scores_above_furniture_of_another():
    prompt = "Seems like there is a coffee table ahead."
    assert score(prompt, "sofa", "TV stand") > score(prompt, "bed", "wardrobe")


def test_nothing_seen_is_the_prior_and_better_than_only_unrelated_things():
    prompt = "Seems like there is a bed ahead."
    assert score(prompt) == PRIOR > score(prompt, "kitchen counter")


def test_walls_and_floors_say_nothing():
    prompt = "Seems like there is a bed ahead."
    assert score(prompt, "wall", "floor") == PRIOR
    assert score(prompt, "wall", "nightstand") == score(prompt, "nightstand")


def test_a_prompt_without_a_known_name_scores_the_prior():
    assert score("a flurb ahead", "bed") == PRIOR


def test_names_in_a_prompt_are_the_longest_known_ones():
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


def test_what_is_seen_with_a_score_of_0_scores_as_nothing_related():
    seen = [Seen("mug", 0.0), Seen("bed", 0.0)]
    assert LexicalScorer().score(FRAME, seen, {"pick": "a mug"}) == {"pick": FLOOR}


def test_few_prompts_are_remembered():
    for i in range(300):
        names_in(f"a mug with the number {i}")
    assert names_in.cache_info().currsize <= 256


def test_affinities_are_shares_and_weights():
    table = load_affinity()
    assert all(0 < w <= 1 for row in table.hosts.values() for w in row.values())
    assert all(sum(row.values()) == pytest.approx(1) for row in table.rooms.values())


@pytest.mark.parametrize(
    "spec", ["transformers:", "transformers", "onnx", "onnx:", "", "simulated:x", "no"]
)
def test_an_unknown_detector_names_the_choices(spec):
    with pytest.raises(
        InvalidInput, match="set simulated, ground-truth, onnx:FILE, transformers:ID, package:Class"
    ):
        open_detector(spec, DetectorOptions())


def test_an_unknown_scorer_names_the_choice():
    with pytest.raises(InvalidInput, match="set lexical"):
        open_scorer("vectors")
    assert open_scorer("lexical").name == "lexical"


def test_the_simulated_detector_without_a_truth_is_refused():
    with pytest.raises(InvalidInput, match="needs the simulator's truth"):
        open_detector("simulated", DetectorOptions())
