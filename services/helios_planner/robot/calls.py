"""Calls to services that may be away for a while."""

from __future__ import annotations

import time
from collections.abc import Callable

from helios_core.errors import DeadlineExceeded, HeliosError, Unavailable
from helios_core.topics import Rep

from helios_planner.task import Cause, TaskFailed

RETRY_S = 0.3


def patiently(
    ask: Callable[[], Rep],
    away_s: float,
    rest: Callable[[float], None],
    refusals: tuple[type[HeliosError], ...] = (),
    waits: Callable[[HeliosError], None] = lambda _: None,
) -> Rep:
    """Ask until answered, for as long as a service may be away. waits: hears why it is not."""
    deadline = time.monotonic() + away_s
    while True:
        try:
            return ask()
        except refusals:
            raise
        except (Unavailable, DeadlineExceeded) as error:
            if time.monotonic() > deadline:
                raise TaskFailed(
                    Cause.SYSTEM_ERROR, f"{error.message} (waited {away_s:.0f} s)"
                ) from error
            waits(error)
            rest(RETRY_S)
        except HeliosError as error:
            raise system_error(error) from error


def system_error(error: HeliosError) -> TaskFailed:
    """The end of a task by an error of a service."""
    return TaskFailed(Cause.SYSTEM_ERROR, error.message)
