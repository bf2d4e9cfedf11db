"""Study of a recording with a camera at its own rate and all services active: lost frames.

    python -m helios_eval.studies.recording_rate /work/shared/data/redkitchen \
        --detector onnx:/work/shared/models/yolox_nano.onnx --name mug

Starts a router, detector, both maps and the recorder, and acts as the camera: a stream with one
keyframe per second. Then it reads the file. Exit status 1 if a frame is missing.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.codec import context_to_proto
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.topics import CONTEXT, status_topic
from helios_core.types import Role, SearchClass, SearchContext
from mcap.reader import make_reader

from helios_eval.service_under_test import ServiceProcess
from helios_eval.studies.camera_rate import Camera, dataset_frames, use_cores

BESIDE = ("objectmap", "map2d", "detector")
COUNTERS = ("dropped_frames", "dropped_messages", "missed_frames")
SAID_WITHIN_S = 20.0
STREAM, KEYFRAMES = "/bridge/frame", "/bridge/keyframe"


@dataclass(frozen=True)
class Recorded:
    """Result of one stream."""

    hz: float
    sent: int
    recorded: int  # frames of the stream in the file
    keyframes: int
    keyframes_recorded: int
    dropped: dict[str, float]  # counters of the recorder
    mb: float
    recorder_cores: float  # processor time of the recorder per second
    messages: dict[str, int]  # messages in the file by channel

    @property
    def whole(self) -> bool:
        everything = self.recorded == self.sent and self.keyframes_recorded == self.keyframes
        counted = all(self.dropped.get(name) == 0 for name in COUNTERS)
        return everything and counted


def measure(given: argparse.Namespace) -> Recorded:
    """Run the study. Raises HeliosError if the data set, the model or a service is missing."""
    frames = dataset_frames(given.dataset)
    context = SearchContext("recording-rate", (SearchClass(given.name, Role.OBJECT, 0.25),))
    use_cores(given.cores)
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        processes = ServiceProcess("recorder", ("--out", str(folder / "out")), folder)
        for name in BESIDE:
            own = ("--detector", given.detector) if name == "detector" else ()
            processes.add(name, own)
        bus = None
        try:
            bus = processes.bus()
            pid = processes.ready(bus)
            for name in BESIDE:
                processes.ready(bus, name)
            said: list[pb.ServiceStatus] = []
            bus.subscribe(status_topic("recorder"), said.append)
            bus.publish(CONTEXT, context_to_proto(context))
            camera = Camera(bus, frames)
            camera.meet(frames[0])
            recorder = psutil.Process(pid)
            before, began = recorder.cpu_times(), time.monotonic()
            camera.stream(given.hz, given.seconds)
            after, took_s = recorder.cpu_times(), time.monotonic() - began
            cores = (after.user + after.system - before.user - before.system) / took_s
            counted = _counted(said)
        finally:
            if bus is not None:
                bus.close()
            processes.close()
        [file] = sorted((folder / "out").rglob("*.mcap"))
        mb = file.stat().st_size / 1e6
        numbers, messages = _in_file(file)
    return Recorded(
        given.hz,
        len(camera.sent_s),
        sum(n in numbers[STREAM] for n in camera.sent_s),
        len(camera.keyframes),
        sum(n in numbers[KEYFRAMES] for n in camera.keyframes),
        counted,
        round(mb, 1),
        round(cores, 2),
        messages,
    )


def _counted(said: Sequence[pb.ServiceStatus]) -> dict[str, float]:
    """Counters of the recorder in its second status from now, which covers the whole stream."""
    until, deadline = len(said) + 2, time.monotonic() + SAID_WITHIN_S
    while len(said) < until:
        if time.monotonic() > deadline:
            raise Unavailable(f"the recorder told no status for {SAID_WITHIN_S:g} s")
        time.sleep(0.1)
    metrics = said[-1].metrics
    return {name: metrics[name] for name in COUNTERS if name in metrics}


def _in_file(file: Path) -> tuple[dict[str, set[int]], dict[str, int]]:
    """Frame numbers in a recording by channel, and the number of messages by channel."""
    numbers: dict[str, set[int]] = {STREAM: set(), KEYFRAMES: set()}
    messages: Counter[str] = Counter()
    with file.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            messages[channel.topic] += 1
            if channel.topic in numbers:
                numbers[channel.topic].add(pb.Frame.FromString(message.data).id.seq)
    return numbers, dict(messages)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.recording_rate",
        description="A camera at its own rate into a recording, with everything else going on.",
    )
    parser.add_argument("dataset", type=Path, help="folder of posed RGB-D images")
    parser.add_argument("--detector", required=True, help="onnx:FILE, transformers:ID, …")
    parser.add_argument("--name", default="mug", help="what is looked for")
    parser.add_argument("--hz", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the stream")
    parser.add_argument("--cores", type=int, default=2, help="for all processes (Linux); 0: all")
    parser.add_argument("--json", type=Path, help="file for the figures")
    given = parser.parse_args(argv)
    try:
        if not (given.hz > 0 and given.seconds > 0):
            raise InvalidInput("--hz and --seconds must be above 0")
        r = measure(given)
    except HeliosError as error:
        print(f"recording_rate: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput) else 1
    counted = ", ".join(f"{name.replace('_', ' ')} {n:g}" for name, n in r.dropped.items())
    print(
        f"{r.hz:g} Hz: {r.recorded} of {r.sent} frames and {r.keyframes_recorded} of {r.keyframes} "
        f"keyframes are in the recording ({r.mb:g} MB)\n"
        f"the recorder counts: {counted}\n"
        f"it took {r.recorder_cores:.2f} cores\n"
        f"messages: {', '.join(f'{n} {name}' for name, n in sorted(r.messages.items()))}"
    )
    if given.json:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        write_file(given.json, json.dumps(asdict(r), indent=1) + "\n")
    return 0 if r.whole else 1


if __name__ == "__main__":
    sys.exit(main())
