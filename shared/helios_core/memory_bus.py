"""Bus within one process: synchronous and deterministic. It serialises messages, with exceptions.

`publish` delivers a message to the subscribers in the order of subscription before it returns. In
lockstep, a step is therefore complete when the `publish` of its frame returns.

A message of a topic in `MemoryHub.uncopied` reaches its subscribers as it is. Publisher and
subscribers must not change it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from google.protobuf.message import Message

from helios_core.bus import Bus, LivelinessHandler, Registration
from helios_core.bus_registrations import Registrations
from helios_core.errors import (
    DeadlineExceeded,
    HeliosError,
    Unavailable,
    error_from_proto,
    error_to_proto,
)
from helios_core.image_messages import ImageMessage, split
from helios_core.topics import M, Method, QoS, Rep, Req, Topic

log = logging.getLogger(__name__)


@dataclass
class MemoryHub:
    """State that the buses of one process share; one hub is one network.

    uncopied: topics of large messages that are neither serialised nor copied.
    """

    uncopied: frozenset[Topic] = frozenset()
    lock: threading.RLock = field(default_factory=threading.RLock)
    subscribers: list[_Subscriber] = field(default_factory=list)
    servers: dict[str, _Server] = field(default_factory=dict)
    retained: dict[str, bytes] = field(default_factory=dict)
    alive: list[tuple[str, str, str]] = field(default_factory=list)  # robot, service, instance
    watchers: list[tuple[str, LivelinessHandler]] = field(default_factory=list)


@dataclass(eq=False)
class _Subscriber:
    key: str
    read: Callable[[bytes], object]
    take: Callable[[Message | ImageMessage], object]  # for a message that is not serialised
    handler: Callable
    turn: threading.RLock = field(default_factory=threading.RLock)

    def wants(self, key: str) -> bool:
        if "*" not in self.key:
            return self.key == key
        mine, theirs = self.key.split("/"), key.split("/")
        return len(mine) == len(theirs) and all(
            a in ("*", b) for a, b in zip(mine, theirs, strict=True)
        )

    def deliver(self, data: bytes | Message | ImageMessage) -> None:
        """Pass on a message, serialised or as it is."""
        try:
            message = self.read(data) if isinstance(data, bytes) else self.take(data)
            with self.turn:
                self.handler(message)
        except Exception:
            log.exception("the handler of %s failed; the message is lost to it", self.key)


@dataclass(eq=False)
class _Server:
    method: Method
    handler: Callable


class MemoryBus(Bus):
    """One service's end of a MemoryHub."""

    def __init__(self, hub: MemoryHub, robot: str = "robot") -> None:
        self.robot = robot
        self._hub = hub
        self._mine = Registrations()
        self._closed = False

    def publish(self, topic: Topic[M], message: M | ImageMessage[M]) -> None:
        self._check_open()
        key = topic.key(self.robot)
        data = message if topic in self._hub.uncopied else message.SerializeToString()
        with self._hub.lock:
            if topic.qos is QoS.RETAINED:
                self._hub.retained[key] = message.SerializeToString()
            receivers = [s for s in self._hub.subscribers if s.wants(key)]
        for subscriber in receivers:
            subscriber.deliver(data)

    def subscribe(self, topic: Topic[M], handler: Callable[[M], None]) -> Registration:
        return self._subscribe(topic, topic.type.FromString, _whole, handler)

    def subscribe_in_place(
        self, topic: Topic[M], handler: Callable[[ImageMessage[M]], None]
    ) -> Registration:
        return self._subscribe(topic, lambda data: split(topic.type, data), lambda m: m, handler)

    def _subscribe(
        self,
        topic: Topic,
        read: Callable[[bytes], object],
        take: Callable[[Message | ImageMessage], object],
        handler: Callable,
    ) -> Registration:
        self._check_open()
        subscriber = _Subscriber(topic.key(self.robot), read, take, handler)
        with self._hub.lock:
            self._hub.subscribers.append(subscriber)
            past = [d for k, d in self._hub.retained.items() if subscriber.wants(k)]
        for data in past:
            subscriber.deliver(data)

        def undo() -> None:
            with self._hub.lock:  # else a concurrent `publish` skips the next subscriber
                self._hub.subscribers.remove(subscriber)

        return self._mine.keep(undo)

    def serve(self, method: Method[Req, Rep], handler: Callable[[Req], Rep]) -> Registration:
        self._check_open()
        key, server = method.key(self.robot), _Server(method, handler)

        def undo() -> None:
            with self._hub.lock:
                if self._hub.servers.get(key) is server:
                    del self._hub.servers[key]

        with self._hub.lock:
            self._hub.servers[key] = server
        return self._mine.keep(undo)

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        """Call a method; the handler runs on this thread, so its timeout is checked at its end."""
        self._check_open()
        server = self._hub.servers.get(method.key(self.robot))
        if server is None:
            raise Unavailable(f"nobody serves {method.name}; start that service, then try again")
        began = time.monotonic()
        try:
            reply = server.handler(method.request.FromString(request.SerializeToString()))
        except Exception as error:
            if not isinstance(error, HeliosError):
                log.exception("the handler of %s failed", method.name)
            raise error_from_proto(error_to_proto(error)) from error
        if time.monotonic() - began > timeout_s:
            raise DeadlineExceeded(f"{method.name} gave no answer in {timeout_s:g} s")
        return method.reply.FromString(reply.SerializeToString())

    def announce(self, service: str, instance: str) -> Registration:
        self._check_open()
        entry = (self.robot, service, instance)
        with self._hub.lock:
            self._hub.alive.append(entry)
        self._tell(entry, True)

        def undo() -> None:
            with self._hub.lock:
                self._hub.alive.remove(entry)
            self._tell(entry, False)

        return self._mine.keep(undo)

    def watch(self, handler: LivelinessHandler) -> Registration:
        self._check_open()
        entry = (self.robot, handler)
        with self._hub.lock:
            self._hub.watchers.append(entry)
            present = [a for a in self._hub.alive if a[0] == self.robot]
        for _, service, instance in present:
            _notify(handler, service, instance, True)

        def undo() -> None:
            with self._hub.lock:
                self._hub.watchers.remove(entry)

        return self._mine.keep(undo)

    def close(self) -> None:
        self._mine.close()
        self._closed = True

    def _tell(self, entry: tuple[str, str, str], alive: bool) -> None:
        with self._hub.lock:
            watching = [handler for robot, handler in self._hub.watchers if robot == entry[0]]
        for handler in watching:
            _notify(handler, entry[1], entry[2], alive)

    def _check_open(self) -> None:
        if self._closed:
            raise Unavailable("the bus is closed")


def _notify(handler: LivelinessHandler, service: str, instance: str, alive: bool) -> None:
    try:
        handler(service, instance, alive)
    except Exception:
        log.exception("the liveliness handler failed")


def _whole(message: Message | ImageMessage) -> Message:
    return message.whole() if isinstance(message, ImageMessage) else message
