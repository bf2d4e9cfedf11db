"""Stand-ins for a ROS node, its messages, futures and action clients: no ROS needed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from helios_ros2.action_call import RosAction
from helios_ros2.earlier_goals import EarlierGoals
from helios_ros2.offered_qos import Qos

MS = 1_000_000
CAMERA = "camera"


def xyz(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(x=x, y=y, z=z)


def transform(parent: str, child: str, ns: int, x_m: float = 0.0) -> SimpleNamespace:
    stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=parent),
        child_frame_id=child,
        transform=SimpleNamespace(
            translation=xyz(x_m), rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        ),
    )


def camera_info() -> SimpleNamespace:
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=CAMERA), k=[300.0, 0, 160, 0, 300, 120, 0, 0, 1],
        d=[], width=320, height=240, distortion_model="plumb_bob", r=[], p=[],
        binning_x=0, binning_y=0, roi=SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0),
    )  # fmt: skip


class Graph:
    """Stands for a ROS node: every topic has a publisher, and the test sends its messages."""

    domain = "ROS_DOMAIN_ID is 0"

    def __init__(self) -> None:
        self.handlers: dict[str, Callable[[Any], None]] = {}
        self.sent: list[tuple[float, float]] = []
        self.happened: list[str] = []  # in the order in which it happened

    def every(self, _period_s: float, look: Callable[[], None]) -> None:
        look()

    def has_interface(self, _kind: str) -> bool:
        return True

    def graph(self) -> dict[str, list[str]]:
        names = ("color", "depth")
        return {f"/camera/{name}/image_raw": ["sensor_msgs/msg/Image"] for name in names}

    def offered(self, topic: str) -> list[tuple[str, Qos]]:
        kinds = {"/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage"}
        return [(kinds[topic], Qos())] if topic in kinds else []

    def start(self) -> None: ...

    def close(self) -> None:
        self.happened.append("close")

    def requested(self, _topic: str) -> list[tuple[str, Qos]]:
        return [("geometry_msgs/msg/Twist", Qos())]

    def subscribe(self, topic: str, _kind: str, handler: Callable[[Any], None], *_: Any) -> Any:
        self.handlers[topic] = handler
        return SimpleNamespace(close=lambda: None)

    def publisher(self, *_: Any) -> Any:
        return SimpleNamespace(publish=lambda m: self.sent.append((m.linear.x, m.angular.z)))

    def interface(self, _kind: str) -> Any:
        return lambda: SimpleNamespace(linear=xyz(), angular=xyz())


class Future:
    """Future of rclpy, as far as `helios_ros2` uses it."""

    def __init__(self, executor: object = None) -> None:
        self._lock = threading.Lock()
        self._result: Any = None
        self._callbacks: list[Callable[[Any], None]] = []

    def __await__(self) -> Any:
        while not self.done():
            yield
        return self._result

    def done(self) -> bool:
        return self._result is not None

    def exception(self) -> None:
        return None

    def result(self) -> Any:
        return self._result

    def add_done_callback(self, call: Callable[[Any], None]) -> None:
        with self._lock:
            done = self.done()
            if not done:
                self._callbacks.append(call)
        if done:
            call(self)

    def set_result(self, result: Any) -> None:
        with self._lock:
            self._result = result
        for call in self._callbacks:
            call(self)


def ros_action(sent: Future | None = None) -> RosAction:
    """Client of an action whose server answers a goal with `sent`."""
    action = RosAction.__new__(RosAction)
    action.name, action._kind = "/spin", "x/action/Spin"
    action._client = SimpleNamespace(server_is_ready=lambda: True, send_goal_async=lambda _: sent)
    action._sent = action._goal = None
    action.earlier = earlier_goals(CancelServer(is_there=False))
    return action


class CancelServer:
    """Stands for the client of an action's cancel service, and for its server."""

    def __init__(self, is_there: bool = True, answers: bool = True) -> None:
        self.is_there, self.answers = is_there, answers
        self.goals, self.return_code = 0, 0  # of each answer
        self.asked: list[tuple[Any, Future]] = []  # requests, with the futures of their answers

    def service_is_ready(self) -> bool:
        return self.is_there

    def call_async(self, request: Any) -> Future:
        self.asked.append((request, Future()))
        if self.answers:
            self.answer(-1)
        return self.asked[-1][1]

    def answer(self, index: int) -> None:
        """Answer one of the requests."""
        goals = [object()] * self.goals
        reply = SimpleNamespace(return_code=self.return_code, goals_canceling=goals)
        self.asked[index][1].set_result(reply)

    def remove_pending_request(self, _: Future) -> None: ...


def earlier_goals(server: CancelServer, name: str = "/spin") -> EarlierGoals:
    """The earlier goals of an action with this server."""
    made = EarlierGoals.__new__(EarlierGoals)
    made._action, made._client, made._lock = name, server, threading.Lock()
    made._kind = SimpleNamespace(Request=lambda: "all goals")
    made._asked, made._again_s, made._why_not, made.ended = None, 0.0, "it has not answered", False
    return made
