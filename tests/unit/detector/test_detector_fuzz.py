"""Mutated frames against a real model; the long run is `fuzz_frames.py --frames 10000`."""

import random
from pathlib import Path

import fuzz_frames
import pytest
import tiny_models
from detector_scene import frame_of
from helios_core.codec import frame_from_proto, frame_to_proto
from helios_core.errors import InvalidInput
from helios_detector.hf.detector import HfDetector
from helios_detector.hf.runtime import Placement


def test_300_mutated_frames_are_answered_or_refused(tmp_path: Path):
    owl = tiny_models.write("owlv2", tmp_path)
    counts = fuzz_frames.run(300, HfDetector(f"transformers:{owl}", Placement("cpu")), seed=1)
    assert counts["keyframes_refused"] > 100
    assert counts["keyframes_answered"] > 30
    assert counts["previews_refused"] == counts["keyframes_refused"]


@pytest.mark.parametrize("mutation", fuzz_frames.MUTATIONS, ids=lambda m: m.__name__)
def test_each_mutation_is_decoded_or_refused_with_a_sentence(mutation: fuzz_frames.Mutation):
    good = frame_to_proto(frame_of())
    rng, refused = random.Random(0), []
    for n in range(40):
        frame = type(good)()
        frame.CopyFrom(good if n % 2 else fuzz_frames.compressed(good))
        mutation(frame, rng)
        try:
            frame_from_proto(frame)
        except InvalidInput as error:
            refused.append(error.message)
    assert all(len(sentence) > 20 for sentence in refused)
    assert refused or mutation in (fuzz_frames.float_depth, fuzz_frames.flip_bytes)
