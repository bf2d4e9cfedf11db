"""Mutated frames against the detector service with a real model: nothing may end it.

    .venv/bin/python tests/unit/detector/fuzz_frames.py --frames 10000 --detector onnx:yolox.onnx
    .venv/bin/python tests/unit/detector/fuzz_frames.py --frames 10000    # a tiny OWLv2

Each frame is handled as a keyframe and as a stream frame; it must be answered or refused with a
typed error and a counter. `keyframes_failed` counts faults inside the service and must stay 0. A
good frame is answered after every hundred.
"""

from __future__ import annotations

import argparse
import copy
import logging
import random
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))

from detector_scene import context_of, frame_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import OBSERVATION, PREVIEW
from helios_detector.backend import DetectorBackend, DetectorOptions
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.memory_usage import resident_mb
from helios_detector.model_loading import open_detector
from helios_detector.service import DetectorService

NUMBERS = (0.0, -0.0, -1.0, 1e-300, 1e300, float("nan"), float("inf"), -float("inf"), 1e9)
SIZES = (0, 1, 2, 3, 10_000, 65_535, 2**31, 2**32 - 1)
Mutation = Callable[[pb.Frame, random.Random], None]


def compressed(frame: pb.Frame) -> pb.Frame:
    """The same frame with JPEG colour and PNG depth."""
    out, made = copy.deepcopy(frame), frame_of()
    out.compressed_color.format, out.compressed_depth.format = "jpeg", "png"
    out.compressed_color.data = cv2.imencode(".jpg", made.color)[1].tobytes()
    mm = np.rint(made.depth_m * 1000).astype(np.uint16)
    out.compressed_depth.data = cv2.imencode(".png", mm)[1].tobytes()
    return out


def _images(frame: pb.Frame) -> list:
    names = ("raw_color", "raw_depth", "compressed_color", "compressed_depth")
    return [getattr(frame, n) for n in names if frame.HasField(n)]


def flip_bytes(frame: pb.Frame, rng: random.Random) -> None:
    image = rng.choice(_images(frame))
    data = bytearray(image.data)
    for _ in range(rng.randint(1, 40)):
        data[rng.randrange(min(len(data), rng.choice((64, 1024, len(data)))))] = rng.randrange(256)
    image.data = bytes(data)


def cut(frame: pb.Frame, rng: random.Random) -> None:
    image = rng.choice(_images(frame))
    image.data = image.data[: rng.randrange(len(image.data))]


def lengthen(frame: pb.Frame, rng: random.Random) -> None:
    image = rng.choice(_images(frame))
    image.data = image.data + rng.randbytes(rng.randint(1, 500))


def bomb(frame: pb.Frame, rng: random.Random) -> None:
    """A header that claims up to gigapixels."""
    image = rng.choice(_images(frame))
    if hasattr(image, "width"):
        image.width, image.height = rng.choice(SIZES), rng.choice(SIZES)
        return
    data = bytearray(image.data)
    at = 16 if data[:4] == b"\x89PNG" else data.find(b"\xff\xc0") + 5
    size = struct.pack(">II" if at == 16 else ">HH", *(rng.choice((1, 10_000, 65_535)),) * 2)
    data[at : at + len(size)] = size
    image.data = bytes(data)


@cache
def giant_png() -> bytes:
    """A valid image of 100 megapixels in a few hundred kilobytes."""
    return cv2.imencode(".png", np.zeros((10_000, 10_000), np.uint8))[1].tobytes()


def giant(frame: pb.Frame, rng: random.Random) -> None:
    frame.ClearField("raw_color")
    frame.compressed_color.format, frame.compressed_color.data = "png", giant_png()


def encoding(frame: pb.Frame, rng: random.Random) -> None:
    name = rng.choice(("", "yuv", "rgb8", "16UC1", "32FC1", "bgr8", "\x00", "jpeg", "png"))
    image = rng.choice(_images(frame))
    if hasattr(image, "encoding"):
        image.encoding = name
    else:
        image.format = name


def float_depth(frame: pb.Frame, rng: random.Random) -> None:
    """Depth as floats with NaN, infinite, negative and huge values."""
    depth_m = frame_of().depth_m.copy()
    for _ in range(20):
        y, x = rng.randrange(240), rng.randrange(320)
        with np.errstate(over="ignore"):
            depth_m[y : y + 30, x : x + 30] = rng.choice(NUMBERS)
    frame.raw_depth.CopyFrom(frame_to_proto(frame_of()).raw_depth)
    frame.raw_depth.encoding, frame.raw_depth.step = "32FC1", 4 * 320
    frame.raw_depth.data = depth_m.astype("<f4").tobytes()


def calibration(frame: pb.Frame, rng: random.Random) -> None:
    if rng.random() < 0.3:
        del frame.calibration.K[rng.randrange(9) :]
    elif len(frame.calibration.K) == 9 and rng.random() < 0.5:
        frame.calibration.K[rng.randrange(9)] = rng.choice(NUMBERS)
    else:
        frame.calibration.width = rng.choice(SIZES)


def pose(frame: pb.Frame, rng: random.Random) -> None:
    which = rng.choice((frame.T_world_cam, frame.T_world_base)).pose
    part = rng.choice((which.position, which.orientation))
    setattr(part, rng.choice("xyz"), rng.choice(NUMBERS))


def stamp(frame: pb.Frame, rng: random.Random) -> None:
    frame.stamp.seconds = rng.choice((0, -(2**63), 2**63 - 1, 9_000_000_001))
    frame.stamp.nanos = rng.choice((0, -1, 2**31 - 1))


def drop_field(frame: pb.Frame, rng: random.Random) -> None:
    names = [field.name for field, _ in frame.ListFields()]
    frame.ClearField(rng.choice(names))


def swap(frame: pb.Frame, rng: random.Random) -> None:
    """Colour in place of depth, or depth in place of colour."""
    if frame.HasField("raw_color") and frame.HasField("raw_depth"):
        frame.raw_color.CopyFrom(frame.raw_depth)
    elif frame.HasField("compressed_depth") and frame.HasField("compressed_color"):
        frame.compressed_depth.CopyFrom(frame.compressed_color)


MUTATIONS: tuple[Mutation, ...] = (
    flip_bytes, cut, lengthen, bomb, giant, encoding, float_depth, calibration, pose, stamp,
    drop_field, swap,
)  # fmt: skip


def run(frames: int, detector: DetectorBackend, seed: int = 0) -> Counter[str]:
    """The service's counters after `frames` mutated ones. Raises AssertionError on a lost frame."""
    rng, health, hub = random.Random(seed), Health(), MemoryHub()
    service = DetectorService(MemoryBus(hub), detector, LexicalScorer(), health)
    out: Counter[str] = Counter()
    listener = MemoryBus(hub)
    listener.subscribe(OBSERVATION, lambda _: out.update(["observations"]))
    listener.subscribe(PREVIEW, lambda _: out.update(["previews"]))
    service.on_context(context_to_proto(context_of("mug", "dining table", threshold=0.01)))
    raw = frame_to_proto(frame_of())
    goods = (raw, compressed(raw))
    for n in range(frames):
        frame = copy.deepcopy(rng.choice(goods))
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            images = [i for i in _images(frame) if len(i.data)]
            if len(images) == 2:
                rng.choice(MUTATIONS)(frame, rng)
        service.on_keyframe(frame)
        service.on_frame(frame)
        if n % 100 == 99:
            before = out["observations"]
            service.on_keyframe(rng.choice(goods))
            assert out["observations"] == before + 1, f"a good frame after {n} bad ones was lost"
            assert health.state[0] == "ready", health.state
    counts = {k: int(v) for k, v in health.metrics().items() if k.startswith(("key", "prev"))}
    handled = counts.get("keyframes_answered", 0) + counts.get("keyframes_refused", 0)
    assert handled == frames + frames // 100, counts
    assert not counts.get("keyframes_failed"), counts
    return Counter(counts)


def opened(spec: str, folder: Path) -> DetectorBackend:
    """The detector of a setting; a tiny OWLv2 with random weights if the setting is empty."""
    if not spec:
        import tiny_models

        spec = f"transformers:{tiny_models.write('owlv2', folder)}"
    detector = open_detector(spec, DetectorOptions(device="cpu"))
    detector.warm_up()
    return detector


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--detector", default="", help="onnx:FILE, transformers:ID")
    args = parser.parse_args()
    logging.disable(logging.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        detector = opened(args.detector, Path(folder))
        began, before_mb = time.perf_counter(), resident_mb()
        counts = run(args.frames, detector, args.seed)
    print(
        f"{detector.name}: {args.frames} frames in {time.perf_counter() - began:.0f} s, "
        f"{resident_mb() - before_mb:+.0f} MB, {dict(counts)}"
    )


if __name__ == "__main__":
    main()
