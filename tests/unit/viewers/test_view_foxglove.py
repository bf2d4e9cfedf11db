"""`helios view --foxglove`: a client of Foxglove's protocol receives every channel."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
from helios_core.errors import Unavailable
from helios_core.recording_format import GAUSSIANS
from helios_core.zenoh_bus import ZenohBus
from helios_viewers.recorded_source import RecordedSource, message_type

from tests.support import ENDS_WITHIN_S, free_port, wait_until
from tests.unit.viewers.viewed_robot import (
    DRAWN,
    FoxgloveClient,
    maps_on,
    publish_all,
    start_view,
)

pytest.importorskip("foxglove", reason="pip install 'helios-ovmm[foxglove]'")
PLAYBACK_REQUEST = 3  # opcode of the client


def client_of(port: int) -> FoxgloveClient:
    opened: list[FoxgloveClient] = []

    def connected() -> bool:
        with suppress(OSError):
            opened.append(FoxgloveClient(port))
        return bool(opened)

    wait_until(connected, 60, "the server listens")
    return opened[0]


def end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    assert process.wait(ENDS_WITHIN_S) == 0


def test_a_client_receives_every_channel_of_a_recording(recorded: Path) -> None:
    port = free_port()
    process = start_view(str(recorded), "--foxglove", "--foxglove-port", str(port))
    try:
        with closing(client_of(port)) as client:
            wanted = RecordedSource(recorded).channels

            def has_all() -> bool:
                client.receive_all()
                return client.messages.keys() >= wanted.keys()

            assert wanted.keys() >= DRAWN
            wait_until(has_all, 60, "every channel has a message")
            assert client.schemas[GAUSSIANS] == "foxglove.PointCloud"
            for channel, messages in client.messages.items():
                kind = message_type(client.schemas[channel])
                assert kind is not None
                kind.FromString(messages[0][1])  # the data is of the advertised type
        with closing(client_of(port)) as late:  # after the end of this short recording

            def late_has_all() -> bool:
                late.receive_all()
                return late.messages.keys() >= wanted.keys()

            wait_until(late_has_all, 60, "a late client gets the last message of each channel")
    finally:
        end(process)


def test_a_client_can_jump_back_in_a_recording(recorded: Path) -> None:
    port = free_port()
    begin_ns, end_ns = RecordedSource(recorded).range_ns
    process = start_view(
        str(recorded), "--foxglove", "--foxglove-port", str(port), "--speed", "1000"
    )
    try:
        with closing(client_of(port)) as client:

            def played(at_ns: int) -> bool:
                client.receive_all()
                times = [t for messages in client.messages.values() for t, _ in messages]
                return at_ns in times

            wait_until(lambda: played(end_ns), 60, "it is at the end")
            told = next(m for m in client.other if m["op"] == "serverInfo")
            assert "playbackControl" in told["capabilities"]
            client.messages.clear()
            id = b"jump"
            body = struct.pack("<BBfBQI", PLAYBACK_REQUEST, 0, 1.0, 1, begin_ns, len(id))
            client.socket.send(body + id)
            wait_until(lambda: played(begin_ns), 60, "the first message comes again")
    finally:
        end(process)


@pytest.fixture
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", endpoint])
    yield endpoint
    process.terminate()
    process.wait(ENDS_WITHIN_S)


def test_a_client_receives_every_channel_of_a_running_robot(router: str) -> None:
    """The robot goes on publishing, so that the viewer may come at any time."""
    opened: list[ZenohBus] = []

    def connected() -> bool:
        with suppress(Unavailable):
            opened.append(ZenohBus(router))
        return bool(opened)

    wait_until(connected, 60, "the router is up")
    port, seq = free_port(), 0
    with closing(opened[0]) as bus:
        maps = maps_on(bus)
        process = start_view("--router", router, "--foxglove", "--foxglove-port", str(port))
        try:
            with closing(client_of(port)) as client:

                def has_all() -> bool:
                    nonlocal seq
                    publish_all(bus, maps, seq)
                    seq += 1
                    client.receive_all()
                    return client.messages.keys() >= DRAWN

                wait_until(has_all, 60, "every channel has a message")
        finally:
            end(process)
