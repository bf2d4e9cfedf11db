"""The relay between a service and its router: bytes arrive in order, or the link is cut."""

from __future__ import annotations

import random
import socket
import threading
import time
from collections.abc import Iterator

import pytest
from helios_chaos.relay import RESEND_S, SEGMENT, LinkQuality, Relay

from tests.support import free_port, wait_until


class Echo:
    """A server that sends everything back, and a relay to it."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.relay = Relay(self._server.getsockname())
        threading.Thread(target=self._accept, daemon=True).start()

    def connected(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.relay.port), 10)

    def close(self) -> None:
        self.relay.close()
        self._server.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            threading.Thread(target=self._echo, args=(client,), daemon=True).start()

    def _echo(self, client: socket.socket) -> None:
        try:
            while data := client.recv(1 << 16):
                client.sendall(data)
            client.shutdown(socket.SHUT_WR)
        except OSError:
            pass


@pytest.fixture
def echo() -> Iterator[Echo]:
    out = Echo()
    yield out
    out.close()


def received(client: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size and (part := client.recv(1 << 16)):
        data += part
    return data


@pytest.mark.parametrize(
    "quality", [LinkQuality(), LinkQuality(0.002, 0.004, loss=0.002, reorder=0.1)]
)
def test_every_byte_arrives_in_order(echo: Echo, quality: LinkQuality) -> None:
    echo.relay.slow(quality)
    sent = random.Random(1).randbytes(300_000)
    with echo.connected() as client:
        threading.Thread(target=client.sendall, args=(sent,), daemon=True).start()
        assert received(client, len(sent)) == sent


def test_a_delay_holds_in_both_directions(echo: Echo) -> None:
    echo.relay.slow(LinkQuality(0.1))
    with echo.connected() as client:
        began_s = time.monotonic()
        client.sendall(b"a")
        assert received(client, 1) == b"a"
        assert time.monotonic() - began_s >= 0.2


def test_a_cut_ends_connections_and_refuses_new_ones_until_it_is_restored(echo: Echo) -> None:
    with echo.connected() as client:
        client.sendall(b"a")
        assert received(client, 1) == b"a"
        echo.relay.cut()
        assert not _answers(client)
    with echo.connected() as refused:
        assert not _answers(refused)
    echo.relay.restore()
    with echo.connected() as client:
        assert _answers(client)


def test_a_held_link_delivers_afterwards(echo: Echo) -> None:
    with echo.connected() as client:
        echo.relay.hold()
        client.sendall(b"late")
        client.settimeout(0.2)
        with pytest.raises(TimeoutError):
            client.recv(1)
        echo.relay.restore()
        client.settimeout(10)
        assert received(client, 4) == b"late"


def test_a_router_that_is_away_is_tried_again_by_the_next_connection() -> None:
    port = free_port()
    relay = Relay(("127.0.0.1", port))
    with socket.create_connection(("127.0.0.1", relay.port), 10) as early:
        assert not _answers(early)
    with socket.create_server(("127.0.0.1", port)) as server:
        late = socket.create_connection(("127.0.0.1", relay.port), 10)
        server.settimeout(10)
        server.accept()[0].close()
        late.close()
    relay.close()


def test_a_closed_relay_leaves_no_thread() -> None:
    before = set(threading.enumerate())
    echo = Echo()
    with echo.connected() as client:
        assert _answers(client)
        echo.relay.cut()
    echo.close()
    relay_threads = [t for t in threading.enumerate() if t not in before and "relay" in t.name]
    wait_until(lambda: not any(t.is_alive() for t in relay_threads), 60, "they end")


def test_loss_costs_the_time_of_a_repeated_segment() -> None:
    lossy = LinkQuality(loss=1.0)
    assert lossy.lateness_s(10 * SEGMENT, random.Random(0)) == pytest.approx(10 * RESEND_S)
    assert LinkQuality(0.1).lateness_s(10 * SEGMENT, random.Random(0)) == 0.1


def _answers(client: socket.socket) -> bool:
    try:
        client.sendall(b"x")
        return received(client, 1) == b"x"
    except OSError:
        return False
