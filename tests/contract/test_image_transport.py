"""Tests of frames on the bus: in place here, the same bytes for everybody else, no memory lost."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from helios_core import orphaned_memory, shared_payloads, zenoh_config
from helios_core import proto as pb
from helios_core.image_messages import FrameMessage, ImageMessage, apart, split
from helios_core.topics import FRAME, KEYFRAME, OBSERVATION
from helios_core.zenoh_bus import ZenohBus
from helios_core.zenoh_config import client_config
from zenoh import shm

from tests.contract.conftest import MakeBus
from tests.support import wait_until

ENOUGH = 30  # frames: more than the sender's shared memory holds
linux_only = pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs Linux")

SENDER = """
import sys, time
from helios_core import proto as pb
from helios_core.image_messages import apart
from helios_core.topics import KEYFRAME
from helios_core.zenoh_bus import ZenohBus
bus = ZenohBus(sys.argv[1], "r")
message = apart(pb.Frame(raw_color={"data": bytes(1_500_000)}))
while True:
    bus.publish(KEYFRAME, message)
    time.sleep(0.05)
"""


def _frame(seq: int, size: int = 1_500_000) -> pb.Frame:
    out = pb.Frame()
    out.id.seq = seq
    out.raw_color.data = np.random.default_rng(seq).bytes(size)
    out.raw_depth.data = bytes([seq % 256]) * 1000
    return out


@pytest.fixture
def other(router: str) -> Iterator[zenoh.Session]:
    """A session of another program, which shares no memory, as on another machine."""
    config = client_config(router)
    config.insert_json5("transport/shared_memory/enabled", "false")
    session = zenoh.open(config)
    yield session
    session.close()


@pytest.mark.parametrize("topic", [FRAME, KEYFRAME])
def test_both_kinds_of_subscriber_get_the_frame(make_bus: MakeBus, topic) -> None:
    sender, receiver = make_bus("r"), make_bus("r")
    inplace: list[ImageMessage[pb.Frame]] = []
    whole: list[pb.Frame] = []
    receiver.subscribe_in_place(topic, inplace.append)
    receiver.subscribe(topic, whole.append)
    frame = _frame(1)

    def both() -> bool:
        sender.publish(topic, apart(frame))
        return bool(inplace and whole)

    wait_until(both, 60, "both subscribers hear the frame")
    assert inplace[0].whole() == frame == whole[0]
    assert all(image.readonly for image in inplace[0].images.values())


def test_an_observation_arrives_with_its_frame(make_bus: MakeBus) -> None:
    sender, receiver = make_bus("r"), make_bus("r")
    heard: list[ImageMessage[pb.Observation]] = []
    receiver.subscribe_in_place(OBSERVATION, heard.append)
    message = apart(pb.Observation(context_id="c", frame=_frame(2)))
    wait_until(lambda: sender.publish(OBSERVATION, message) or heard, 60, "it is heard")
    assert heard[0].frame.whole() == _frame(2)


def test_another_program_reads_and_writes_plain_protobuf(
    zenoh_bus: ZenohBus, other: zenoh.Session
) -> None:
    """Both ways, without shared memory: the payload is the serialised message."""
    theirs = other.declare_subscriber(KEYFRAME.key("r"), zenoh.handlers.FifoChannel(64))
    ours: list[FrameMessage] = []
    zenoh_bus.subscribe_in_place(KEYFRAME, ours.append)
    key, frame = KEYFRAME.key("r"), _frame(3)
    got: list[bytes] = []

    def heard() -> bool:
        zenoh_bus.publish(KEYFRAME, apart(frame))
        while (sample := theirs.handler.try_recv()) is not None:
            got.append(sample.payload.to_bytes())
        return bool(got)

    wait_until(heard, 60, "the other program hears the frame")
    assert pb.Frame.FromString(got[0]) == frame
    ours.clear()
    frame.id.seq = 4
    wait_until(
        lambda: other.put(key, frame.SerializeToString()) or any(m.id.seq == 4 for m in ours),
        60,
        "its frame is heard",
    )
    assert apart(next(m for m in ours if m.id.seq == 4)).whole() == frame


def test_a_subscriber_that_holds_every_payload_starves_nobody(
    zenoh_bus: ZenohBus, router: str
) -> None:
    """With its shared memory full, the sender goes on without it, and nothing is overwritten."""
    with zenoh.open(client_config(router)) as holder:
        slow = holder.declare_subscriber(KEYFRAME.key("r"), zenoh.handlers.FifoChannel(256))
        bus, heard = zenoh_bus, list[int]()
        receiver = ZenohBus(router, "r")
        receiver.subscribe_in_place(KEYFRAME, lambda m: heard.append(m.id.seq))
        held: list[zenoh.Sample] = []

        def ready() -> bool:
            bus.publish(KEYFRAME, apart(_frame(0, 10)))
            while (sample := slow.handler.try_recv()) is not None:
                held.append(sample)
            return bool(held and heard)

        wait_until(ready, 60, "both subscribers are there")
        held.clear()
        for seq in range(1, ENOUGH + 1):
            bus.publish(KEYFRAME, apart(_frame(seq)))
        wait_until(lambda: ENOUGH in heard, 60, "the sibling hears all")
        while len([s for s in held if len(s.payload) > 10**6]) < ENOUGH:
            held.append(slow.handler.recv())
        assert [s for s in heard if s] == list(range(1, ENOUGH + 1))
        frames = [split(pb.Frame, s.payload.to_bytes()) for s in held if len(s.payload) > 10**6]
        assert [f.whole() == _frame(f.id.seq) for f in frames] == [True] * ENOUGH
        receiver.close()


@linux_only
def test_the_memory_of_killed_senders_is_freed(
    zenoh_bus: ZenohBus, router: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while a subscriber that received from them runs."""
    monkeypatch.setattr(orphaned_memory, "GRACE_S", 0.0)
    heard: list[int] = []
    zenoh_bus.subscribe_in_place(KEYFRAME, lambda m: heard.append(len(m.images["raw_color"])))
    segments: list[Path] = []
    for _ in range(2):
        heard.clear()
        process = subprocess.Popen([sys.executable, "-c", SENDER, router])
        try:
            wait_until(lambda: len(heard) > 3, 60, "the sender is heard")
            segments += _segments_of(process.pid)
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()
    assert segments
    orphaned_memory.free_orphans_later()
    wait_until(lambda: not any(map(_bytes, segments)), 60, "their memory is freed")


def _segments_of(pid: int) -> list[Path]:
    """Memory that the record of a process names; its lock tells the process."""
    found: list[Path] = []
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        target = Path(os.readlink(fd))
        if target.suffix == orphaned_memory.SUFFIX:
            found += [orphaned_memory.FOLDER / name for name in target.read_text().split()]
    return found


def _bytes(path: Path) -> int:
    try:
        return path.stat().st_blocks
    except FileNotFoundError:
        return 0


def _refuse(*_: object) -> None:
    raise zenoh.ZError("Unable to create POSIX shm segment: OS error 28")


def test_without_shared_memory_frames_arrive_and_one_line_says_so(
    make_bus: MakeBus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    provider = type("ShmProvider", (), {"default_backend": staticmethod(_refuse)})
    monkeypatch.setattr(shared_payloads.shm, "ShmProvider", provider)
    payloads = shared_payloads.SharedPayloads()
    with caplog.at_level(logging.WARNING):
        sent = [payloads.of(apart(_frame(seq))) for seq in (1, 2)]
    assert [pb.Frame.FromString(bytes(data)) for data in sent] == [_frame(1), _frame(2)]
    assert [r.message.startswith("no shared memory") for r in caplog.records] == [True]
    assert shm.ShmProvider is provider


def test_a_session_opens_without_shared_memory(
    router: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    real, tried = zenoh.open, list[str]()

    def opened(config: zenoh.Config) -> zenoh.Session:
        tried.append(config.get_json("transport/shared_memory/enabled"))
        return real(config) if tried[-1] == "false" else _refuse()  # type: ignore[return-value]

    monkeypatch.setattr(zenoh_config.zenoh, "open", opened)
    session, shares = zenoh_config.open_session(client_config(router))
    session.close()
    assert not shares
    assert len(tried) == 2
    assert "no shared memory" in caplog.text
