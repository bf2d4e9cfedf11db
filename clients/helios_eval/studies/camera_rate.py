"""Study of a detector process fed by a camera at its own rate: dropped frames, age of replies.

    python -m helios_eval.studies.camera_rate /work/shared/data/redkitchen \
        --detector onnx:/work/shared/models/yolox_nano.onnx --name mug \
        --at 1.80,0.715,0.80 --at 1.655,-0.265,0.785

Starts a router and a detector, and acts as the camera. First it streams: most frames may be dropped
for a newer one, and one per second is a keyframe. Then it sends every frame as a keyframe, each
after the reply to the last, and compares the median depth of an object's mask with the depth of the
object's true centre. Exit status 1 if a reply was older, or a mask was off more often, than the
limits allow.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import psutil
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.bus import Bus
from helios_core.codec import context_to_proto, frame_to_proto, observation_from_proto
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.geometry import project
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, OBSERVATION, PREVIEW
from helios_core.types import Frame, FrameId, Observation, Role, SearchClass, SearchContext
from helios_replay.rgbd_folder import read_dataset, read_image
from numpy.typing import NDArray

from helios_eval.service_under_test import ServiceProcess

ANSWER_WITHIN_S = 20.0
AGAIN_S = 2.0
KEYFRAME_PERIOD_S = 1.0
NEAR_BOX_PX = 8  # tolerance for the box, and for the registration of colour and depth
MARGIN_PX = 10  # a centre nearer to the image's edge is not in view
SETTLE_S = 1.0


@dataclass(frozen=True)
class Rate:
    """Statistics of one stream."""

    sent: int
    answered: int
    median_ms: float  # from sending a frame to its reply
    p95_ms: float
    oldest_ms: float
    older: int  # replies above the limit
    keyframes: int
    keyframes_answered_once: int
    detector_cores: float  # processor time of the detector per second
    load: float  # 1-minute load average of the machine

    @property
    def dropped_share(self) -> float:
        return 1 - self.answered / max(1, self.sent)


@dataclass(frozen=True)
class MaskDepthAgreement:
    """Agreement in depth of the masks with one true object."""

    at_m: tuple[float, float, float]  # its centre, world
    in_view: int  # frames with the centre in view
    found: int  # of these, with a detection on the centre
    within: int  # of these, with the mask's median depth near the true one

    @property
    def share(self) -> float:
        return self.within / self.found if self.found else 0.0


def rate_of(
    sent_s: dict[int, float],
    answered_s: dict[int, float],
    keyframes: Sequence[int],
    observed: Counter[int],
    limit_ms: float,
    cores: float,
) -> Rate:
    """Statistics of a stream from the times (s) of its frames and replies, by frame number."""
    ages_ms = np.array([(answered_s[n] - at) * 1e3 for n, at in sent_s.items() if n in answered_s])
    if not ages_ms.size:
        raise Unavailable("no frame of the stream was answered; look at the detector's log")
    return Rate(
        len(sent_s),
        len(ages_ms),
        float(np.median(ages_ms)),
        float(np.percentile(ages_ms, 95)),
        float(ages_ms.max()),
        int((ages_ms > limit_ms).sum()),
        len(keyframes),
        sum(observed[n] == 1 for n in keyframes),
        cores,
        os.getloadavg()[0],
    )


def middles_of(
    observations: Sequence[Observation], name: str, center_m: NDArray[np.float64], near_m: float
) -> MaskDepthAgreement:
    """Agreement of the masks of a class with one object; `center_m` [3] in the world."""
    in_view = found = within = 0
    for seen in observations:
        frame = seen.frame
        uv, z = project(center_m[None], frame.camera, frame.T_world_cam)
        (u, v), depth_m = uv[0], float(z[0])
        height, width = frame.depth_m.shape
        edge = MARGIN_PX
        if depth_m <= 0 or not (edge < u < width - edge and edge < v < height - edge):
            continue
        in_view += 1
        own = [
            d
            for d in seen.detections
            if d.class_name == name
            and d.box_xyxy[0] - NEAR_BOX_PX <= u <= d.box_xyxy[2] + NEAR_BOX_PX
            and d.box_xyxy[1] - NEAR_BOX_PX <= v <= d.box_xyxy[3] + NEAR_BOX_PX
        ]
        if not own:
            continue
        found += 1
        mask = max(own, key=lambda d: d.score).mask & (frame.depth_m > 0)
        within += bool(mask.any() and abs(np.median(frame.depth_m[mask]) - depth_m) < near_m)
    x, y, z = (float(c) for c in center_m)
    return MaskDepthAgreement((x, y, z), in_view, found, within)


class Camera:
    """Camera that sends frames and records the times of their replies (monotonic seconds)."""

    def __init__(self, bus: Bus, frames: list[pb.Frame]) -> None:
        self._bus, self._frames, self.number = bus, frames, 0
        self.sent_s: dict[int, float] = {}
        self.answered_s: dict[int, float] = {}
        self.keyframes: list[int] = []
        self.observed: Counter[int] = Counter()
        self.last: pb.Observation | None = None
        self._news = threading.Condition()
        bus.subscribe(PREVIEW, self._on_preview)
        bus.subscribe(OBSERVATION, self._on_observation)

    def stream(self, hz: float, seconds: float) -> None:
        """Send frames at a fixed rate; the first frame of each second is a keyframe."""
        every = max(1, round(hz * KEYFRAME_PERIOD_S))
        began = time.monotonic()
        for n in range(round(hz * seconds)):
            time.sleep(max(0.0, began + n / hz - time.monotonic()))
            self._send(self._frames[n % len(self._frames)], keyframe=n % every == 0)

    def meet(self, frame: pb.Frame) -> None:
        """Send keyframes until the detector replies; earlier frames are lost.

        Raises Unavailable.
        """
        deadline = time.monotonic() + ANSWER_WITHIN_S
        while not self._answered(self._send(frame, keyframe=True), AGAIN_S):
            if time.monotonic() > deadline:
                raise Unavailable(f"no keyframe was answered in {ANSWER_WITHIN_S:g} s")
        self.keyframes.clear()

    def answer_to(self, frame: pb.Frame) -> pb.Observation:
        """Send the frame as a keyframe; return the detector's observation. Raises Unavailable."""
        number = self._send(frame, keyframe=True)
        if not self._answered(number, ANSWER_WITHIN_S) or self.last is None:
            raise Unavailable(f"keyframe {number} was not answered in {ANSWER_WITHIN_S:g} s")
        return self.last

    def _answered(self, number: int, within_s: float) -> bool:
        with self._news:
            return self._news.wait_for(lambda: self.observed[number] > 0, within_s)

    def _send(self, frame: pb.Frame, keyframe: bool) -> int:
        self.number += 1
        frame.id.seq, frame.keyframe = self.number, keyframe
        if keyframe:
            self.keyframes.append(self.number)
        else:
            self.sent_s[self.number] = time.monotonic()
        self._bus.publish(KEYFRAME if keyframe else FRAME, frame)
        return self.number

    def _on_preview(self, preview: pb.Preview) -> None:
        self.answered_s[preview.id.seq] = time.monotonic()

    def _on_observation(self, observation: pb.Observation) -> None:
        with self._news:
            self.observed[observation.frame.id.seq] += 1
            self.last = observation
            self._news.notify_all()


def measure(given: argparse.Namespace) -> tuple[Rate, list[MaskDepthAgreement]]:
    """Run the study. Raises HeliosError if the data set, the model or a reply is missing."""
    frames = dataset_frames(given.dataset)
    context = SearchContext("camera-rate", (SearchClass(given.name, Role.OBJECT, given.threshold),))
    use_cores(given.cores)
    with tempfile.TemporaryDirectory() as folder:
        arguments = ("--detector", given.detector, "--threads", str(given.threads))
        processes = ServiceProcess("detector", arguments, Path(folder))
        bus = None
        try:
            bus = processes.bus()
            pid = processes.ready(bus)
            bus.publish(CONTEXT, context_to_proto(context))
            camera = Camera(bus, frames)
            camera.meet(frames[0])
            rate = _stream(camera, psutil.Process(pid), given)
            seen = [observation_from_proto(camera.answer_to(f)) for f in frames] if given.at else []
        finally:
            if bus is not None:
                bus.close()
            processes.close()
    return rate, [middles_of(seen, given.name, at, given.near_m) for at in given.at]


def _stream(camera: Camera, detector: psutil.Process, given: argparse.Namespace) -> Rate:
    before, began = detector.cpu_times(), time.monotonic()
    camera.stream(given.hz, given.seconds)
    after, took_s = detector.cpu_times(), time.monotonic() - began
    time.sleep(SETTLE_S)
    cores = (after.user + after.system - before.user - before.system) / took_s
    return rate_of(
        camera.sent_s, camera.answered_s, camera.keyframes, camera.observed, given.limit_ms, cores
    )


def use_cores(most: int) -> None:
    """Limit this process and its children to `most` cores; 0: all. Linux only."""
    if most and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:most])


def dataset_frames(folder: Path) -> list[pb.Frame]:
    """All images of a folder as frames of a camera."""
    data = read_dataset(folder)
    out = []
    for index, image in enumerate(data.images):
        color, depth_m = read_image(data, index)
        id, T = FrameId("camera", 0, index), image.T_world_cam
        frame = Frame(id, image.stamp_ns, False, color, depth_m, data.camera, T, np.eye(4))
        out.append(frame_to_proto(frame))
    return out


def _point(text: str) -> NDArray[np.float64]:
    point = np.array([float(part) for part in text.split(",")])
    if point.shape != (3,) or not np.isfinite(point).all():
        raise argparse.ArgumentTypeError(f"{text!r} is no point; write X,Y,Z in metres")
    return point


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.camera_rate",
        description="A camera at its own rate through a detector process: drops, ages, masks.",
    )
    parser.add_argument("dataset", type=Path, help="folder of posed RGB-D images")
    parser.add_argument("--detector", required=True, help="onnx:FILE, transformers:ID, …")
    parser.add_argument("--threads", type=int, default=1, help="of one model run")
    parser.add_argument("--name", default="mug", help="what is looked for")
    parser.add_argument("--threshold", type=float, default=0.25, help="of the detector")
    parser.add_argument(
        "--at",
        type=_point,
        action="append",
        default=[],
        metavar="X,Y,Z",
        help="true centre of such a thing, world, metres; may be repeated",
    )
    parser.add_argument("--near-m", type=float, default=0.07, help="a mask's middle counts within")
    parser.add_argument("--share", type=float, default=0.9, help="of the masks that must")
    parser.add_argument("--hz", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the stream")
    parser.add_argument("--limit-ms", type=float, default=100.0, help="oldest answer allowed")
    parser.add_argument("--cores", type=int, default=2, help="for all processes (Linux); 0: all")
    parser.add_argument("--json", type=Path, help="file for the figures")
    return parser


def main(argv: list[str] | None = None) -> int:
    given = _arguments().parse_args(argv)
    try:
        if not (given.hz > 0 and given.seconds > 0):
            raise InvalidInput("--hz and --seconds must be above 0")
        rate, middles = measure(given)
    except HeliosError as error:
        print(f"camera_rate: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput) else 1
    print(
        f"{given.hz:g} Hz: {rate.sent} frames sent, {rate.answered} answered, "
        f"{rate.dropped_share:.0%} dropped for a newer one\n"
        f"age of an answer: median {rate.median_ms:.0f} ms, 95 % {rate.p95_ms:.0f} ms, oldest "
        f"{rate.oldest_ms:.0f} ms; {rate.older} older than {given.limit_ms:g} ms\n"
        f"keyframes in between: {rate.keyframes_answered_once} of {rate.keyframes} answered once\n"
        f"the detector took {rate.detector_cores:.2f} cores; load of the machine {rate.load:.1f}"
    )
    for m in middles:
        print(
            f"{given.name} at {m.at_m}: found in {m.found} of {m.in_view} views; middle of the "
            f"mask within {given.near_m * 100:g} cm in depth in {m.within} ({m.share:.0%})"
        )
    if given.json:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        figures = asdict(rate) | {"dropped_share": rate.dropped_share}
        out = {"rate": figures, "middles": [asdict(m) | {"share": m.share} for m in middles]}
        write_file(given.json, json.dumps(out, indent=1) + "\n")
    good = rate.older == 0 and rate.keyframes_answered_once == rate.keyframes
    return 0 if good and all(m.share >= given.share for m in middles) else 1


if __name__ == "__main__":
    sys.exit(main())
