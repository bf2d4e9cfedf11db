"""The detector as a process over the router, with a model from a folder."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import tiny_models
from detector_scene import context_of, frame_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, status_topic
from helios_core.zenoh_bus import ZenohBus

from tests.support import free_port, wait_until


def test_the_process_reports_a_missing_model_then_answers_and_ends_at_sigterm(tmp_path: Path):
    port = free_port()
    endpoint, model = f"tcp/127.0.0.1:{port}", tmp_path / "model"
    router = subprocess.Popen(
        [sys.executable, "-m", "helios_core.router", "--listen", endpoint],
    )
    detector = subprocess.Popen(
        [sys.executable, "-m", "helios_detector", "--router", endpoint, "--device", "cpu",
         "--detector", f"transformers:{model}", "--retry-s", "0.2"],
    )  # fmt: skip
    bus = None
    try:
        wait_until(lambda: connects(endpoint), 60, "the router answers")
        bus = ZenohBus(endpoint, "robot")
        states: list[pb.ServiceStatus] = []
        seen: list[pb.Observation] = []
        bus.subscribe(status_topic("detector"), states.append)
        bus.subscribe(OBSERVATION, seen.append)
        wait_until(
            lambda: any("is not there; put config.json" in s.reason for s in states),
            60,
            "it says what is missing",
        )
        assert states[-1].state == "waiting"
        model.symlink_to(tiny_models.write("owlv2", tmp_path / "owl"))
        wait_until(lambda: states[-1].state == "ready", 60, "the model works")
        bus.publish(CONTEXT, context_to_proto(context_of("mug", threshold=0.01)))
        reported_s = 0.0

        def answered() -> bool:
            """Repeats the keyframe until an answer comes, as the bridge does: one sent before its
            subscriber is known is lost."""
            nonlocal reported_s
            if time.monotonic() - reported_s > 1:
                reported_s = time.monotonic()
                bus.publish(KEYFRAME, frame_to_proto(frame_of()))
            return bool(seen)

        wait_until(answered, 60, "the keyframe is answered")
        assert seen[0].detections
        wait_until(lambda: states[-1].metrics.get("memory_mb", 0) > 50, 60, "its figures are told")
        detector.send_signal(signal.SIGTERM)
        assert detector.wait(30) == 0
    finally:
        if bus is not None:
            bus.close()
        for process in (detector, router):
            if process.poll() is None:
                process.kill()
            process.wait()


def connects(endpoint: str) -> bool:
    from helios_core.errors import Unavailable

    try:
        ZenohBus(endpoint, "robot").close()
    except Unavailable:
        return False
    return True
