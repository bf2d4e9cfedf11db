"""The whole stack under TLS and generated access rules: it does a task, and nothing beyond."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_client.cli import run
from helios_core import proto as pb
from helios_core.bus_access import access_of
from helios_core.errors import Unavailable
from helios_core.router_link import RouterLink
from helios_core.topics import CLEAR_STOP, GET_STATE, STOP, TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.helios_up import Up, helios_up
from tests.support import LOOPBACK, wait_until

pytestmark = pytest.mark.timeout(420)
RECORDER = Path(__file__).parents[1] / "bus_recorder"
MODULES = {
    "helios_sim": "world",
    "helios_bridge": "bridge",
    "helios_detector": "detector",
    "helios_objectmap": "objectmap",
    "helios_map2d": "map2d",
    "helios_planner": "planner",
    "helios_gateway": "gateway",
    "helios_recorder": "recorder",
    "helios_client": "supervisor",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("made")
    (out / "bus").mkdir()
    flags = ["--simulation", "--operators", "ann"]
    assert run(["certs", "init", str(out / "certs"), *flags]) == 0
    return out


@pytest.fixture(scope="module")
def stack(folder: Path) -> Iterator[Up]:
    environment = {
        "HELIOS_TEST_BUS_FOLDER": str(folder / "bus"),
        "HELIOS_FORK": "0",  # the recorder names its file after the command line
        "PYTHONPATH": os.pathsep.join([str(RECORDER), os.environ.get("PYTHONPATH", "")]),
    }
    flags = ["--seed", "1", "--detector", "ground-truth", "--record", "--tracing"]
    flags += ["--certs", str(folder / "certs")]
    with helios_up(folder / "state", *flags, environment=environment) as up:
        wait_until(up.ready, 180, "all services are ready")
        yield up


def link(folder: Path, stack: Up, name: str) -> RouterLink:
    endpoint = f"tls/127.0.0.1:{stack.router_port}"
    return RouterLink(endpoint, folder / "certs" / "sessions" / f"{name}.json5")


def test_a_task_succeeds_and_each_service_does_only_what_the_table_allows(
    stack: Up, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = ["--port", str(stack.port), "--json"]
    assert run(["task", "find the table", *flags]) == 0
    assert run(["stop", *flags]) == 0
    assert run(["clear-stop", *flags]) == 0
    assert run(["objects", *flags]) == 0
    capsys.readouterr()
    done: dict[str, set[str]] = {}
    for file in (folder / "bus").iterdir():
        service = MODULES[file.name.partition(".")[0]]
        done.setdefault(service, set()).update(file.read_text().splitlines())
    assert done.keys() == set(MODULES.values())
    for service, lines in done.items():
        assert lines - allowed(service) == set(), service
    # What the table lets a service hear and serve is what it does here, but for `ELSEWHERE`.
    unused = {
        (service, line)
        for service, lines in done.items()
        for line in allowed(service) - lines
        if line.startswith(("subscribe", "serve", "watch"))
    }
    assert unused == {(s, line) for s, lines in ELSEWHERE.items() for line in lines}


# What other drivers, agents and settings need.
ELSEWHERE = {
    "bridge": ("subscribe helios/v1/robot/*/status", "watch robot"),
    "detector": (
        "subscribe helios/v1/robot/detector/claim",
        "subscribe helios/v1/robot/objectmap/ack",
    ),
    "map2d": ("subscribe helios/v1/robot/bridge/frame",),
    "planner": ("subscribe helios/v1/robot/detector/observation",),
    "supervisor": ("subscribe helios/v1/robot/ros2/status",),
}


def allowed(service: str) -> set[str]:
    """Lines of the recorder that the table allows."""
    access = access_of(service, simulated=True)
    lines = {f"put {topic.key('robot')}" for topic in access.publishes}
    lines |= {f"subscribe {topic.key('robot')}" for topic in access.subscribes}
    lines |= {f"serve {method.key('robot')}" for method in access.serves}
    lines |= {f"call {method.key('robot')}" for method in access.calls}
    lines |= {f"announce robot {name}" for name in access.announces}
    return lines | ({"watch robot"} if access.watches else set())


def test_the_task_is_in_the_record_of_changes(stack: Up) -> None:
    answer = LOOPBACK.post(f"{stack.address}/v1/robot/stop", json={"reason": "for the record"})
    assert answer.status_code == 200
    file = stack.state / "audit.jsonl"

    def stops() -> list[dict]:
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        return [e for e in lines if "for the record" in e["request"]]

    wait_until(stops, 60, "the stop is in the record")
    assert (stops()[0]["path"], stops()[0]["status"]) == ("/v1/robot/stop", 200)
    assert LOOPBACK.post(f"{stack.address}/v1/robot/clear-stop").status_code == 200


def test_an_operator_may_stop_and_may_not_clear_a_stop(stack: Up, folder: Path) -> None:
    bus = ZenohBus(link(folder, stack, "operator.ann"))
    try:
        bus.call(STOP, pb.StopRequest(reason="ann"), 10)
        assert bus.call(GET_STATE, pb.Empty(), 10).stopped
        with pytest.raises(Unavailable):
            bus.call(CLEAR_STOP, pb.Empty(), 2)
        with pytest.raises(Unavailable):
            bus.call(TRUTH_EPISODE, pb.Empty(), 2)
        assert bus.call(GET_STATE, pb.Empty(), 10).stopped
    finally:
        bus.close()
    evaluation = ZenohBus(link(folder, stack, "evaluation.robot"))
    assert evaluation.call(TRUTH_EPISODE, pb.Empty(), 10).seed == 1
    evaluation.close()


def test_nobody_without_a_certificate_reaches_the_robot(stack: Up) -> None:
    with pytest.raises(Unavailable, match="no router at"):
        ZenohBus(f"tcp/127.0.0.1:{stack.router_port}")
