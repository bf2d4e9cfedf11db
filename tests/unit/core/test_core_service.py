"""What services share at their start."""

from __future__ import annotations

import threading

from helios_core.health import Health
from helios_core.service import until_warm


def test_kernels_that_cannot_be_compiled_are_said_and_tried_again() -> None:
    health, said = Health(), []
    faults: list[Exception | None] = [RuntimeError("no compiler"), MemoryError(), None]

    def compile() -> None:
        said.append(health.state)
        if fault := faults.pop(0):
            raise fault

    assert until_warm(health, compile, threading.Event(), again_s=0.0)
    assert said[1][0] == "degraded"
    assert "RuntimeError: no compiler" in said[1][1]
    assert "MemoryError" in said[2][1]


def test_whoever_ends_does_not_wait_for_kernels() -> None:
    ending = threading.Event()

    def compile() -> None:
        ending.set()
        raise RuntimeError("no compiler")

    assert not until_warm(Health(), compile, ending, again_s=60.0)
