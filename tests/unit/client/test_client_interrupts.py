"""Interrupt signals: each is raised once, at a point where it does no harm."""

from __future__ import annotations

import contextlib
import signal

import pytest
from helios_client.interrupt_signals import NUMBERS, BurstHandler, noted_interrupts

from tests.support import wait_until


@pytest.fixture(autouse=True)
def restore_signal_handlers():
    before = {number: signal.getsignal(number) for number in NUMBERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_is_noted_and_raised_by_check(number: signal.Signals) -> None:
    with noted_interrupts() as interrupts:
        signal.raise_signal(number)
        wait_until(lambda: interrupts.came, 60, "it is noted")
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()


def test_a_long_computation_is_interrupted_once() -> None:
    cleaned = False

    def compute() -> None:
        nonlocal cleaned
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)  # must not raise within the clean-up
            cleaned = True

    with noted_interrupts() as interrupts:
        with pytest.raises(KeyboardInterrupt), interrupts.raised():
            compute()
        assert cleaned


def swallow() -> None:
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_swallowed_interrupt_is_raised_again_at_the_end() -> None:
    with noted_interrupts() as interrupts, pytest.raises(KeyboardInterrupt), interrupts.raised():
        swallow()


def test_only_the_first_signal_of_each_burst_raises(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bursts, now_s = BurstHandler(), 100.0
    monkeypatch.setattr("helios_client.interrupt_signals.time.monotonic", lambda: now_s)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            bursts()
        for _ in range(20):
            now_s += 0.1
            bursts()
        now_s += 1.0


def test_a_signal_before_a_long_computation_is_raised_at_its_start() -> None:
    with noted_interrupts() as interrupts:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt), interrupts.raised():
            pytest.fail("it began")


def test_signal_handlers_are_restored_unless_the_command_is_ending() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    with noted_interrupts():
        pass
    assert [signal.getsignal(number) for number in NUMBERS] == before
    with noted_interrupts():
        signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)  # does nothing
