"""Pick, place, stop and silence of the driver; run by tests/e2e/test_ros2_hand.py inside ROS 2."""

from __future__ import annotations

import os
import signal
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from helios_core.errors import Unavailable  # noqa: E402
from helios_core.robot import ActionResult, Forward, Observe, Pick, Place, Show, Turn  # noqa: E402
from helios_ros2.driver import Ros2Driver  # noqa: E402
from helios_ros2.offered_qos import Qos  # noqa: E402
from helios_ros2.rclpy_loading import has_interface, interface  # noqa: E402
from helios_ros2.ros_node import RosNode, qos_profile  # noqa: E402
from helios_ros2.settings import Ros2Settings, UserAction  # noqa: E402

from tests.ros2_processes import PATIENT, fake_robot  # noqa: E402

DOMAIN = int(os.environ["ROS_DOMAIN_ID"])
FIBONACCI = "test_msgs/action/Fibonacci"
NEAR = (0.6, 0.0, 0.5)
WITHIN_S = 60.0


@contextmanager
def driver(**settings: Any) -> Iterator[Ros2Driver]:
    chosen = PATIENT | settings
    made = Ros2Driver(Ros2Settings(pose="topic", camera_tilt_rad=0.55, **chosen))
    try:
        wait_until(made.describe)
        yield made
    finally:
        made.close()


def wait_until(condition: Callable[[], object]) -> None:
    """Wait until the condition is true; a robot that is silent meanwhile makes it false."""
    end_s = time.monotonic() + WITHIN_S
    while True:
        with suppress(Unavailable):
            if condition():
                return
        assert time.monotonic() < end_s, "it never came true"
        time.sleep(0.02)


def act(made: Ros2Driver, action: Any) -> ActionResult:
    return made.act(action, uuid.uuid4().hex)


def begun(made: Ros2Driver, action: Any) -> Future[ActionResult]:
    """The action, begun in a thread of its own."""
    out: Future[ActionResult] = Future()
    threading.Thread(target=lambda: out.set_result(act(made, action)), daemon=True).start()
    return out


def action(name: str, order: int) -> UserAction:
    return UserAction(action=name, type=FIBONACCI, goal={"order": order})


def test_actions_of_the_user_pick_and_place_and_a_failure_is_said() -> None:
    with fake_robot(DOMAIN, "--still", "--hand"):
        with driver(pick=action("/pick", 5), place=action("/place", 5)) as made:
            assert act(made, Pick(NEAR, "cup")).succeeded
            assert made.state().held == "cup"
            assert "holds the cup" in act(made, Pick(NEAR, "mug")).reason
            assert act(made, Place(NEAR)).succeeded
            assert made.state().held == ""
        with driver(pick=action("/pick", 13)) as made:
            failed = act(made, Pick(NEAR, "cup"))
            assert "/pick failed: it was aborted" in failed.reason
            assert made.state().held == ""


def test_a_held_object_is_shown_by_an_action_of_the_user_until_the_robot_drives() -> None:
    show, carry = action("/pick", 5), action("/place", 13)  # 13: it is aborted
    at = (0.45, 0.0, 0.95)
    with fake_robot(DOMAIN, "--still", "--hand"):
        with driver(pick=action("/pick", 5), show=show, show_base_m=at, carry=carry) as made:
            assert made.describe().show_base_m == at
            assert "holds nothing to show" in act(made, Show(0.0)).reason
            assert act(made, Pick(NEAR, "cup")).succeeded
            assert act(made, Show(1.0)).succeeded
            assert "/place failed: it was aborted" in act(made, Turn(0.5)).reason
        with driver(pick=action("/pick", 5)) as made:
            assert made.describe().show_base_m is None
            assert "cannot show" in act(made, Show(0.0)).reason


def test_the_state_has_the_charge_of_the_battery() -> None:
    with fake_robot(DOMAIN, "--still", "--battery", "0.75"), driver() as made:
        wait_until(lambda: made.state().battery == pytest.approx(0.75))
    with fake_robot(DOMAIN, "--still", "--battery", "nan"), driver() as made:
        assert made.state().battery is None


def test_a_person_is_asked_and_answers() -> None:
    said: list[str] = []
    ros = RosNode("person")
    ros.node.create_subscription(
        interface("std_msgs/msg/String"),
        "/helios/request",
        lambda m: said.append(m.data),
        qos_profile(Qos(retained=True), 5),
    )
    clients = {
        name: ros.node.create_client(interface("std_srvs/srv/Trigger"), f"/helios/{name}")
        for name in ("done", "refuse")
    }
    ros.start()
    with fake_robot(DOMAIN, "--still"), driver() as made:
        for answer, succeeds in (("refuse", False), ("done", True)):
            said.clear()
            asking = begun(made, Pick(NEAR, "cup"))
            wait_until(lambda: any("give me the cup" in words for words in said))
            assert clients[answer].wait_for_service(WITHIN_S)
            clients[answer].call_async(interface("std_srvs/srv/Trigger").Request())
            result = asking.result(WITHIN_S)
            assert result.succeeded is succeeds
            assert "refused" in result.reason or succeeds
    ros.close()


@pytest.mark.skipif(not has_interface("nav2_msgs/action/Spin"), reason="no nav2_msgs")
def test_a_stop_cancels_nav2s_behaviour_and_the_robot_stands() -> None:
    with fake_robot(DOMAIN, "--still", "--nav2"), driver(motion="nav2") as made:
        start = made.state().T_world_base
        turning = begun(made, Turn(3.0))
        wait_until(lambda: abs(made.state().T_world_base[1, 0] - start[1, 0]) > 0.1)
        made.stop("a child in the way")
        result = turning.result(WITHIN_S)
        assert "a child in the way" in result.reason
        assert 0.1 < result.turned_rad < 2.9
        made.clear_stop()
        assert act(made, Observe()).succeeded


def test_a_silent_robot_is_a_sentence_with_topic_type_qos_and_stamp_and_it_comes_back() -> None:
    with fake_robot(DOMAIN, "--still") as robot, driver(silent_s=3.0, image_wait_s=6.0) as made:
        made.capture()
        robot.send_signal(signal.SIGSTOP)
        wait_until(lambda: silence_of(made.state))
        why = silence_of(made.state)
        for part in ("/odom", "nav_msgs/msg/Odometry", "reliable", "last stamp"):
            assert part in why
        wait_until(lambda: "last stamp" in silence_of(made.capture))
        why = silence_of(made.capture)
        for part in ("/camera/color/image_raw", "sensor_msgs/msg/Image", "reliable", "last stamp"):
            assert part in why
        robot.send_signal(signal.SIGCONT)
        wait_until(lambda: not silence_of(made.state) and not silence_of(made.capture))
        assert act(made, Forward(0.2)).succeeded


def silence_of(ask: Callable[[], object]) -> str:
    try:
        ask()
    except Unavailable as error:
        return error.message
    return ""


def test_a_robot_that_restarts_elsewhere_begins_a_new_world() -> None:
    with driver_of_two_robots() as (made, restart):
        before = made.state()
        act(made, Forward(0.4))
        restart()
        wait_until(lambda: made.state().world_epoch > before.world_epoch)
        wait_until(made.capture)


@contextmanager
def driver_of_two_robots() -> Iterator[tuple[Ros2Driver, Callable[[], None]]]:
    """A driver whose robot can be replaced by one with an earlier clock."""
    running = fake_robot(DOMAIN, "--still", "--clock-rate", "1", "--clock-start", "500")
    running.__enter__()

    def restart() -> None:
        nonlocal running
        running.__exit__(None, None, None)
        running = fake_robot(DOMAIN, "--still", "--clock-rate", "1", "--clock-start", "20")
        running.__enter__()

    try:
        with driver() as made:
            yield made, restart
    finally:
        running.__exit__(None, None, None)
