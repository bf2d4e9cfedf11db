"""A call of a ROS action, which a stop cancels."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

from helios_core.errors import InvalidInput

from helios_ros2.earlier_goals import EarlierGoals
from helios_ros2.rclpy_loading import interface, rclpy_module
from helios_ros2.ros_node import RosNode
from helios_ros2.stop_latch import NotDone, StopLatch

POLL_S = 0.02
CANCEL_WITHIN_S = 1.0
SUCCEEDED = 4  # action_msgs/msg/GoalStatus
STATUS = {5: "it was cancelled", 6: "it was aborted"}


class RosAction:
    """Client of one action. `run` is for one thread; `cancel` for any."""

    def __init__(self, ros: RosNode, name: str, kind: str) -> None:
        """kind: `package/action/Name`. Raises InvalidInput if it is not installed."""
        self.name, self._kind = name, kind
        self._type = interface(kind)
        self._client = rclpy_module("action").ActionClient(ros.node, self._type, name)
        self.earlier = EarlierGoals(ros, name)
        self._sent: Any = None  # future of a goal that is not accepted yet
        self._goal: Any = None  # handle of the running goal

    def is_there(self) -> bool:
        """True if the robot serves the action."""
        return bool(self._client.server_is_ready())

    def goal(self, fields: Mapping[str, Any]) -> Any:
        """Goal with these fields; those that the type lacks raise InvalidInput."""
        goal = self._type.Goal()
        set_fields(goal, fields, f"the goal of {self._kind}")
        return goal

    def run(self, goal: Any, latch: StopLatch, within_s: float) -> Any:
        """Send a goal and wait for its result. Raises NotDone if it fails or the robot stops.

        Whatever ends the wait cancels the goal.
        """
        end_s = time.monotonic() + within_s
        if not self.is_there():
            raise NotDone(f"nobody serves the action {self.name} ({self._kind}); start it")
        self._sent = sent = self._client.send_goal_async(goal)
        try:
            handle = self._wait(sent, latch, end_s)
        except BaseException:  # `_sent` stays: it may be accepted yet
            sent.add_done_callback(lambda _: _cancel_if_accepted(sent, threading.Event()))
            raise
        if handle.accepted:
            self._goal = handle  # before `_sent` is cleared: `cancel` finds one of them
        self._sent = None
        if not handle.accepted:
            raise NotDone(f"the action {self.name} refused the goal")
        try:
            answer = self._wait(handle.get_result_async(), latch, end_s)
        except BaseException:
            self.cancel(time.monotonic() + CANCEL_WITHIN_S)  # if it raises, a stop can do it yet
            self._goal = None
            raise
        self._goal = None
        if answer.status != SUCCEEDED:
            how = STATUS.get(answer.status, f"its status is {answer.status}")
            raise NotDone(f"the action {self.name} failed: {how}{_said(answer.result)}")
        return answer.result

    def cancel(self, until_s: float = 0.0) -> None:
        """Cancel the running goal, if there is one, also if it is only accepted later.

        Waits for the answer until the monotonic time `until_s`.
        """
        sent, handle, answered = self._sent, self._goal, threading.Event()
        if handle is not None:
            handle.cancel_goal_async().add_done_callback(lambda _: answered.set())
        elif sent is not None:
            sent.add_done_callback(lambda _: _cancel_if_accepted(sent, answered))
        else:
            return
        answered.wait(max(0.0, until_s - time.monotonic()))

    def _wait(self, future: Any, latch: StopLatch, end_s: float) -> Any:
        while not future.done():
            if time.monotonic() > end_s:
                raise NotDone(f"the action {self.name} took too long")
            latch.rest(POLL_S)
        return future.result()


def _cancel_if_accepted(sent: Any, answered: threading.Event) -> None:
    """Cancel a goal that is accepted only after nobody waits for it any more.

    answered: set once it is cancelled or refused.
    """
    handle = None if sent.exception() else sent.result()
    if handle is not None and handle.accepted:
        handle.cancel_goal_async().add_done_callback(lambda _: answered.set())
    else:
        answered.set()


def set_fields(message: Any, fields: Mapping[str, Any], what: str) -> None:
    """Set the fields of a ROS message from nested tables. Raises InvalidInput."""
    for name, value in fields.items():
        if not hasattr(message, name):
            known = ", ".join(message.get_fields_and_field_types())
            raise InvalidInput(f"{what} has no field {name!r}; it has {known}")
        present = getattr(message, name)
        if isinstance(value, Mapping):
            set_fields(present, value, f"{what}.{name}")
            continue
        try:
            if isinstance(present, bool | int | float | str):
                value = type(present)(value)
            setattr(message, name, value)
        except (AssertionError, TypeError, ValueError) as error:
            raise InvalidInput(f"{what}.{name} cannot be {value!r}: {error}") from error


def filled(template: Any, values: Mapping[str, object]) -> Any:
    """A template of nested tables, lists and texts with `{name}` replaced."""
    if isinstance(template, Mapping):
        return {key: filled(value, values) for key, value in template.items()}
    if isinstance(template, list):
        return [filled(value, values) for value in template]
    if isinstance(template, str):
        try:
            return template.format_map(values)
        except (KeyError, IndexError, ValueError) as error:
            raise InvalidInput(
                f"{template!r} cannot be filled ({error}); texts may hold "
                f"{', '.join('{' + name + '}' for name in values)}"
            ) from error
    return template


def _said(result: Any) -> str:
    """What a result says about its failure."""
    for name in ("error_msg", "message", "error_code"):
        if value := getattr(result, name, None):
            return f", {name} {value}"
    return ""
