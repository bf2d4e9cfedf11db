"""A ROS node in a context and a thread of its own, beside any other program.

`rclpy` gets no signals and no command line: those belong to the process. Its callbacks run in the
node's daemon thread, one at a time unless the node has more threads.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Sequence
from typing import Any

from helios_ros2.offered_qos import Qos
from helios_ros2.rclpy_loading import has_interface, interface, load_rclpy, rclpy_module

log = logging.getLogger(__name__)

CLOSE_WITHIN_S = 1.0


class RosNode:
    """Node with its executor's thread. `start` begins to spin; `close` ends it."""

    def __init__(self, name: str, threads: int = 1, sim_time: bool = False) -> None:
        """threads: number of callbacks that run at a time. sim_time: its clock is that of /clock.

        Raises InvalidInput without rclpy.
        """
        self._rclpy = load_rclpy()
        executors = rclpy_module("executors")
        no_signals = rclpy_module("signals").SignalHandlerOptions.NO
        self._context = self._rclpy.Context()
        self._rclpy.init(args=[], context=self._context, signal_handler_options=no_signals)
        parameter = rclpy_module("parameter").Parameter
        self.node = self._rclpy.create_node(
            name,
            context=self._context,
            start_parameter_services=False,
            parameter_overrides=[parameter("use_sim_time", value=sim_time)],
        )
        self.executor = (
            executors.SingleThreadedExecutor(context=self._context)
            if threads == 1
            else executors.MultiThreadedExecutor(threads, context=self._context)
        )
        self.executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name=f"ros {name}", daemon=True)
        self._closed = False

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread and the node. Idempotent."""
        if self._closed:
            return
        self._closed = True
        self.executor.shutdown(timeout_sec=CLOSE_WITHIN_S)
        if self._thread.is_alive():
            self._thread.join(CLOSE_WITHIN_S)
        self.node.destroy_node()
        self._rclpy.shutdown(context=self._context)

    def now_ns(self) -> int:
        """Time of the node's clock; 0 before the first message of a simulated clock."""
        return int(self.node.get_clock().now().nanoseconds)

    def interface(self, name: str) -> Any:
        """Class of a message. Raises InvalidInput if it is not installed."""
        return interface(name)

    def has_interface(self, name: str) -> bool:
        """True if `interface` can load this type."""
        return has_interface(name)

    def subscribe(
        self, topic: str, kind: str, handler: Callable[[Any], None], qos: Qos, depth: int
    ) -> Subscription:
        """Call `handler` for each message, until the subscription is closed."""
        made = self.node.create_subscription(
            interface(kind), topic, handler, qos_profile(qos, depth)
        )
        return Subscription(lambda: self.node.destroy_subscription(made))

    def publisher(self, topic: str, kind: str, qos: Qos, depth: int) -> Any:
        """Publisher with the method `publish`."""
        return self.node.create_publisher(interface(kind), topic, qos_profile(qos, depth))

    def every(self, period_s: float, do: Callable[[], None]) -> None:
        """Call `do` periodically, in the node's thread."""
        self.node.create_timer(period_s, do)

    def graph(self) -> dict[str, list[str]]:
        """Topics with their types, as far as the node has discovered them."""
        return dict(self.node.get_topic_names_and_types())

    def offered(self, topic: str) -> list[tuple[str, Qos]]:
        """Type and quality of service of each publisher of a topic."""
        return _endpoints(self.node.get_publishers_info_by_topic(topic))

    def requested(self, topic: str) -> list[tuple[str, Qos]]:
        """Type and quality of service of each subscription to a topic."""
        return _endpoints(self.node.get_subscriptions_info_by_topic(topic))

    @property
    def domain(self) -> str:
        """What separates this robot's topics from those of others, for messages."""
        return f"ROS_DOMAIN_ID is {os.environ.get('ROS_DOMAIN_ID', '0')}"

    def _spin(self) -> None:
        while not self._closed and self._context.ok():
            try:
                self.executor.spin()
            except Exception:  # a callback failed: the next message may be valid
                if self._closed or not self._context.ok():
                    return
                log.exception("a ROS callback failed")


class Subscription:
    """Subscription; `close` ends it."""

    def __init__(self, close: Callable[[], object]) -> None:
        self.close = close


def qos_profile(qos: Qos, depth: int) -> Any:
    """rclpy's profile."""
    q = rclpy_module("qos")
    reliability, durability = q.ReliabilityPolicy, q.DurabilityPolicy
    return q.QoSProfile(
        depth=depth,
        reliability=reliability.RELIABLE if qos.reliable else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if qos.retained else durability.VOLATILE,
    )


def type_name(kind: Any) -> str:
    """`package/msg/Name` of a message class."""
    package = kind.__module__.partition(".")[0]
    part = next(p for p in kind.__module__.split(".") if p in ("msg", "srv", "action"))
    return f"{package}/{part}/{kind.__name__}"


def _endpoints(infos: Sequence[Any]) -> list[tuple[str, Qos]]:
    q = rclpy_module("qos")
    return [
        (
            info.topic_type,
            Qos(
                info.qos_profile.reliability == q.ReliabilityPolicy.RELIABLE,
                info.qos_profile.durability == q.DurabilityPolicy.TRANSIENT_LOCAL,
            ),
        )
        for info in infos
    ]
