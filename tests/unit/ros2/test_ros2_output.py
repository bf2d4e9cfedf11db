"""The output process: services that fall silent, and its own end while a map does not answer."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import Any

import helios_ros2.output_service
import pytest
from helios_core import proto as pb
from helios_core.health import Health
from helios_core.signal_handling import STOP_WITHIN_S
from helios_ros2.output_service import OutputService
from helios_ros2.ros_messages import SILENT_AFTER_S
from helios_ros2.ros_node import CLOSE_WITHIN_S

OK, ERROR, STALE = 0, 2, 3  # of diagnostic_msgs/msg/DiagnosticStatus


def message(**fields: Any) -> SimpleNamespace:
    """Stands for a ROS message."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id="")
    return SimpleNamespace(header=header, status=[], **fields)


class Output:
    """The output without its node and its threads."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("helios_ros2.ros_messages.interface", lambda _name: message)
        self.now_s, self.sent, self.closed = 0.0, list[Any](), list[str]()
        clock = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(helios_ros2.output_service, "time", clock)
        self.service = service = OutputService.__new__(OutputService)
        service._ending, service._health, service._statuses = threading.Event(), Health(), {}
        service._diagnostics = SimpleNamespace(publish=self.sent.append)
        ros: Any = SimpleNamespace(now_ns=lambda: 5, close=lambda: self.closed.append("ros"))
        tasks: Any = SimpleNamespace(close=lambda: self.closed.append("tasks"))
        service._ros, service._tasks = ros, tasks

    def levels(self) -> dict[str, tuple[int, str]]:
        """Level and message of each service, as /diagnostics has them now."""
        self.service._publish_diagnostics()
        return {one.name: (one.level[0], one.message) for one in self.sent[-1].status}


def test_a_service_that_falls_silent_is_stale_until_it_reports_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    output = Output(monkeypatch)
    maps, objects = "helios: map2d", "helios: objectmap"
    ready = pb.ServiceStatus(service="objectmap", state="ready")
    output.service._on_status(pb.ServiceStatus(service="map2d", state="degraded", reason="slow"))
    output.service._on_status(ready)
    assert output.levels() == {maps: (ERROR, "slow"), objects: (OK, "ready")}
    output.now_s = SILENT_AFTER_S + 2
    output.service._on_status(pb.ServiceStatus(service="map2d", state="ready"))
    assert output.levels() == {
        maps: (OK, "ready"),
        objects: (STALE, "silent for 7 s; it said last: ready"),
    }
    output.service._on_status(ready)
    assert output.levels()[objects] == (OK, "ready")


def test_the_end_does_not_wait_for_the_answer_of_a_map(monkeypatch: pytest.MonkeyPatch) -> None:
    output, answer = Output(monkeypatch), threading.Event()
    output.service._thread = threading.Thread(target=answer.wait, daemon=True)
    output.service._thread.start()
    began_s = time.monotonic()
    output.service.close()
    assert time.monotonic() - began_s < STOP_WITHIN_S - CLOSE_WITHIN_S
    assert output.closed == ["tasks", "ros"]
    answer.set()
