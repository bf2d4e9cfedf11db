"""The bus between processes, over Eclipse Zenoh. One router in the middle, every service a client.

How the qualities of service map (why: `docs/decisions/0002-bus.md`):

    LATEST_WINS   blocks for the first message only; read through a ring of one
    NEVER_DROP    blocks; read through a queue, senders pace themselves by acknowledgements
    RETAINED      as NEVER_DROP, kept by the publisher for whoever comes later
    URGENT        real-time priority, unbatched, ring of one
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import zenoh
from google.protobuf.message import DecodeError
from zenoh import ext

from helios_core import proto as pb
from helios_core.bus import Bus, LivelinessHandler, Registration
from helios_core.errors import (
    DeadlineExceeded,
    HeliosError,
    Internal,
    InvalidInput,
    Unavailable,
    error_from_proto,
    error_to_proto,
)
from helios_core.topics import M, Method, QoS, Rep, Req, Topic, alive_key

T = TypeVar("T")

log = logging.getLogger(__name__)

CHUNK_BYTES = 512 * 1024  # larger replies are cut: one 30 MB reply closed a slow transport
QUEUE_DEPTH = 256
SERVE_THREADS = 4  # of each method, started when needed
ERROR_ENCODING = "application/protobuf;helios.v1.Error"
RETAINED_HEARTBEAT_S = 0.5  # a late joiner that missed the last message learns of it by then
DISCOVERY_S = 0.25  # how long a method that nobody serves is looked for
READERS_END_WITHIN_S = 0.3
LEASE_MS = 2000  # a frozen peer is given up after this


def client_config(router: str) -> zenoh.Config:
    """Configuration of a client of one router, e.g. `tcp/127.0.0.1:7447`."""
    return _config({"mode": "client", "connect": {
        "endpoints": [router], "timeout_ms": 1000, "exit_on_failure": True,
        "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
    }})  # fmt: skip


def router_config(listen: str) -> zenoh.Config:
    """Configuration of the router, listening on `listen` only."""
    return _config({"mode": "router", "listen": {"endpoints": [listen], "exit_on_failure": True}})


def _config(specific: dict) -> zenoh.Config:
    common = {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},  # the retained topics need it
        "transport": {"link": {"tx": {"lease": LEASE_MS}}},
    }
    return zenoh.Config.from_json5(json.dumps(common | specific))


class ZenohBus(Bus):
    """A client session on a router. Raises Unavailable when the router cannot be reached."""

    def __init__(self, router: str, robot: str = "robot") -> None:
        self.robot = robot
        try:
            self._session = zenoh.open(client_config(router))
        except zenoh.ZError as error:
            raise Unavailable(
                f"no router at {router}; start one with `python -m helios_core.router` ({error})"
            ) from error
        self._pools: list[ThreadPoolExecutor] = []
        self._readers: list[threading.Thread] = []
        self._publishers: dict[str, zenoh.Publisher | ext.AdvancedPublisher] = {}
        self._mine: list[_Declared] = []
        self._lock = threading.Lock()
        self._closed = False

    def publish(self, topic: Topic[M], message: M) -> None:
        try:
            self._publisher(topic).put(message.SerializeToString())
        except zenoh.ZError as error:
            raise Unavailable(f"{topic.name} could not be published: {error}") from error

    def subscribe(self, topic: Topic[M], handler: Callable[[M], None]) -> Registration:
        self._check_open()
        key = topic.key(self.robot)
        latest = topic.qos in (QoS.LATEST_WINS, QoS.URGENT)
        channel = (
            zenoh.handlers.RingChannel(1) if latest else zenoh.handlers.FifoChannel(QUEUE_DEPTH)
        )
        if topic.qos is QoS.RETAINED:
            subscriber = ext.declare_advanced_subscriber(
                self._session, key, channel,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )  # fmt: skip
        else:
            subscriber = self._session.declare_subscriber(key, channel)

        def read() -> None:
            for sample in _received(subscriber.handler):
                try:
                    handler(topic.type.FromString(sample.payload.to_bytes()))
                except Exception:
                    log.exception("the handler of %s failed; the message is lost to it", topic.name)

        self._start_reader(f"read {topic.name}", read)
        return self._keep(subscriber.undeclare)

    def serve(self, method: Method[Req, Rep], handler: Callable[[Req], Rep]) -> Registration:
        self._check_open()
        key = method.key(self.robot)

        # Threads of its own, so that slow methods (an action) keep no other (stop-now) waiting.
        pool = ThreadPoolExecutor(SERVE_THREADS, thread_name_prefix=f"serve {method.name}")
        self._pools.append(pool)

        def answer(query: zenoh.Query) -> None:
            with query:
                try:
                    data = query.payload.to_bytes() if query.payload is not None else b""
                    reply = handler(_request(method, data)).SerializeToString()
                except Exception as error:
                    if not isinstance(error, HeliosError):
                        log.exception("the handler of %s failed", method.name)
                    query.reply_err(
                        error_to_proto(error).SerializeToString(), encoding=ERROR_ENCODING
                    )
                    return
                for chunk, head in _chunks(reply):
                    query.reply(key, chunk, attachment=head)

        queryable = self._session.declare_queryable(key, zenoh.handlers.FifoChannel(QUEUE_DEPTH))

        def accept() -> None:
            for query in _received(queryable.handler):
                try:
                    pool.submit(answer, query)
                except RuntimeError:  # the pool is shut down: the caller sees nobody answering
                    query.drop()

        self._start_reader(f"accept {method.name}", accept)
        return self._keep(queryable.undeclare)

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        deadline = time.monotonic() + min(timeout_s, DISCOVERY_S)
        while (reply := self._ask(method, request, timeout_s)) is None:
            if time.monotonic() > deadline:
                raise Unavailable(
                    f"nobody serves {method.name}; start that service, then try again"
                )
            time.sleep(0.02)
        return reply

    def _ask(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep | None:
        """None when nobody answered: what a service that is just starting looks like, too."""
        self._check_open()
        try:
            replies = self._session.get(
                method.key(self.robot),
                zenoh.handlers.FifoChannel(QUEUE_DEPTH),
                payload=request.SerializeToString(),
                timeout=timeout_s,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            data = _assemble(method, replies)
        except zenoh.ZError as error:
            raise Unavailable(f"{method.name} could not be asked: {error}") from error
        except TimeoutError as error:
            raise DeadlineExceeded(f"{method.name} gave no answer in {timeout_s:g} s") from error
        return None if data is None else method.reply.FromString(data)

    def announce(self, service: str, instance: str) -> Registration:
        self._check_open()
        token = self._session.liveliness().declare_token(alive_key(self.robot, service, instance))
        return self._keep(token.undeclare)

    def watch(self, handler: LivelinessHandler) -> Registration:
        self._check_open()

        subscriber = self._session.liveliness().declare_subscriber(
            alive_key(self.robot, "*", "*"), zenoh.handlers.FifoChannel(QUEUE_DEPTH), history=True
        )

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
        for pool in self._pools:
            pool.shutdown(wait=False, cancel_futures=True)
        for declared in reversed(self._mine):
            declared.close()
        self._session.close()  # without it the process hangs at exit
        deadline = time.monotonic() + READERS_END_WITHIN_S
        for reader in self._readers:
            if reader is not threading.current_thread():
                reader.join(max(0.0, deadline - time.monotonic()))

    def _start_reader(self, name: str, read: Callable[[], None]) -> None:
        """A thread of ours for every handler, never a callback of Zenoh's: its threads cannot be
        waited for, and one that is in the library when the interpreter ends aborts the process
        ("exception not rethrown")."""
        reader = threading.Thread(target=read, name=name, daemon=True)
        reader.start()
        self._readers.append(reader)

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
                self._session, key, congestion_control=zenoh.CongestionControl.BLOCK,
                cache=ext.CacheConfig(max_samples=1), publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=RETAINED_HEARTBEAT_S, sporadic_heartbeat=None
                ),
            )  # fmt: skip
        if topic.qos is QoS.LATEST_WINS:
            return self._session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.BLOCK_FIRST
            )
        if topic.qos is QoS.URGENT:
            return self._session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME, express=True,
            )  # fmt: skip
        return self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def _keep(self, undeclare: Callable[[], None]) -> _Declared:
        out = _Declared(undeclare)
        self._mine.append(out)
        return out

    def _check_open(self) -> None:
        if self._closed:
            raise Unavailable("the bus is closed")


class _Declared:
    def __init__(self, undeclare: Callable[[], None]) -> None:
        self._undeclare: Callable[[], None] | None = undeclare

    def close(self) -> None:
        undeclare, self._undeclare = self._undeclare, None
        if undeclare:
            undeclare()


def _received(channel: zenoh.Handler[T]) -> Iterator[T]:
    while True:
        try:
            yield channel.recv()
        except zenoh.ZError:  # undeclared or closed
            return


def _request(method: Method[Req, Rep], data: bytes) -> Req:
    try:
        return method.request.FromString(data)
    except DecodeError as error:
        raise InvalidInput(
            f"the {len(data)} bytes sent to {method.name} are no "
            f"{method.request.DESCRIPTOR.full_name}; send that message"
        ) from error


def _chunks(data: bytes) -> Iterator[tuple[bytes, str]]:
    """Pieces of at most CHUNK_BYTES with `index/count/hash of the whole`."""
    count = max(1, -(-len(data) // CHUNK_BYTES))
    digest = hashlib.blake2b(data, digest_size=8).hexdigest() if count > 1 else "-"
    for i in range(count):
        yield data[i * CHUNK_BYTES : (i + 1) * CHUNK_BYTES], f"{i}/{count}/{digest}"


def _assemble(method: Method, replies: zenoh.Handler[zenoh.Reply]) -> bytes | None:
    """The whole reply; None when nothing came.

    Raises the typed error that was answered, and TimeoutError.
    """
    parts: dict[int, bytes] = {}
    count, digest = 0, "-"
    for reply in replies:
        if reply.err is not None:
            payload = reply.err.payload.to_bytes()
            if str(reply.err.encoding) == ERROR_ENCODING:
                raise error_from_proto(pb.Error.FromString(payload))
            raise TimeoutError  # the one error of Zenoh's own: its word "Timeout"
        sample = reply.ok
        if sample is None:
            continue
        head = sample.attachment.to_string() if sample.attachment is not None else "0/1/-"
        index, total, digest = head.split("/")
        count = int(total)
        parts[int(index)] = sample.payload.to_bytes()
    if not parts:
        return None
    data = b"".join(parts[i] for i in sorted(parts))
    whole = digest == "-" or hashlib.blake2b(data, digest_size=8).hexdigest() == digest
    if len(parts) != count or not whole:
        raise Internal(
            f"{method.name} answered {len(parts)} of {count} pieces; ask again, and if it happens "
            "again, the link loses data"
        )
    return data
