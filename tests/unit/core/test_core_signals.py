"""Signals are handled wherever the main thread is."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

# The main thread holds the event's own lock for nearly all of the time.
HOLDS_THE_LOCK = """
import signal, sys, threading
from helios_core.signal_handling import on_signals
stopped = threading.Event()
on_signals([signal.SIGTERM], stopped.set)
print("up", flush=True)
while not stopped.is_set():
    with stopped._cond:
        sum(range(20000))
"""

HANGS = """
import ctypes
def hang(library):
    mutex = ctypes.create_string_buffer(256)
    library.pthread_mutex_init(mutex, None)
    while True:
        library.pthread_mutex_lock(mutex)
"""

# The main thread waits in a library, and no signal ends that wait.
WAITS_IN_A_LIBRARY = f"""{HANGS}
import os, signal, threading
from helios_core.signal_handling import on_signals
on_signals([signal.SIGTERM], lambda: os._exit(0))
threading.Timer(0.3, print, ["up"], {{"flush": True}}).start()
hang(ctypes.CDLL(None))
"""

# A library hangs after the stop and holds the interpreter's own lock, so no Python code runs.
HINDERS_ALL_PYTHON = f"""{HANGS}
import signal, threading, time
from helios_core.signal_handling import stop_on_signals
stopped = threading.Event()
stop_on_signals(stopped)
print("up", flush=True)
stopped.wait()
while not signal.getitimer(signal.ITIMER_REAL)[0]:
    time.sleep(0.01)
hang(ctypes.PyDLL(None))
"""


@pytest.mark.parametrize(
    ("program", "status"),
    [(HOLDS_THE_LOCK, 0), (WAITS_IN_A_LIBRARY, 0), (HINDERS_ALL_PYTHON, -signal.SIGALRM)],
)
def test_a_signal_ends_the_process_whatever_its_main_thread_does(program: str, status: int) -> None:
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == status
    finally:
        process.kill()
        process.communicate()
