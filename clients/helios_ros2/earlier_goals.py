"""Goals that an earlier process left behind: an action server goes on with them without a client.

Each goal is cancelled as soon as the server of its action is seen, also the goals of others.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from helios_ros2.rclpy_loading import interface
from helios_ros2.ros_node import RosNode
from helios_ros2.stop_latch import NotDone

log = logging.getLogger(__name__)

CANCEL_GOAL = "action_msgs/srv/CancelGoal"
REFUSED = 1  # return code of CancelGoal: goals run, and none of them is cancelled
LOOK_S = 0.25  # period of the look for the server and its answer
AGAIN_S = 2.0  # without an answer for this long, or after a refusal, it is asked again
POLL_S = 0.02


class EarlierGoals:
    """The goals of one action from before this process. Thread-safe."""

    def __init__(self, ros: RosNode, action: str) -> None:
        self._action, self._kind = action, interface(CANCEL_GOAL)
        self._client = ros.node.create_client(self._kind, f"{action}/_action/cancel_goal")
        self._lock = threading.Lock()
        self._asked: Any = None  # future of the newest request's answer
        self._again_s = 0.0  # monotonic time from which the server may be asked again
        self._why_not = "it has not answered"
        self.ended = False  # True once the server has cancelled them, or had none
        ros.every(LOOK_S, self.look)

    def look(self) -> None:
        """Take the server's answer if it has come. Else ask it to cancel all goals, once it is
        there. Does not wait."""
        with self._lock:
            if self.ended:
                return
            if self._asked is not None and self._asked.done():
                asked, self._asked = self._asked, None
                self._take(asked.result())
            elif self._client.service_is_ready() and time.monotonic() >= self._again_s:
                if self._asked is not None:
                    self._client.remove_pending_request(self._asked)
                self._again_s = time.monotonic() + AGAIN_S
                self._asked = self._client.call_async(self._kind.Request())  # no id, no stamp: all

    def why_running(self) -> str:
        """Why an earlier goal may still run; "" if none does, or nobody serves the action."""
        if self.ended or not self._client.service_is_ready():
            return ""
        return f"the action {self._action} was asked to cancel its earlier goals: {self._why_not}"

    def _take(self, answer: Any) -> None:
        if answer.return_code == REFUSED:
            self._why_not = "it refuses, and they run on"
            return
        self.ended = True
        if answer.goals_canceling:
            log.warning(
                "goals of the action %s from before the start were cancelled: %d",
                self._action,
                len(answer.goals_canceling),
            )


def end_earlier(
    goals: Sequence[EarlierGoals], within_s: float, rest: Callable[[float], object]
) -> None:
    """Wait until no earlier goal runs; an action that nobody serves is not waited for.

    rest: waits the given seconds. Raises NotDone if a server has not cancelled its goals after
    `within_s`, and what `rest` raises.
    """
    end_s = time.monotonic() + within_s
    while True:
        for each in goals:
            each.look()
        running = next((why for each in goals if (why := each.why_running())), "")
        if not running:
            return
        if time.monotonic() >= end_s:
            raise NotDone(f"{running}; wait for their end, or restart the action's server")
        rest(POLL_S)
