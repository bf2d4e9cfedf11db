"""SIGHUP as an exception: the terminal of a command has closed, for example with its SSH
connection."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class HungUp(BaseException):
    """The terminal was closed. The message names the work that goes on."""


@contextmanager
def hangup_raises(sentence: str) -> Iterator[None]:
    """Context that raises HungUp with the sentence on SIGHUP: once, in the main thread, and not if
    SIGHUP is ignored (`nohup`)."""
    number = getattr(signal, "SIGHUP", None)  # not on every system
    in_main = threading.current_thread() is threading.main_thread()
    if number is None or not in_main or signal.getsignal(number) is signal.SIG_IGN:
        yield
        return
    came = False

    def raise_once(*_: object) -> None:
        nonlocal came
        if not came:
            came = True
            raise HungUp(sentence)

    before = signal.signal(number, raise_once)
    try:
        yield
    except OSError as error:  # the closed terminal cannot be written to
        if came:
            raise HungUp(sentence) from error
        raise
    finally:
        signal.signal(number, before)
