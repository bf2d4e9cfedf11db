"""Real processes: the system reports what the detector waits for, and its metrics."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import outside_package
import pytest
from detector_scene import context_of, frame_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, description_to_proto, frame_to_proto
from helios_core.errors import Unavailable
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, ROBOT_DESCRIPTION, VOCABULARY
from helios_core.types import RobotDescription
from helios_core.zenoh_bus import ZenohBus

from tests.support import free_port, wait_until


class Rig:
    """A router, a gateway and a detector."""

    def __init__(self, folder: Path) -> None:
        self.endpoint, self.port = f"tcp/127.0.0.1:{free_port()}", free_port()
        outside = str(outside_package.write(folder / "outside"))
        self._env = os.environ | {"PYTHONPATH": outside}
        self.processes = [
            self.start("helios_core.router", "--listen", self.endpoint),
            self.start("helios_gateway", "--router", self.endpoint, "--port", str(self.port)),
        ]

    def start(self, module: str, *argv: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-m", module, *argv], env=self._env)

    def detector(self, *argv: str) -> subprocess.Popen[bytes]:
        process = self.start("helios_detector", "--router", self.endpoint, *argv)
        self.processes.append(process)
        return process

    def get(self, path: str) -> httpx.Response | None:
        try:
            return httpx.get(f"http://127.0.0.1:{self.port}{path}", timeout=20)
        except httpx.TransportError:
            return None

    def said_by(self, path: str) -> str:
        answer = self.get(path)
        return answer.text if answer is not None else ""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    out = Rig(tmp_path)
    yield out
    for process in reversed(out.processes):
        process.kill()
        process.wait()


@pytest.mark.timeout(240)
def test_gateway_and_bus_report_a_missing_model_and_later_the_detectors_metrics(
    rig: Rig, tmp_path: Path
):
    missing = rig.detector("--detector", f"onnx:{tmp_path / 'model.onnx'}", "--retry-s", "0.2")
    sentence = "model.onnx is not there; put a YOLOX model (ONNX)"
    wait_until(lambda: sentence in rig.said_by("/readyz"), 60, "/readyz says so")
    ready = rig.get("/readyz")
    assert ready is not None
    assert ready.status_code == 503
    assert any(r.startswith("detector is waiting: ") for r in ready.json()["reasons"])
    status = rig.get("/v1/status")  # shown by the dashboard and `helios status`
    assert status is not None
    row = next(s for s in status.json()["services"] if s["name"] == "detector")
    assert row["state"] == "waiting"
    assert sentence in row["reason"]

    bus = ZenohBus(rig.endpoint)
    try:
        # A caller of the detector, like the planner before a task, gets the same reason.
        with pytest.raises(Unavailable, match=r"the detector is not ready: .*put a YOLOX model"):
            bus.call(VOCABULARY, pb.Empty(), 5.0)
        missing.kill()
        missing.wait()

        rig.detector("--detector", "patient:0.01", "--scorer", "half:1.5")
        robot = RobotDescription("r", 0.2, 1.3, frame_of().camera, 1.2, 0.8, 4.0)
        bus.publish(ROBOT_DESCRIPTION, description_to_proto(robot))
        bus.publish(CONTEXT, context_to_proto(context_of("mug")))

        def figures() -> bool:
            bus.publish(KEYFRAME, frame_to_proto(frame_of()))
            bus.publish(FRAME, frame_to_proto(frame_of()))
            text = rig.said_by("/metrics")
            return all(f'name="{name}"' in text for name in NAMES)

        wait_until(figures, 60, "time and memory per frame are in /metrics")
        lines = [x for x in rig.said_by("/metrics").splitlines() if 'service="detector"' in x]
        values = {
            x.split('name="')[1].split('"')[0]: float(x.split()[-1]) for x in lines if 'name="' in x
        }
        assert values["detect_ms_median"] >= 10
        assert values["memory_mb"] > 20
    finally:
        bus.close()


NAMES = (
    "detect_ms_median",
    "score_ms_median",
    "preview_ms_median",
    "memory_mb",
    "keyframes_answered",
)
