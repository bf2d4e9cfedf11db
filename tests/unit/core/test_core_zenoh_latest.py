"""The newest message is repeated until a newer one follows, and is read once."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import zenoh
from helios_core.latest_value_sender import PAUSES_S, REMEMBERED, DuplicateFilter, Repeater
from helios_core.shared_payloads import Payload
from hypothesis import given
from hypothesis import strategies as st


class Wire:
    """Records what is sent; `now_s` is its clock."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.sent: list[tuple[Payload, str]] = []
        self.broken: Exception | None = None
        self.jobs: list[str] = []
        self.repeater = Repeater(self._start, lambda: self.now_s)

    def put(self, payload: Payload, *, attachment: str) -> None:
        if self.broken is not None:
            raise self.broken
        self.sent.append((payload, attachment))

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.repeater.repeat_due()

    def _start(self, name: str, job: Callable[[], None]) -> None:
        self.jobs.append(name)


def test_the_newest_message_is_repeated_a_fixed_number_of_times() -> None:
    wire = Wire()
    wire.repeater.send("a", wire.put, b"one")
    for pause_s in PAUSES_S:
        wire.wait(pause_s / 2)
        before = len(wire.sent)
        wire.wait(pause_s / 2)
        assert len(wire.sent) == before + 1
    wire.wait(1000)
    assert wire.sent == [wire.sent[0]] * (1 + len(PAUSES_S))
    assert len(wire.jobs) == 1


@pytest.mark.parametrize("fault", [RuntimeError("closed"), TypeError("bytes"), KeyError("x")])
def test_an_exception_in_one_topic_is_logged_and_ends_no_repetitions(
    fault: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    wire = Wire()
    good: list[Payload] = []

    def put(payload: Payload, *, attachment: str) -> None:
        good.append(payload)

    wire.repeater.send("a", wire.put, b"one")
    wire.repeater.send("b", put, b"other")
    wire.broken = fault
    wire.wait(PAUSES_S[0])
    assert good == [b"other"] * 2
    assert "could not be repeated" in caplog.text
    wire.broken = None
    wire.wait(PAUSES_S[1])
    assert good == [b"other"] * 3
    assert [data for data, _ in wire.sent] == [b"one"] * 2


def test_a_newer_message_ends_the_repetitions_of_the_old_one() -> None:
    wire = Wire()
    wire.repeater.send("a", wire.put, b"one")
    wire.repeater.send("b", wire.put, b"other")
    wire.wait(PAUSES_S[0] / 2)
    wire.repeater.send("a", wire.put, b"two")
    for _ in range(50):
        wire.wait(1)
    assert [data for data, _ in wire.sent].count(b"one") == 1
    assert [data for data, _ in wire.sent].count(b"two") == 1 + len(PAUSES_S)
    assert [data for data, _ in wire.sent].count(b"other") == 1 + len(PAUSES_S)


def test_a_failed_repetition_is_retried_and_a_failed_first_send_raises() -> None:
    wire = Wire()
    wire.repeater.send("a", wire.put, b"one")
    wire.broken = zenoh.ZError("no router")
    wire.wait(PAUSES_S[0])
    with pytest.raises(zenoh.ZError):
        wire.repeater.send("a", wire.put, b"two")
    wire.broken = None
    wire.wait(PAUSES_S[1])
    assert [data for data, _ in wire.sent] == [b"one", b"one"]
    assert wire.sent[0] == wire.sent[1]


@given(st.lists(st.integers(0, 9), max_size=30))
def test_a_reader_accepts_only_messages_newer_than_all_before(numbers: list[int]) -> None:
    unseen = DuplicateFilter()
    taken = [n for n in numbers if unseen.take(f"me/{n}".encode())]
    assert taken == sorted(set(taken))
    assert not numbers or taken[-1] == max(numbers)


@given(st.lists(st.binary(max_size=30) | st.none()))
def test_a_message_without_a_number_is_accepted(attachments: list[bytes | None]) -> None:
    unseen = DuplicateFilter()
    for attachment in attachments:
        if attachment is None or not attachment.rpartition(b"/")[2].isdigit():
            assert unseen.take(attachment)
        else:
            unseen.take(attachment)


def test_senders_are_distinguished_and_only_a_limited_number_is_remembered() -> None:
    unseen = DuplicateFilter()
    for k in range(REMEMBERED + 10):
        assert unseen.take(f"{k}/5".encode())
        assert not unseen.take(f"{k}/5".encode())
    assert unseen.take(b"0/5")  # forgotten
