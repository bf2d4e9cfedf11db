"""The robot's topics over Zenoh without ROS, for robots with `rmw_zenoh`. Experimental.

It has the functions of `RosNode` that the driver needs: topics only, no services and no actions.
`rosbags` knows the messages. Tried only against our own reading of the published format.
"""

from __future__ import annotations

import itertools
import logging
import os
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import zenoh
import zenoh.ext
from helios_core.errors import InvalidInput, Unavailable
from helios_core.zenoh_config import client_config, open_session

from helios_ros2 import zenoh_wire as wire
from helios_ros2.offered_qos import Qos

log = logging.getLogger(__name__)

ROUTER = "the Zenoh router of rmw_zenoh (`ros2 run rmw_zenoh_cpp rmw_zenohd`)"


class ZenohNode:
    """Node on a Zenoh router. Callbacks run in Zenoh's threads."""

    def __init__(self, name: str, router: str) -> None:
        """router: endpoint such as tcp/127.0.0.1:7447. Raises InvalidInput, Unavailable."""
        self._types, self._name = Messages(), name
        self._domain = int(os.environ.get("ROS_DOMAIN_ID", "0"))
        try:
            self._session = open_session(client_config(router))[0]
        except zenoh.ZError as error:
            raise Unavailable(
                f"{ROUTER} is not at {router}; HELIOS_ROS2_ZENOH_ROUTER names it"
            ) from error
        self._id = str(self._session.zid())
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._ends: dict[str, wire.Endpoint] = {}  # token -> publisher or subscription
        self._made: list[ZenohEnd] = []  # Zenoh ends what nobody refers to
        self._ending = threading.Event()
        liveliness = self._session.liveliness()
        self._token = liveliness.declare_token(wire.node_token(self._domain, self._id, name))
        self._watch = liveliness.declare_subscriber(
            f"{wire.TOKENS}/{self._domain}/**", self._on_token, history=True
        )

    def start(self) -> None:
        """Zenoh's threads run already."""

    def close(self) -> None:
        if not self._ending.is_set():
            self._ending.set()
            self._session.close()

    # --- what RosNode has, too ----------------------------------------------------------------
    def interface(self, name: str) -> Callable[..., Any]:
        """Maker of messages of a type; fields that are not given are zero."""
        return self._types.maker(name)

    def has_interface(self, name: str) -> bool:
        return self._types.knows(name)

    def subscribe(
        self, topic: str, kind: str, handler: Callable[[Any], None], qos: Qos, depth: int
    ) -> ZenohEnd:
        """Call `handler` for each message; those of a retained topic also if sent before."""
        key = self._key(topic, kind)

        def on(sample: zenoh.Sample) -> None:
            handler(self._types.read(sample.payload.to_bytes(), kind))

        if qos.retained:
            entity: Any = zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                on,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=depth),
            )
        else:
            entity = self._session.declare_subscriber(key, on)
        token = self._announce(wire.SUBSCRIPTION, topic, kind, qos)
        self._made.append(ZenohEnd(entity, token))
        return self._made[-1]

    def publisher(self, topic: str, kind: str, qos: Qos, depth: int) -> ZenohPublisher:
        key, token = self._key(topic, kind), self._announce(wire.PUBLISHER, topic, kind, qos)
        if qos.retained:
            entity: Any = zenoh.ext.declare_advanced_publisher(
                self._session, key, cache=zenoh.ext.CacheConfig(depth), publisher_detection=True
            )
        else:
            entity = self._session.declare_publisher(key)
        made = ZenohPublisher(entity, token, self._types, kind)
        self._made.append(made)
        return made

    def every(self, period_s: float, do: Callable[[], None]) -> None:
        """Call `do` periodically, in a thread of its own."""

        def run() -> None:
            while not self._ending.wait(period_s):
                do()

        threading.Thread(target=run, name=f"zenoh {self._name}", daemon=True).start()

    def graph(self) -> dict[str, list[str]]:
        out: dict[str, list[str]] = {}
        for end in self._of(wire.PUBLISHER):
            out.setdefault(end.topic, []).append(end.type)
        return out

    def offered(self, topic: str) -> list[tuple[str, Qos]]:
        return [(e.type, e.qos) for e in self._of(wire.PUBLISHER) if e.topic == topic]

    def requested(self, topic: str) -> list[tuple[str, Qos]]:
        return [(e.type, e.qos) for e in self._of(wire.SUBSCRIPTION) if e.topic == topic]

    @property
    def domain(self) -> str:
        return f"ROS_DOMAIN_ID is {self._domain}"

    # --- names --------------------------------------------------------------------------------
    def _of(self, kind: str) -> list[wire.Endpoint]:
        with self._lock:
            return [end for end in self._ends.values() if end.kind == kind]

    def _key(self, topic: str, kind: str) -> str:
        return wire.data_key(self._domain, topic, kind, self._types.hash_of(kind))

    def _announce(self, end: str, topic: str, kind: str, qos: Qos) -> Any:
        told = wire.Endpoint(end, topic, kind, self._types.hash_of(kind), qos)
        token = wire.endpoint_token(self._domain, self._id, next(self._numbers), self._name, told)
        return self._session.liveliness().declare_token(token)

    def _on_token(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        end = wire.endpoint_of(token)
        if end is None or token.split("/")[2] == self._id:
            return
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._ends[token] = end
            else:
                self._ends.pop(token, None)


class ZenohEnd:
    """Subscription; `close` ends it."""

    def __init__(self, entity: Any, token: Any) -> None:
        self._entity, self._token = entity, token

    def close(self) -> None:
        self._entity.undeclare()
        self._token.undeclare()


class ZenohPublisher(ZenohEnd):
    """Publisher of one topic."""

    def __init__(self, entity: Any, token: Any, types: Messages, kind: str) -> None:
        super().__init__(entity, token)
        self._types, self._kind = types, kind
        self._gid, self._numbers = uuid.uuid4().bytes, itertools.count(1)

    def publish(self, message: Any) -> None:
        said = wire.attachment(next(self._numbers), time.time_ns(), self._gid)
        self._entity.put(self._types.written(message, self._kind), attachment=said)


class Messages:
    """Message types by name, from `rosbags`."""

    def __init__(self) -> None:
        """Raises InvalidInput without the library."""
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise InvalidInput(
                "ROS over Zenoh needs rosbags: pip install 'helios-ovmm[ros]'"
            ) from error
        self._store = get_typestore(Stores.ROS2_JAZZY)

    def knows(self, kind: str) -> bool:
        return kind in self._store.fielddefs

    def hash_of(self, kind: str) -> str:
        return str(self._store.hash_rihs01(kind))

    def read(self, data: bytes, kind: str) -> Any:
        return self._store.deserialize_cdr(data, kind)

    def written(self, message: Any, kind: str) -> bytes:
        return bytes(self._store.serialize_cdr(message, kind))

    def maker(self, kind: str) -> Callable[..., Any]:
        """Function that makes a message; lists of numbers may be given for arrays."""
        if not self.knows(kind):
            raise InvalidInput(f"the ROS type {kind} is not known to rosbags; use rclpy for it")
        return lambda **given: self._made(kind, given)

    def _made(self, kind: str, given: Mapping[str, Any]) -> Any:
        fields = {name: self._empty(*form) for name, form in self._store.fielddefs[kind][1]}
        for name, value in given.items():
            is_array = isinstance(fields[name], np.ndarray)
            fields[name] = np.asarray(value, fields[name].dtype) if is_array else value
        return self._store.types[kind](**fields)

    def _empty(self, form: Any, inner: Any) -> Any:
        """Zero of a field; form: kind of field, inner: its type, and the size of an array."""
        if form.name == "BASE":
            return "" if inner[0] in ("string", "wstring") else np.dtype(inner[0]).type(0).item()
        if form.name == "NAME":
            return self._made(inner, {})
        (item, of), size = inner
        if item.name == "BASE" and of[0] not in ("string", "wstring"):
            return np.zeros(size if form.name == "ARRAY" else 0, of[0])
        return [self._empty(item, of) for _ in range(size)] if form.name == "ARRAY" else []
