"""A recorder that was started by hand when its terminal session closes."""

from __future__ import annotations

import signal
import subprocess
import sys

from helios_core.signal_handling import ending_signals

from tests.support import ENDS_WITHIN_S, free_port


def test_a_closed_session_ends_a_recorder_like_ctrl_c() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "helios_recorder", "--router", f"tcp/127.0.0.1:{free_port()}"],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        assert "waiting for the router" in process.stderr.readline()
        process.send_signal(signal.SIGHUP)
        assert process.wait(ENDS_WITHIN_S) == 0
    finally:
        process.kill()
        process.communicate()


def test_a_recorder_started_with_nohup_outlives_its_session() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert set(ending_signals()) == {signal.SIGTERM, signal.SIGINT}
    finally:
        signal.signal(signal.SIGHUP, before)
    assert signal.SIGHUP in ending_signals()
