"""The bus: topics, methods, liveliness. Two kinds pass one contract suite (`tests/contract`).

`ZenohBus` joins processes; `MemoryBus` joins services within one, synchronously, and still
serialises every message, so that aliasing and schema faults show.

Handlers of one topic are called one at a time, in order; handlers of different topics and of
methods may be called at the same time from other threads. A service guards its state with one
lock and never holds it across a call to the bus. What a handler raises reaches the caller as a
typed error (methods) or the log (topics) and never ends the process.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from helios_core.topics import M, Method, Rep, Req, Topic


class Registration(Protocol):
    """Something that was declared and can be taken back: from any thread, also from inside its own
    handler, and a second time without effect. Calls that wait for their turn are not answered."""

    def close(self) -> None: ...


# service, instance, whether it is alive
LivelinessHandler = Callable[[str, str, bool], None]


class Bus(ABC):
    """See the module. All calls are safe from any thread."""

    robot: str

    @abstractmethod
    def publish(self, topic: Topic[M], message: M) -> None:
        """Send to every subscriber. Raises Unavailable when the bus is closed."""

    @abstractmethod
    def subscribe(self, topic: Topic[M], handler: Callable[[M], None]) -> Registration:
        """Call `handler` for every message, as far as the topic's quality of service goes."""

    @abstractmethod
    def serve(self, method: Method[Req, Rep], handler: Callable[[Req], Rep]) -> Registration:
        """Answer calls of `method`."""

    @abstractmethod
    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        """Ask and wait.

        Raises Unavailable when nobody serves the method, DeadlineExceeded when no answer came in
        time, and whatever HeliosError the handler raised.
        """

    @abstractmethod
    def announce(self, service: str, instance: str) -> Registration:
        """Be seen as alive until closed, or until this process ends."""

    @abstractmethod
    def watch(self, handler: LivelinessHandler) -> Registration:
        """Be told who is alive now and who comes and goes."""

    @abstractmethod
    def close(self) -> None:
        """Take everything back. Idempotent."""
