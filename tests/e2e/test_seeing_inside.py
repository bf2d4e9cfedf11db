"""Traces, faults and log lines through real processes with the simulated robot."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from helios_client.cli import run
from helios_client.trace_chain import Span, TraceTree
from helios_gateway.faults.box_file import METADATA
from helios_replay.format_detection import open_source
from helios_viewers.recorded_source import RecordedSource
from mcap.reader import make_reader

from tests.helios_up import Up, helios_up
from tests.otlp_collector import Collector
from tests.support import LOOPBACK, wait_until

pytest.importorskip("opentelemetry.sdk.trace", reason="extra tracing is missing")
pytestmark = pytest.mark.timeout(420)

TRACE, PARENT = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"
TRACEPARENT = f"00-{TRACE}-{PARENT}-01"  # of the program that submits the task
ENDED = ("succeeded", "failed", "cancelled")
# Each step of a traced task, as parent -> child, with the services that do it.
STEP = {
    ("planner", "action"): ("bridge", "bridge/act"),
    ("bridge", "bridge/act"): ("bridge", "keyframe"),
    ("bridge", "keyframe"): ("detector", "detection"),
    ("detector", "detection"): ("objectmap", "update of objects"),
}


class Running:
    """A running `helios up --tracing --log-format json` that exports to a collector."""

    def __init__(self, up: Up, collector: Collector) -> None:
        self.up, self.port, self.collector = up, str(up.port), collector

    def get(self, path: str) -> Any:
        answer = LOOPBACK.get(f"{self.up.address}{path}", timeout=30)
        answer.raise_for_status()
        return answer.json()

    def task(self, instruction: str, max_steps: int) -> dict[str, Any]:
        """Submit a task within `TRACEPARENT`, and return it when it has ended."""
        body = {"instruction": instruction, "max_steps": max_steps}
        answer = LOOPBACK.post(
            f"{self.up.address}/v1/tasks",
            json=body,
            headers={"traceparent": TRACEPARENT},
            timeout=30,
        )
        answer.raise_for_status()
        path = f"/v1/tasks/{answer.json()['id']}"
        wait_until(lambda: self.get(path)["state"] in ENDED, 180, "the task has ended")
        return self.get(path)

    def pid(self, name: str) -> int:
        services = self.get("/v1/status")["services"]
        return next(s["pid"] for s in services if s["name"] == name)

    def fault(self, id: str) -> dict[str, Any]:
        return next((f for f in self.get("/v1/faults")["faults"] if f["id"] == id), {})


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    flags = ("--robot", "sim", "--seed", "1", "--detector", "ground-truth", "--tracing",
             "--log-format", "json")  # fmt: skip
    with ExitStack() as stack:
        collector = Collector()
        stack.callback(collector.close)
        variables = {
            "OTEL_EXPORTER_OTLP_ENDPOINT": collector.endpoint,
            "OTEL_BSP_SCHEDULE_DELAY": "500",
        }
        state = tmp_path_factory.mktemp("state")
        up = stack.enter_context(helios_up(state, *flags, environment=variables))
        wait_until(up.ready, 300, "all services are ready")
        yield Running(up, collector)


@pytest.fixture(scope="module")
def failed(running: Running) -> dict[str, Any]:
    """A task that failed, because it had too few steps."""
    return running.task("find the can", max_steps=45)


def test_a_trace_leads_from_the_request_to_the_maps(
    running: Running, failed: dict[str, Any]
) -> None:
    trace = running.get(f"/v1/tasks/{failed['id']}/trace")
    assert trace["trace_id"] == failed["trace_id"] == TRACE
    assert not [s for s in trace["sources"] if s["note"]]
    spans = {span["id"]: span for span in trace["spans"]}
    found = {
        ((p["service"], p["name"]), (s["service"], s["name"]))
        for s in spans.values()
        if (p := spans.get(s["parent_id"])) is not None
    }
    assert found >= set(STEP.items())
    (root,) = (s for s in spans.values() if s["parent_id"] == PARENT)
    assert (root["service"], root["name"]) == ("gateway", "POST /v1/tasks")
    (task,) = (s for s in spans.values() if s["name"] == "task")
    assert spans[task["parent_id"]]["name"] == "planner/submit"
    tree = TraceTree(map(Span.from_json, trace["spans"]))
    assert len(tree.steps) == failed["steps"]
    decisions = [s for s in spans.values() if s["name"] == "decision"]
    assert decisions
    for span in decisions:
        assert spans[span["parent_id"]]["name"] == "task"
        assert span["attributes"].keys() >= {"helios.decision", "rule", "do"}
    keyframes = {s["attributes"].get("helios.keyframe") for s in spans.values()} - {None}
    assert len(keyframes) >= failed["steps"]


def test_every_service_exports_its_spans(running: Running, failed: dict[str, Any]) -> None:
    wanted = {"POST /v1/tasks", "task", *(name for _, name in STEP)}
    collector = running.collector
    wait_until(lambda: collector.spans().keys() >= wanted, 60, "all spans are exported")
    for service, name in STEP:
        exporter, span = collector.spans()[name]
        assert exporter == f"helios-{service}"
        assert span.trace_id.hex() == TRACE


def test_why_prints_the_slowest_chain(
    running: Running, failed: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["why", failed["id"], "--trace", "--port", running.port]) == 0
    said = capsys.readouterr().out
    assert "slowest chain: step" in said
    assert "update of objects" in said
    assert run(["why", failed["id"], "--trace", "--json", "--port", running.port]) == 0
    out = json.loads(capsys.readouterr().out)
    links, whole_s = out["slowest"]["chain"], out["slowest"]["took_s"]
    assert sum(link["took_s"] for link in links) == pytest.approx(whole_s, abs=1e-3)
    assert {"action", "bridge/act"} <= {link["name"] for link in links}


def test_a_failed_task_names_a_recording_of_the_time_around_it(
    running: Running, failed: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert failed["state"] == "failed"
    (name,) = failed["recordings"]
    fault = running.fault("task-step-budget")
    assert (fault["state"], fault["recordings"]) == ("confirmed", [name])
    wait_until(
        lambda: running.get("/v1/faults")["recordings"][0]["bytes"], 60, "the recording is made"
    )
    assert run(["faults", "--port", running.port]) == 0
    assert name in capsys.readouterr().out
    assert run(["faults", "--save", name, "--out", str(tmp_path), "--port", running.port]) == 0
    with (tmp_path / name).open("rb") as file:
        reader = make_reader(file)
        topics = {channel.topic for _, channel, _ in reader.iter_messages()}
        (about,) = (m.metadata for m in reader.iter_metadata() if m.name == METADATA)
    assert about["task"] == failed["id"]
    assert set(RecordedSource(tmp_path / name).channels) <= topics  # for viewers
    open_source(tmp_path / name)  # for a replay; raises without a keyframe
    assert topics >= {
        "/bridge/keyframe",
        "/camera/keyframe/color",
        "/camera/keyframe/depth",
        "/detector/observation",
        "/planner/task",
        "/objectmap/ack",
        "/bridge/status",
        "/supervisor/processes",
        "/planner/context",
        "/bridge/description",
    }


def test_log_lines_are_json_with_the_ids_of_their_work(
    running: Running, failed: dict[str, Any]
) -> None:
    lines = (running.up.state / "logs/planner.log").read_text().splitlines()
    logged = [json.loads(line) for line in lines if line.startswith("{")]
    of_task = [line for line in logged if line.get("task") == failed["id"]]
    assert any("failed" in line["message"] for line in of_task)
    assert {line["trace_id"] for line in of_task} == {failed["trace_id"]}


def test_a_killed_service_is_a_fault_until_it_has_run_for_a_while(running: Running) -> None:
    os.kill(running.pid("map2d"), signal.SIGKILL)
    wait_until(lambda: running.fault("map2d-restarted"), 60, "the restart is a fault")
    fault = running.fault("map2d-restarted")
    assert (fault["state"], fault["count"]) == ("confirmed", 1)
    assert fault["message"] == "ended by SIGKILL; last log line: ready"
    assert fault["recordings"]


def test_a_fault_of_a_task_can_be_cleared_and_others_are_named(
    running: Running, failed: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["faults", "--clear", "task-step-budget", "--port", running.port]) == 0
    assert running.fault("task-step-budget")["state"] == "cleared"
    assert run(["faults", "--clear", "mug", "--port", running.port]) == 2
    assert "there is no fault 'mug'" in capsys.readouterr().err
