"""A signal sets an event, wherever the main thread is."""

from __future__ import annotations

import signal
import subprocess
import sys

# The main thread holds the event's own lock for nearly all of the time.
HOLDS_THE_LOCK = """
import signal, sys, threading
from helios_core.signals import on_signals
stopped = threading.Event()
on_signals([signal.SIGTERM], stopped.set)
print("up", flush=True)
while not stopped.is_set():
    with stopped._cond:
        sum(range(20000))
"""


def test_a_signal_that_meets_the_events_lock_is_not_lost() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDS_THE_LOCK], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.communicate()
