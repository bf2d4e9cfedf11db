"""Known faults of Zenoh after a reconnect, on the pinned version, and our answer to each.

Topology: client, router, client. Each client reaches the router through a relay that can be cut.

    eclipse-zenoh/zenoh 2767, 2454   a query right after a reconnect gets no reply, or waits for one
    eclipse-zenoh/zenoh 2602         tokens of clients that are gone stay
    eclipse-zenoh/zenoh 588          a token arrives before the queryables of the same client
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import pytest
from helios_chaos.relay import Relay
from helios_core import proto as pb
from helios_core.errors import HeliosError, Unavailable
from helios_core.topics import GET_TASK
from helios_core.zenoh_bus import DISCOVERY_S, ZenohBus

from tests.support import free_port, wait_until

CUTS = 5


class Net:
    """A router, a server and a caller, each behind a relay of its own."""

    def __init__(self) -> None:
        self.port = free_port()
        self._router: subprocess.Popen[bytes] | None = None
        self.start_router()
        self.links = {name: Relay(("127.0.0.1", self.port)) for name in ("server", "caller")}
        self.server, self.caller = (_opened(self.links[n].endpoint) for n in ("server", "caller"))
        self.alive: dict[str, bool] = {}
        self.on_alive: Callable[[bool], None] = lambda alive: None
        self.server.serve(GET_TASK, lambda request: pb.Task(id=request.id))
        self.server.announce("planner", "one")
        self.caller.watch(self._heard)
        wait_until(lambda: self.alive.get("one"), 60, "the token is there")

    def start_router(self) -> None:
        argv = [
            sys.executable,
            "-m",
            "helios_core.router",
            "--listen",
            f"tcp/127.0.0.1:{self.port}",
        ]
        self._router = subprocess.Popen(argv)

    def kill_router(self) -> None:
        assert self._router is not None
        self._router.kill()
        self._router.wait()

    def call(self, timeout_s: float = 5.0) -> str:
        return self.caller.call(GET_TASK, pb.TaskRequest(id="a"), timeout_s).id

    def close(self) -> None:
        for bus in (self.caller, self.server):
            bus.close()
        for link in self.links.values():
            link.close()
        self.kill_router()

    def _heard(self, service: str, instance: str, alive: bool) -> None:
        self.alive[instance] = alive
        self.on_alive(alive)


@pytest.fixture
def net() -> Iterator[Net]:
    net = Net()
    yield net
    net.close()


def _opened(endpoint: str) -> ZenohBus:
    found: list[ZenohBus] = []

    def try_open() -> bool:
        try:
            found.append(ZenohBus(endpoint, "r"))
        except Unavailable:
            return False
        return True

    wait_until(try_open, 60, "the router answers")
    return found[0]


@pytest.mark.parametrize("whose", ["server", "caller"])
def test_every_call_right_after_a_reconnect_is_answered(
    net: Net, whose: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2767, 2454. As soon as the session has its router again, the first call is answered: our wait
    for a service bridges the gap."""
    monkeypatch.setattr("helios_core.zenoh_bus.DISCOVERY_S", 5.0)  # the machine may be busy
    bus = {"server": net.server, "caller": net.caller}[whose]
    for _ in range(CUTS):
        net.links[whose].cut()
        wait_until(lambda: not bus._router_ids(), 60, "the session has lost its router")
        net.links[whose].restore()
        wait_until(bus._router_ids, 60, "the session has a router again")
        assert [net.call(10.0) for _ in range(3)] == ["a"] * 3


def test_a_call_that_meets_a_new_router_waits_for_its_services(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2767. The caller is back before the server: an empty reply says nothing about the server."""
    net.caller._met_s = -1e9  # long ago
    net.links["server"].cut()
    net.kill_router()
    with pytest.raises(Unavailable, match="nobody serves"):
        net.call()
    known = net.caller._router_ids()
    net.start_router()
    wait_until(lambda: net.caller._router_ids() - known, 60, "the caller is back")
    threading.Timer(2 * DISCOVERY_S, net.links["server"].restore).start()
    monkeypatch.setattr("helios_core.zenoh_bus.MEETING_S", 20.0)  # the machine may be busy
    assert net.call(30.0) == "a"


def test_a_frozen_link_ends_in_a_typed_error(net: Net) -> None:
    """2454: a query that waits for a lost peer must not outlive its time by far."""
    net.links["caller"].hold()
    errors: list[HeliosError] = []

    def call() -> None:
        try:
            net.call(1.0)
        except HeliosError as error:
            errors.append(error)

    threading.Thread(target=call, daemon=True).start()
    wait_until(lambda: errors, 60, "the call has ended with an error")
    net.links["caller"].restore()
    wait_until(lambda: _answers(net), 60, "calls are answered again")


def test_the_token_of_a_client_that_is_gone_does_not_stay(net: Net) -> None:
    """2602, with one router: after a cut, a held link and a killed router."""
    net.links["server"].cut()
    wait_until(lambda: net.alive["one"] is False, 60, "the token is gone after a cut")
    net.links["server"].restore()
    wait_until(lambda: net.alive["one"], 60, "it is back")
    net.links["server"].hold()
    wait_until(lambda: net.alive["one"] is False, 60, "it is gone after the lease")
    net.links["server"].restore()
    wait_until(lambda: net.alive["one"], 60, "it is back")
    net.links["server"].cut()
    net.kill_router()
    net.start_router()
    late: dict[str, bool] = {}
    other = _opened(f"tcp/127.0.0.1:{net.port}")
    other.watch(lambda service, instance, alive: late.update({instance: alive}))
    other.announce("planner", "two")
    wait_until(lambda: late.get("two"), 60, "the newcomer hears tokens")
    other.close()
    assert "one" not in late
    assert net.alive["one"] is False


def test_a_call_made_when_a_token_arrives_is_answered(net: Net) -> None:
    """588. The call comes from the liveliness handler, at the first moment it could."""
    found: list[object] = []

    def ask(alive: bool) -> None:
        if alive:
            try:
                found.append(net.call())
            except HeliosError as error:
                found.append(error)

    net.on_alive = ask
    for n in range(CUTS):
        net.links["server"].cut()
        wait_until(lambda: net.alive["one"] is False, 60, "the token is gone")
        net.links["server"].restore()
        wait_until(lambda n=n: len(found) > n, 60, "the token is back")
    assert found == ["a"] * CUTS


def _answers(net: Net) -> bool:
    try:
        return net.call() == "a"
    except HeliosError:
        return False
