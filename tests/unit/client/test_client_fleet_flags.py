"""`helios up` for several robots and several machines: its flags and its processes."""

from __future__ import annotations

from pathlib import Path

import pytest
from helios_client.supervision.fleet_flags import chosen_services, fleet_names, router_endpoint
from helios_client.supervision.fleet_specs import FleetOptions
from helios_client.supervision.service_specs import StackOptions
from helios_client.usage_errors import UsageError

NAMES = ("robot-1", "robot-2", "robot-3")


def fleet(**options: object) -> FleetOptions:
    return FleetOptions(
        **{"robot": "sim", "router_port": 7447, "state_dir": Path("state"), "name": NAMES[0],
           "port": 8080, "seed": 5, "robots": NAMES} | options  # type: ignore[arg-type]
    )  # fmt: skip


def flags(stack: StackOptions, row: str) -> dict[str, str]:
    (argv,) = (list(spec.argv) for spec in stack.processes() if spec.name == row)
    return dict(zip(argv[3::2], argv[4::2], strict=True))


def test_robots_share_router_and_gateway_and_have_their_own_home_and_state() -> None:
    stack = fleet()
    rows = [spec.name for spec in stack.processes()]
    assert rows[:2] == ["router", "gateway"]
    assert len(rows) == len(set(rows)) == 2 + 3 * 6
    assert [flags(stack, f"{name}/world")["--seed"] for name in NAMES] == ["5", "6", "7"]
    assert flags(stack, "robot-2/planner")["--robot"] == "robot-2"
    states = {flags(stack, f"{name}/planner")["--state-dir"] for name in NAMES}
    assert len(states) == 3
    gateway = flags(stack, "gateway")
    assert (gateway["--robot"], gateway["--robots"]) == ("robot-1", "robot-2,robot-3")
    assert gateway["--fleet-queue"] == "state/fleet.sqlite"
    assert stack.elsewhere() == ()


def test_a_detector_with_models_serves_all_robots_and_a_simulated_one_does_not() -> None:
    stack = fleet(detector="onnx:yolox_nano.onnx")
    assert flags(stack, "detector")["--robots"] == ",".join(NAMES)
    assert "robot-2/detector" not in [spec.name for spec in stack.processes()]
    assert flags(fleet(), "robot-2/detector")["--detector"] == "simulated"


def test_each_robot_has_its_own_detector_if_the_scorer_is_simulated() -> None:
    stack = fleet(detector="onnx:yolox_nano.onnx", scorer="simulated:itc-v1")
    assert flags(stack, "robot-2/detector")["--scorer"] == "simulated:itc-v1"
    assert "detector" not in [spec.name for spec in stack.processes()]


def test_a_machine_runs_only_the_services_it_is_told_to_and_waits_for_the_rest() -> None:
    stack = StackOptions(
        "spot",
        0,
        Path("state"),
        port=8080,
        name="spot-2",
        router_at="tcp/10.0.0.2:7447",
        services=frozenset({"planner", "objectmap"}),
    )
    assert [spec.name for spec in stack.processes()] == ["objectmap", "planner"]
    assert flags(stack, "planner")["--router"] == "tcp/10.0.0.2:7447"
    assert stack.elsewhere() == ("bridge", "detector", "map2d")
    server = fleet(robot="remote", services=frozenset({"router", "gateway"}))
    assert [spec.name for spec in server.processes()] == ["router", "gateway"]
    assert len(server.elsewhere()) == 3 * 5
    maps = fleet(robot="remote", detector="onnx:a.onnx")
    assert maps.elsewhere() == tuple(f"{name}/bridge" for name in NAMES)


def test_services_and_router_belong_together() -> None:
    assert chosen_services(None, None) is None
    assert chosen_services("Router, map2d", None) == {"router", "map2d"}
    both = chosen_services(None, "10.0.0.2")
    assert both is not None
    assert {"bridge", "planner"} <= both
    assert not both & {"router", "gateway"}
    for text, router, said in (
        ("planer", "host", "no service is called 'planer'"),
        (",", "host", "--services is empty"),
        ("planner", None, "name the one to use with --router HOST"),
        ("router", "host", "leave one of them out"),
    ):
        with pytest.raises(UsageError, match=said):
            chosen_services(text, router)


def test_a_router_elsewhere_is_a_host_with_or_without_a_port() -> None:
    certs = Path("certs")
    assert router_endpoint("10.0.0.2", None) == "tcp/10.0.0.2:7447"
    assert router_endpoint("server:9000", certs) == "tls/server:9000"
    assert router_endpoint("[fd00::2]", None) == "tcp/[fd00::2]:7447"
    assert router_endpoint("tls/server:1", certs) == "tls/server:1"
    assert router_endpoint("tcp/[fe80::2%eth0]:9", None) == "tcp/[fe80::2%eth0]:9"


@pytest.mark.parametrize(
    "wrong",
    [
        "", ":1", "udp/server", "server:port", "server:70000", "server:0", "server:", "::1",
        "fe80::1", "1.2.3.4:5:6", "[::1", "::1]", "[]", "[::1]9", "host name", "h:٣",
    ],
)  # fmt: skip
def test_another_address_of_a_router_is_refused_with_the_form_of_a_right_one(wrong: str) -> None:
    with pytest.raises(UsageError, match=r"wanted HOST or HOST:PORT.* such as \[::1\]"):
        router_endpoint(wrong, None)


def test_robots_are_a_number_or_names() -> None:
    assert fleet_names(None, "spot", "spot-2") == ()
    assert fleet_names("3", "sim", "robot") == NAMES
    assert fleet_names("kitchen, hall", "remote", "robot") == ("kitchen", "hall")
    for text, robot, name, said in (
        ("2", "spot", "robot", "each spot robot on its own machine"),
        ("0", "sim", "robot", "wanted 1 to 100"),
        ("any,hall", "sim", "robot", "any robot of a fleet"),
        ("a/b", "sim", "robot", "no robot can be called 'a/b'"),
        (" , ", "sim", "robot", "--robots is empty"),
        ("2", "sim", "hall", "--name hall names one robot"),
    ):
        with pytest.raises(UsageError, match=said):
            fleet_names(text, robot, name)


def test_each_robot_of_a_fleet_has_ros_topics_of_its_own() -> None:
    """A stop or a task by ROS must reach one robot."""
    specs = fleet(ros2_output=True, ros2_python="/ros/python").processes()
    nodes = [s.argv[s.argv.index("--node") + 1] for s in specs if s.name.endswith("/ros2")]
    assert nodes == ["helios_robot_1", "helios_robot_2", "helios_robot_3"]
