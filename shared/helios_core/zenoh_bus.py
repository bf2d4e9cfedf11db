"""Bus between processes over Eclipse Zenoh, with one router and every service as its client.

Implementation of the qualities of service (reasons: `docs/decisions/0002-bus.md`):

    LATEST_WINS   never blocks: a full link drops messages, and the sender repeats the newest
                  (`latest_value_sender.py`); read through a ring of one
    NEVER_DROP    blocks; read through a queue, acknowledgements pace the sender
    RETAINED      as NEVER_DROP; the publisher stores the last message for late subscribers
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import TypeVar

import zenoh
from google.protobuf.message import DecodeError, Message
from zenoh import ext

from helios_core import tracing
from helios_core.bus import Bus, LivelinessHandler, Registration, arrived
from helios_core.bus_registrations import Registrations
from helios_core.errors import DeadlineExceeded, Unavailable
from helios_core.image_messages import ImageMessage, split
from helios_core.latest_value_sender import DuplicateFilter, Repeater
from helios_core.router_link import RouterLink
from helios_core.shared_payloads import Payload, SharedPayloads
from helios_core.topics import M, Method, QoS, Rep, Req, Topic, alive_key
from helios_core.zenoh_config import client_config, open_session
from helios_core.zenoh_messages import answer, assembled, reply_of

T = TypeVar("T")

log = logging.getLogger(__name__)

QUEUE_DEPTH = 256
SERVE_THREADS = 4  # per method, started when needed
MOST_WAITING = 128  # calls of a method that wait for a thread, each with its request in memory
RETAINED_HEARTBEAT_S = 0.5  # a subscriber notices within this time that it missed a message
DISCOVERY_S = 0.25  # longest search for a service that serves a method
MEETING_S = 1.0  # the same after meeting a router, whose services have yet to come
READERS_END_WITHIN_S = 0.3


class ZenohBus(Bus):
    """Bus over a client session; router: its endpoint, or a link with a certificate.

    Raises Unavailable if the router cannot be reached, InvalidInput for an unusable session file.
    """

    def __init__(self, router: RouterLink | str, robot: str = "robot") -> None:
        self.robot = robot
        try:
            self._session, shares_memory = open_session(client_config(router))
        except zenoh.ZError as error:
            raise Unavailable(
                f"no router at {router} ({_cause(error)}); `helios up --router-port PORT` starts "
                "one with all services, `python -m helios_core.router` one alone"
            ) from error
        self._met_s, self._routers = time.monotonic(), self._router_ids()
        self._readers: list[threading.Thread] = []
        self._publishers: dict[str, zenoh.Publisher | ext.AdvancedPublisher] = {}
        self._shared = SharedPayloads(shares_memory)
        self._repeater = Repeater(self._start_reader)
        self._mine = Registrations()
        self._lock = threading.Lock()
        self._closed = False

    def publish(self, topic: Topic[M], message: M | ImageMessage[M]) -> None:
        try:
            publisher, data = self._publisher(topic), self._payload(message)
            if topic.qos is QoS.LATEST_WINS:
                self._repeater.send(topic.name, publisher.put, data)
            else:
                publisher.put(data, attachment=tracing.attachment())
        except zenoh.ZError as error:
            raise Unavailable(f"{topic.name} could not be published: {error}") from error

    def _payload(self, message: Message | ImageMessage) -> Payload:
        if isinstance(message, ImageMessage):
            return self._shared.of(message)
        return message.SerializeToString()

    def subscribe(self, topic: Topic[M], handler: Callable[[M], None]) -> Registration:
        return self._subscribe(topic, topic.type.FromString, handler)

    def subscribe_in_place(
        self, topic: Topic[M], handler: Callable[[ImageMessage[M]], None]
    ) -> Registration:
        return self._subscribe(topic, lambda data: split(topic.type, data), handler)

    def _subscribe(
        self, topic: Topic, parse: Callable[[bytes], object], handler: Callable
    ) -> Registration:
        key = topic.key(self.robot)
        latest = topic.qos is QoS.LATEST_WINS
        channel = (
            zenoh.handlers.RingChannel(1) if latest else zenoh.handlers.FifoChannel(QUEUE_DEPTH)
        )
        with self._declaring(topic.name):
            if topic.qos is QoS.RETAINED:
                subscriber = ext.declare_advanced_subscriber(
                    self._session,
                    key,
                    channel,
                    history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                    recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
            else:
                subscriber = self._session.declare_subscriber(key, channel)

        unseen = DuplicateFilter()

        def read() -> None:
            for sample in _received(subscriber.handler):
                if not unseen.take(_attached(sample)):
                    continue
                try:
                    message = parse(sample.payload.to_bytes())
                except DecodeError as error:
                    log.warning("a damaged message of %s is left out: %s", topic.name, error)
                    continue
                try:
                    with tracing.received(_attached(sample)):
                        handler(message)
                except Exception:
                    log.exception("the handler of %s failed; the message is lost to it", topic.name)

        self._start_reader(f"read {topic.name}", read)
        return self._keep(subscriber.undeclare)

    def serve(self, method: Method[Req, Rep], handler: Callable[[Req], Rep]) -> Registration:
        key = method.key(self.robot)
        with self._declaring(method.name):
            queryable = self._session.declare_queryable(
                key, zenoh.handlers.FifoChannel(QUEUE_DEPTH)
            )

        # Threads per method, so that a slow method (an action) cannot delay another (stop-now).
        pool = ThreadPoolExecutor(SERVE_THREADS, thread_name_prefix=f"serve {method.name}")
        places = threading.Semaphore(MOST_WAITING)
        logged: set[str] = set()  # errors of replies, each logged once

        def refuse(_: Req) -> Rep:
            raise Unavailable(f"{MOST_WAITING} calls of {method.name} already wait; try again")

        def serve_waiting(query: zenoh.Query, at_s: float) -> None:
            places.release()
            with arrived(at_s):
                reply(query, handler)

        def reply(query: zenoh.Query, do: Callable[[Req], Rep]) -> None:
            try:
                answer(query, key, method, do)
            except zenoh.ZError as error:
                if not self._closed and str(error) not in logged:
                    logged.add(str(error))
                    log.warning("a reply of %s could not be sent: %s", method.name, error)

        def accept() -> None:
            for query in _received(queryable.handler):
                if not places.acquire(blocking=False):
                    reply(query, refuse)
                    continue
                try:
                    pool.submit(serve_waiting, query, time.monotonic())
                except RuntimeError:  # the pool is shut down: the caller gets no reply
                    query.drop()

        def undo() -> None:
            try:
                queryable.undeclare()
            finally:
                pool.shutdown(wait=False, cancel_futures=True)  # maybe from one of its threads

        self._start_reader(f"accept {method.name}", accept)
        return self._keep(undo)

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        began_s = time.monotonic()
        while (reply := self._ask(method, request, timeout_s)) is None:
            self._note_router()
            search_s = max(DISCOVERY_S, self._met_s + MEETING_S - began_s)
            if time.monotonic() > began_s + min(timeout_s, search_s):
                raise Unavailable(
                    f"nobody serves {method.name}; start that service, then try again"
                )
            time.sleep(0.02)
        return reply

    def _note_router(self) -> None:
        """Note the time if the session has met another router since the last call in vain.

        A query right after that gets no reply: the services are still on their way to the router.
        """
        routers = self._router_ids()
        if routers != self._routers:
            self._routers = routers
            if routers:
                self._met_s = time.monotonic()

    def _router_ids(self) -> frozenset[str]:
        return frozenset(str(id) for id in self._session.info.routers_zid())

    def _ask(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep | None:
        """Reply of one query; None without any reply, as from a service that is just starting."""
        self._check_open()
        try:
            replies = self._session.get(
                method.key(self.robot),
                zenoh.handlers.FifoChannel(QUEUE_DEPTH),
                payload=request.SerializeToString(),
                attachment=tracing.attachment(),
                timeout=timeout_s,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            data = assembled(method, replies)
        except zenoh.ZError as error:
            raise Unavailable(f"{method.name} could not be asked: {error}") from error
        except TimeoutError as error:
            raise DeadlineExceeded(f"{method.name} gave no answer in {timeout_s:g} s") from error
        return None if data is None else reply_of(method, data)

    def announce(self, service: str, instance: str) -> Registration:
        key = alive_key(self.robot, service, instance)
        with self._declaring(f"{service} {instance}"):
            token = self._session.liveliness().declare_token(key)
        return self._keep(token.undeclare)

    def watch(self, handler: LivelinessHandler) -> Registration:
        key, channel = alive_key(self.robot, "*", "*"), zenoh.handlers.FifoChannel(QUEUE_DEPTH)
        with self._declaring("liveliness"):
            subscriber = self._session.liveliness().declare_subscriber(key, channel, history=True)

        def read() -> None:
            for sample in _received(subscriber.handler):
                *_, service, instance = str(sample.key_expr).split("/")
                try:
                    handler(service, instance, sample.kind == zenoh.SampleKind.PUT)
                except Exception:
                    log.exception("the liveliness handler failed")

        self._start_reader("read liveliness", read)
        return self._keep(subscriber.undeclare)

    def close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            publishers = list(self._publishers.values())
        self._repeater.close()
        self._mine.close()
        # An undeclared publisher frees 16 MB of shared memory, else held until the process ends.
        for publisher in publishers:
            with suppress(RuntimeError):  # another thread uses it, blocked by the network
                publisher.undeclare()
        try:
            self._session.close()  # without it the process hangs at exit
        except zenoh.ZError as error:  # the router hangs during a transmission
            log.warning("the session was left open: %s", error)
        self._shared.close()
        deadline = time.monotonic() + READERS_END_WITHIN_S
        for reader in list(self._readers):
            if reader is not threading.current_thread():
                reader.join(max(0.0, deadline - time.monotonic()))

    def _start_reader(self, name: str, read: Callable[[], None]) -> None:
        """Start a Python thread for a handler, in place of a Zenoh callback.

        Zenoh's threads cannot be joined, and one that is inside the library at interpreter exit
        aborts the process ("exception not rethrown").
        """
        reader = threading.Thread(target=read, name=name, daemon=True)
        reader.start()
        with self._lock:  # readers of closed registrations have ended
            self._readers = [*(r for r in self._readers if r.is_alive()), reader]

    def _publisher(self, topic: Topic) -> zenoh.Publisher | ext.AdvancedPublisher:
        with self._lock:
            self._check_open()
            if topic.name not in self._publishers:
                self._publishers[topic.name] = self._declare_publisher(topic)
            return self._publishers[topic.name]

    def _declare_publisher(self, topic: Topic) -> zenoh.Publisher | ext.AdvancedPublisher:
        key = topic.key(self.robot)
        if topic.qos is QoS.RETAINED:
            return ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                cache=ext.CacheConfig(max_samples=1),
                publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=RETAINED_HEARTBEAT_S, sporadic_heartbeat=None
                ),
            )
        if topic.qos is QoS.LATEST_WINS:
            return self._session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.BLOCK_FIRST
            )
        return self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )

    @contextmanager
    def _declaring(self, what: str) -> Iterator[None]:
        self._check_open()
        try:
            yield
        except zenoh.ZError as error:
            raise Unavailable(f"{what} could not be declared: {error}") from error

    def _keep(self, undo: Callable[[], None]) -> Registration:
        out = self._mine.keep(undo)
        if self._closed:  # closed concurrently: `close` may have missed this registration
            out.close()
            self._check_open()
        return out

    def _check_open(self) -> None:
        if self._closed:
            raise Unavailable("the bus is closed")


def _attached(sample: zenoh.Sample) -> bytes | None:
    return None if sample.attachment is None else sample.attachment.to_bytes()


def _received(channel: zenoh.Handler[T]) -> Iterator[T]:
    while True:
        try:
            yield channel.recv()
        except zenoh.ZError:  # undeclared or closed
            return


def _cause(error: zenoh.ZError) -> str:
    """Zenoh's error text without the source line."""
    return re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error)).rstrip(".")
