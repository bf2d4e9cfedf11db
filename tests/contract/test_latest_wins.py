"""Tests latest-wins topics on a full link: the newest message arrives once, others do not wait."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
import zenoh
from helios_chaos.relay import Relay
from helios_core import proto as pb
from helios_core import zenoh_config
from helios_core.latest_value_sender import PAUSES_S
from helios_core.topics import FRAME, QoS
from helios_core.zenoh_bus import ZenohBus

from tests.support import wait_until

MESSAGES = 60
SIZE = 300_000  # bytes; together the messages exceed the buffers of a link


def _frame(seq: int, size: int = 0) -> pb.Frame:
    frame = pb.Frame(id=pb.FrameId(seq=seq))
    frame.raw_color.data = bytes(size)
    return frame


@pytest.fixture
def link(router: str, zenoh_bus: ZenohBus) -> Iterator[Relay]:
    host, _, port = router.removeprefix("tcp/").rpartition(":")
    link = Relay((host, int(port)))
    yield link
    link.close()


@pytest.fixture
def make_bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], ZenohBus]]:
    """Buses without shared memory, as between machines."""

    def config(router: str) -> zenoh.Config:
        out = zenoh_config.client_config(router)
        out.insert_json5("transport/shared_memory/enabled", json.dumps(False))
        return out

    monkeypatch.setattr("helios_core.zenoh_bus.client_config", config)
    made: list[ZenohBus] = []

    def make(router: str) -> ZenohBus:
        made.append(ZenohBus(router, "r"))
        return made[-1]

    yield make
    for bus in made:
        bus.close()


def test_the_newest_message_arrives_over_a_blocked_link_and_other_subscribers_do_not_wait(
    make_bus: Callable[[str], ZenohBus], router: str, link: Relay
) -> None:
    sender, near, far = make_bus(router), make_bus(router), make_bus(link.endpoint)
    heard: dict[str, list[int]] = {"near": [], "far": []}
    near.subscribe(FRAME, lambda m: heard["near"].append(m.id.seq))
    far.subscribe(FRAME, lambda m: heard["far"].append(m.id.seq))
    wait_until(
        lambda: sender.publish(FRAME, _frame(0)) or all(heard.values()), 60, "the three are joined"
    )
    link.hold()
    for seq in range(1, MESSAGES + 1):
        sender.publish(FRAME, _frame(seq, SIZE))
    wait_until(lambda: heard["near"][-1] == MESSAGES, 60, "the near reader has the newest")
    assert MESSAGES not in heard["far"]
    link.restore()
    wait_until(lambda: heard["far"][-1] == MESSAGES, 60, "the far reader has the newest")
    for seqs in heard.values():
        numbered = [seq for seq in seqs if seq]
        assert numbered == sorted(set(numbered))


def test_a_subscriber_handles_a_repeated_message_once(
    zenoh_bus: ZenohBus, session: zenoh.Session
) -> None:
    heard: list[int] = []
    every: list[int] = []  # of a reader that wants every message, as the recorder does
    zenoh_bus.subscribe(FRAME, lambda m: heard.append(m.id.seq))
    zenoh_bus.subscribe(replace(FRAME, qos=QoS.NEVER_DROP), lambda m: every.append(m.id.seq))
    sent: list[zenoh.Sample] = []
    session.declare_subscriber(FRAME.key("r"), sent.append)
    wait_until(
        lambda: zenoh_bus.publish(FRAME, _frame(0)) or (heard and every and sent),
        60,
        "all are joined",
    )
    zenoh_bus.publish(FRAME, _frame(7))

    def times_sent() -> int:
        return sum(pb.Frame.FromString(s.payload.to_bytes()).id.seq == 7 for s in list(sent))

    wait_until(lambda: times_sent() > 2, 2 * sum(PAUSES_S[:3]) + 5, "it was repeated twice")
    assert heard.count(7) == every.count(7) == 1
