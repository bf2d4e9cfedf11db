"""Subscription to a topic of the robot: waits for its publisher, takes its type and QoS."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from helios_core.errors import HeliosError, Unavailable
from helios_core.log_rate_limit import LogRateLimit
from helios_replay.ros_images import stamp_ns

from helios_ros2.offered_qos import Qos, matching
from helios_ros2.ros_node import RosNode
from helios_ros2.zenoh_node import ZenohNode

log = logging.getLogger(__name__)

LOOK_S = 0.25  # period of the look at the graph


class TopicReader:
    """One topic of the robot. Messages go to a handler in the node's thread.

    The robot may start later, restart, or return with another type or quality of service.
    """

    def __init__(
        self,
        ros: RosNode | ZenohNode,
        topic: Callable[[], str],
        types: Sequence[str],
        handler: Callable[[Any], None],
        depth: int,
        retained: bool = False,
    ) -> None:
        """topic: gives its name; raises Unavailable while that is not known. types: accepted.
        retained: ask for earlier messages even if one of the publishers keeps none.
        """
        self._ros, self._name, self._types, self._handler = ros, topic, types, handler
        self._depth, self._retained = depth, retained
        self._subscription: Any = None
        self._taken: tuple[str, str, Qos] | None = None  # topic, type, quality of service
        self._arrived_s, self._count = 0.0, 0
        self._stamp_ns: int | None = None
        self._trouble = "not looked for yet"
        self._refused = ""  # what is wrong with the newest message
        self._seldom = LogRateLimit(log)
        ros.every(LOOK_S, self.look)

    @property
    def topic(self) -> str:
        """Name of the topic. Raises Unavailable while it is not known."""
        return self._name()

    @property
    def count(self) -> int:
        """Number of messages so far."""
        return self._count

    def age_s(self) -> float:
        """Time since the last message; infinite before the first."""
        return time.monotonic() - self._arrived_s if self._count else float("inf")

    def look(self) -> None:
        """Subscribe as soon as somebody publishes; anew if type or quality have changed."""
        try:
            topic = self._name()
            offered = self._ros.offered(topic)
            fitting = [(kind, qos) for kind, qos in offered if kind in self._types]
            if not fitting:
                self._trouble = self._unpublished(topic, offered)
                return
            qos = matching([q for k, q in fitting if k == fitting[0][0]])
            wanted = (topic, fitting[0][0], replace(qos, retained=qos.retained or self._retained))
            if wanted != self._taken:
                self._subscribe(wanted)
            self._trouble = ""
        except HeliosError as error:
            self._trouble = error.message

    def silence(self) -> Unavailable:
        """The fault of a topic without messages, or of its newest message: names topic, type, QoS
        and last stamp."""
        if self._taken is None or (self._trouble and not self._count):
            return Unavailable(self._trouble)
        if not self._count:
            return Unavailable(f"no message has come on {self.described()} yet; is it sent?")
        if self._refused:
            return Unavailable(f"{self.described()}: {self._refused}")
        gone = "" if not self._trouble else f"; {self._trouble}"
        stamp = ""
        if self._stamp_ns is not None:
            stamp = f", its last stamp is {self._stamp_ns / 1e9:.3f} s"
        return Unavailable(f"{self.described()} is silent for {self.age_s():.1f} s{stamp}{gone}")

    def described(self) -> str:
        """Topic, type and QoS, for messages; empty before a publisher is found."""
        if self._taken is None:
            return ""
        topic, kind, qos = self._taken
        return f"{topic} ({kind}, {qos})"

    def _unpublished(self, topic: str, offered: Sequence[tuple[str, Qos]]) -> str:
        wanted = " or ".join(self._types)
        if offered:
            return f"{topic} has the type {offered[0][0]}; wanted {wanted}: name another topic"
        return f"nobody publishes {topic} ({wanted}); is the robot on? {self._ros.domain}"

    def _subscribe(self, wanted: tuple[str, str, Qos]) -> None:
        topic, kind, qos = wanted
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None
        self._subscription = self._ros.subscribe(topic, kind, self._on_message, qos, self._depth)
        self._taken = wanted
        log.info("reads %s (%s, %s)", topic, kind, qos)

    def _on_message(self, message: Any) -> None:
        self._arrived_s, self._count = time.monotonic(), self._count + 1
        try:
            self._stamp_ns = newest_stamp_ns(message)
            self._handler(message)
            self._refused = ""
        except HeliosError as error:  # a message with impossible content
            self._refuse(error.message)
        except Exception as error:  # an internal error; the next message may be valid
            self._refuse(f"it could not be read ({type(error).__name__}: {error})", error)

    def _refuse(self, why: str, error: Exception | None = None) -> None:
        """Note that the newest message was left out; error: shown with its traceback."""
        self._refused = why
        said = f"a message of {self.described()} was left out: {why}"
        self._seldom.warn(type(error), said, error)


def newest_stamp_ns(message: Any) -> int | None:
    """Stamp of a message's header; of its transforms' newest if it has none. None: unstamped."""
    parts = [message, *getattr(message, "transforms", ())]
    stamps = [stamp_ns(part.header) for part in parts if hasattr(part, "header")]
    return max(stamps, default=None)
