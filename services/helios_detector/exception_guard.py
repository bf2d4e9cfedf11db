"""Handling of unexpected exceptions that would otherwise end a thread silently."""

from __future__ import annotations

import logging
from collections.abc import Callable

from helios_core.errors import HeliosError, Internal
from helios_core.health import Health

log = logging.getLogger(__name__)


def typed(error: Exception) -> HeliosError:
    """The error itself if typed; an unexpected one is logged and returned as Internal."""
    if isinstance(error, HeliosError):
        return error
    log.error("unforeseen", exc_info=error)
    return Internal(f"{type(error).__name__}: {error}; see the detector's log")


def ended_well(what: str, health: Health, job: Callable[[], None]) -> bool:
    """Run a thread's job; True if it returns. On an exception `health` becomes degraded with
    `what` and the reason, and the result is False."""
    try:
        job()
        return True
    except Exception as error:
        message = f"{what}: {typed(error).message}"
        log.error("%s", message)
        health.degraded(message)
        return False
