"""Mutated frames against real models; `fuzz_frames.py` makes the long runs."""

import random
from pathlib import Path

import fuzz_frames
import pytest
from detector_scene import frame_of
from helios_core.codec import frame_from_proto, frame_to_proto
from helios_core.errors import InvalidInput

YOLOX = Path(__file__).resolve().parents[4] / "shared" / "models" / "yolox_nano.onnx"


def test_300_mutated_frames_are_answered_or_refused(tmp_path: Path):
    counts = fuzz_frames.run(300, fuzz_frames.opened("", tmp_path), seed=1)
    assert counts["keyframes_refused"] > 100
    assert counts["keyframes_answered"] > 30
    assert counts["previews_refused"] == counts["keyframes_refused"]


@pytest.mark.skipif(not YOLOX.is_file(), reason=f"no model at {YOLOX}")
def test_300_mutated_frames_are_answered_or_refused_with_yolox(tmp_path: Path):
    pytest.importorskip("onnxruntime")
    counts = fuzz_frames.run(300, fuzz_frames.opened(f"onnx:{YOLOX}", tmp_path), seed=2)
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
