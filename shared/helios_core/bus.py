"""Interface of the bus: topics, methods, liveliness.

Both implementations pass the contract tests in `tests/contract`. `ZenohBus` connects processes.
`MemoryBus` connects services within one process, synchronously; it still serialises every message,
so that aliasing and schema faults show.

The handlers of one topic run one at a time, in order. Handlers of different topics and of methods
may run concurrently in other threads. A service guards its state with one lock and never holds it
across a call to the bus. An exception in a handler reaches the caller as a typed error (methods)
or goes to the log (topics); it never ends the process.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

from helios_core.image_messages import ImageMessage
from helios_core.topics import M, Method, Rep, Req, Topic


class Registration(Protocol):
    """Handle that ends a subscription, a served method, an announcement or a watch.

    `close` is idempotent and safe from any thread, also from inside the handler. Pending calls get
    no reply.
    """

    def close(self) -> None: ...


_arrival_s: ContextVar[float | None] = ContextVar("arrival_s", default=None)


def arrival_s() -> float:
    """Time at which the call that this handler serves arrived, s on `time.monotonic`. The call may
    have waited since then for a thread that serves it. Now, if no such time is known."""
    known = _arrival_s.get()
    return time.monotonic() if known is None else known


@contextmanager
def arrived(at_s: float) -> Iterator[None]:
    """Context in which a handler serves a call that arrived at `at_s`."""
    token = _arrival_s.set(at_s)
    try:
        yield
    finally:
        _arrival_s.reset(token)


# (service, instance, True if alive)
LivelinessHandler = Callable[[str, str, bool], None]


class Bus(ABC):
    """Base class of a bus; see the module. All calls are safe from any thread."""

    robot: str

    @abstractmethod
    def publish(self, topic: Topic[M], message: M | ImageMessage[M]) -> None:
        """Send a message to every subscriber. Raises Unavailable if the bus is closed."""

    @abstractmethod
    def subscribe(self, topic: Topic[M], handler: Callable[[M], None]) -> Registration:
        """Call `handler` for every message that the topic's quality of service delivers."""

    @abstractmethod
    def subscribe_in_place(
        self, topic: Topic[M], handler: Callable[[ImageMessage[M]], None]
    ) -> Registration:
        """As `subscribe`, but leave the images of a message where they arrived, maybe in memory
        that processes share. A handler that keeps the message keeps `kept(message)`."""

    @abstractmethod
    def serve(self, method: Method[Req, Rep], handler: Callable[[Req], Rep]) -> Registration:
        """Serve `method` with `handler`."""

    @abstractmethod
    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        """Call a method and wait for its reply.

        Raises Unavailable if no service serves the method, DeadlineExceeded if no reply arrives in
        time, and the HeliosError that the handler raised.
        """

    @abstractmethod
    def announce(self, service: str, instance: str) -> Registration:
        """Declare a service alive until the registration is closed or the process ends."""

    @abstractmethod
    def watch(self, handler: LivelinessHandler) -> Registration:
        """Report every live service instance now, and each later arrival and departure."""

    @abstractmethod
    def close(self) -> None:
        """End all registrations and the connection. Idempotent."""
