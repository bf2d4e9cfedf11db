"""What a run cannot play is skipped with its reason; the wall clock of a process can jump alone."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helios_chaos import isolation, wall_clock
from helios_chaos.schedule import KINDS
from helios_chaos.wall_clock import WallClock

TELL = """
import sys, time
for _ in sys.stdin:
    print(time.time(), time.monotonic(), flush=True)
"""


def test_without_namespaces_disk_and_rate_are_skipped_with_the_reason() -> None:
    able = isolation.abilities(False, "not permitted")
    assert {"disk", "rate"} <= set(able.skipped)
    assert "not permitted" in able.skipped["disk"]
    assert not {"disk", "rate"} & set(able.playable())
    assert {"kill", "freeze", "cut"} <= set(able.playable())


def test_without_a_compiler_the_clock_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wall_clock, "missing", lambda: "there is no C compiler")
    able = isolation.abilities(False, "")
    assert "no C compiler" in able.skipped["clock"]
    assert set(able.playable(("kill", "clock"))) == {"kill"}
    assert set(able.skipped) <= set(KINDS)


@pytest.mark.skipif(bool(wall_clock.missing()), reason=wall_clock.missing())
def test_the_wall_clock_jumps_and_the_monotonic_clock_does_not(tmp_path: Path) -> None:
    clock = WallClock(tmp_path)
    process = subprocess.Popen(
        [sys.executable, "-c", TELL],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | clock.environment,
    )

    def told() -> tuple[float, float]:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("\n")
        process.stdin.flush()
        wall_s, monotonic_s = map(float, process.stdout.readline().split())
        return wall_s - time.time(), monotonic_s - time.monotonic()

    try:
        for offset_s in (0.0, -3600.5, 30.25):
            clock.jump_to(offset_s)
            assert told() == pytest.approx((offset_s, 0.0), abs=2.0)
    finally:
        process.communicate(timeout=10)
