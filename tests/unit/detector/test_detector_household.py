"""The simulated detector's vocabulary: every class of the generated homes, no unknown class."""

from __future__ import annotations

import pytest
from detector_scene import ROOM, SceneTruth
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import open_detector
from helios_planner.instruction.parser import parse
from helios_planner.tasks.search_context import in_vocabulary
from helios_sim.episode_tracker import episode_of
from helios_sim.home import PRESETS, generate_home
from helios_sim.home.catalogs import CATALOGS


@pytest.fixture(scope="module")
def vocabulary() -> pb.VocabularyReply:
    names = open_detector("simulated", DetectorOptions(SceneTruth(ROOM))).vocabulary() or ()
    return pb.VocabularyReply(names=names, detector="simulated")


@pytest.mark.parametrize("seed", range(10))
def test_the_vocabulary_covers_every_task_of_the_generated_homes_as_written(
    seed: int, vocabulary: pb.VocabularyReply
) -> None:
    home = generate_home(seed, PRESETS["demo-v1"])
    instruction = parse(episode_of(home, seed).instruction)
    assert in_vocabulary(instruction, vocabulary) == instruction
    names = {o.class_name for o in home.objects} | {r.class_name for r in home.receptacles}
    assert {n.lower() for n in names} <= set(vocabulary.names)


@pytest.mark.parametrize("name", sorted(CATALOGS["ovmm"].objects))
def test_the_vocabulary_covers_every_object_of_the_benchmark(
    name: str, vocabulary: pb.VocabularyReply
) -> None:
    for receptacle in CATALOGS["ovmm"].receptacles:
        instruction = parse(f"Move the {name} from the {receptacle} to the sofa")
        assert instruction.object == name
        assert in_vocabulary(instruction, vocabulary) == instruction


@pytest.mark.parametrize("name", ["couch", "remote", "remote control", "counter", "red mug", "TV"])
def test_synonyms_of_household_classes_are_understood(
    name: str, vocabulary: pb.VocabularyReply
) -> None:
    assert in_vocabulary(parse(f"Find the {name}"), vocabulary).object


@pytest.mark.parametrize("name", ["unicorn", "flurbwozzle"])
def test_an_unknown_object_is_refused_by_name(name: str, vocabulary: pb.VocabularyReply) -> None:
    with pytest.raises(InvalidInput, match=f"does not know the object “{name}”"):
        in_vocabulary(parse(f"Move the {name} from the desk to the sofa"), vocabulary)
