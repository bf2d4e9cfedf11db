"""The output process' service on a bus in memory; run by tests/e2e/test_ros2_hand.py."""

from __future__ import annotations

import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from helios_core import proto as pb  # noqa: E402
from helios_core.codec import state_to_proto  # noqa: E402
from helios_core.errors import InvalidInput  # noqa: E402
from helios_core.geometry import se2_to_se3  # noqa: E402
from helios_core.health import Health  # noqa: E402
from helios_core.memory_bus import MemoryBus, MemoryHub  # noqa: E402
from helios_core.topics import (  # noqa: E402
    CANCEL,
    GET_TASK,
    PLAN,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SNAPSHOT,
    SUBMIT,
    TASK,
)
from helios_core.types import RobotState  # noqa: E402
from helios_ros2.offered_qos import Qos  # noqa: E402
from helios_ros2.output_service import OutputService  # noqa: E402
from helios_ros2.rclpy_loading import has_interface, interface, rclpy_module  # noqa: E402
from helios_ros2.ros_node import RosNode, qos_profile  # noqa: E402
from helios_ros2.settings import Ros2Settings  # noqa: E402

WITHIN_S = 60.0
TF = "tf2_msgs/msg/TFMessage"
DO_TASK = "helios_msgs/action/DoTask"


class Planner:
    """Serves tasks that run until they are cancelled."""

    def __init__(self, bus: MemoryBus) -> None:
        self.bus, self.task = bus, pb.Task(id="t1", state="running", phase="find_object")
        self.cancelled = threading.Event()
        bus.serve(SUBMIT, lambda request: self.task)
        bus.serve(GET_TASK, lambda request: self.task)
        bus.serve(CANCEL, self.cancel)

    def cancel(self, request: pb.TaskRequest) -> pb.Task:
        self.task = pb.Task(id=request.id, state="cancelled", message="cancelled by a client")
        self.cancelled.set()
        return self.task


@contextmanager
def output(**settings: Any) -> Iterator[tuple[MemoryBus, RosNode]]:
    hub = MemoryHub()
    bus, other = MemoryBus(hub), MemoryBus(hub)
    service = OutputService(bus, Ros2Settings(**settings), Health())
    user = RosNode("user")
    user.start()
    try:
        yield other, user
    finally:
        user.close()
        service.close()


def wait_until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not condition():
        assert time.monotonic() < end_s, "it never came true"
        time.sleep(0.02)


def accepted(client: Any, goal: Any, on_feedback: Callable[[Any], None]) -> Any:
    """Future of an accepted goal. The answer to a goal can be lost while DDS still connects."""
    for _ in range(6):
        sent, again_s = client.send_goal_async(goal, on_feedback), time.monotonic() + WITHIN_S / 6
        while time.monotonic() < again_s:
            if sent.done():
                return sent
            time.sleep(0.02)
    raise AssertionError("no goal was accepted")


def heard(user: RosNode, topic: str, kind: str, retained: bool) -> list[Any]:
    out: list[Any] = []
    qos = qos_profile(Qos(retained=retained), 10)
    user.node.create_subscription(interface(kind), topic, out.append, qos)
    return out


@pytest.mark.skipif(not has_interface(TF), reason="no tf2_msgs")
def test_the_base_is_published_in_tf_if_asked() -> None:
    with output(publish_tf="base", frame="home") as (bus, user):
        got = heard(user, "/tf", TF, retained=False)

        def told() -> bool:
            bus.publish(ROBOT_STATE, state_to_proto(RobotState(se2_to_se3(1.0, 2.0, 0.5))))
            return bool(got)

        wait_until(told)
        [one] = got[0].transforms
        assert (one.header.frame_id, one.child_frame_id) == ("home", "base_link")
        at = one.transform.translation
        np.testing.assert_allclose([at.x, at.y], [1.0, 2.0])


@pytest.mark.skipif(not has_interface(TF), reason="no tf2_msgs")
def test_map_and_odom_are_one_frame_if_asked() -> None:
    with output(publish_tf="odom") as (bus, user):
        got = heard(user, "/tf_static", TF, retained=True)
        bus.publish(ROBOT_DESCRIPTION, pb.RobotDescription())
        wait_until(lambda: got)
        [one] = got[0].transforms
        assert (one.header.frame_id, one.child_frame_id) == ("map", "odom")
        assert one.transform.rotation.w == 1.0


@pytest.mark.parametrize(("told", "frame"), [("odom", "odom"), ("", "map")])
def test_the_frame_is_that_of_the_robots_poses_unless_it_is_set(told: str, frame: str) -> None:
    with output() as (bus, user):
        got = heard(user, "/helios/path", "nav_msgs/msg/Path", retained=True)
        bus.publish(PLAN, pb.Plan(path_m=[0, 0, 1, 0]))  # in a frame that is not known yet
        bus.publish(ROBOT_DESCRIPTION, pb.RobotDescription(world_frame=told))
        bus.publish(PLAN, pb.Plan(path_m=[0, 0, 1, 0, 2, 0]))
        wait_until(lambda: got)
        assert (got[0].header.frame_id, len(got[0].poses)) == (frame, 3)


def test_a_reset_empties_the_retained_grids_of_the_map() -> None:
    with output(frame="map", map_period_s=0.05) as (bus, user):
        cells = np.array([[0, 100, 0], [0, 0, -1]], "i1")
        replies = [
            pb.MapSnapshot(
                version=1,
                map_id="a",
                cell_m=0.05,
                width=3,
                height=2,
                occupancy=zlib.compress(cells.tobytes()),
                values={"pick": zlib.compress(np.full((2, 3), 0.5, "<f2").tobytes())},
            )
        ]
        bus.serve(SNAPSHOT, lambda request: replies[-1])
        kind = "nav_msgs/msg/OccupancyGrid"
        topics = ("/helios/map", "/helios/costmap", "/helios/value/pick/grid")
        got = [heard(user, topic, kind, retained=True) for topic in topics]
        wait_until(lambda: all(got))
        assert list(got[0][-1].data) == cells.ravel().tolist()
        replies.append(pb.MapSnapshot())
        wait_until(lambda: all(list(messages[-1].data) == [-1] for messages in got))
        for late in (heard(user, topic, kind, retained=True) for topic in topics):
            wait_until(lambda late=late: late)
            assert (late[0].info.height, late[0].info.width) == (1, 1)


def test_odom_is_not_published_below_itself() -> None:
    with (
        pytest.raises(InvalidInput, match="name another frame"),
        output(frame="odom", publish_tf="odom"),
    ):
        pass


def test_stamps_are_of_the_simulated_clock_if_asked() -> None:
    with output(sim_time=True, frame="map") as (bus, user):
        got = heard(user, "/helios/path", "nav_msgs/msg/Path", retained=True)
        kind = "rosgraph_msgs/msg/Clock"
        clock = user.publisher("/clock", kind, Qos(), 10)
        now = interface(kind)()
        now.clock.sec = 2_000_000_000  # a time to which no other clock has come

        def told() -> bool:
            clock.publish(now)
            bus.publish(PLAN, pb.Plan(path_m=[0, 0, 1, 0]))
            return any(path.header.stamp.sec == now.clock.sec for path in got)

        wait_until(told)


def test_a_stop_that_nobody_takes_is_no_success() -> None:
    with output() as (_, user):
        client = user.node.create_client(interface("std_srvs/srv/Trigger"), "/helios/stop")
        assert client.wait_for_service(WITHIN_S)
        answer = client.call_async(interface("std_srvs/srv/Trigger").Request())
        wait_until(answer.done)
        assert not answer.result().success
        assert answer.result().message


@pytest.mark.skipif(not has_interface(DO_TASK), reason="no helios_msgs")
def test_a_cancelled_goal_cancels_the_task() -> None:
    with output() as (bus, user):
        planner, kind = Planner(bus), interface(DO_TASK)
        client = rclpy_module("action").ActionClient(user.node, kind, "/helios/do_task")
        assert client.wait_for_server(WITHIN_S)
        phases: list[str] = []
        goal = kind.Goal(instruction="find the cup")
        sent = accepted(client, goal, lambda m: phases.append(m.feedback.phase))
        ended = sent.result().get_result_async()

        def told() -> bool:
            bus.publish(TASK, planner.task)
            return bool(phases)

        wait_until(told)
        sent.result().cancel_goal_async()
        assert planner.cancelled.wait(WITHIN_S)
        wait_until(ended.done)  # the end is also found without the planner's message
        assert ended.result().result.state == "cancelled"
        assert ended.result().status == 5
