"""What becomes of an exception that nobody foresaw, where it would end a thread unseen."""

from __future__ import annotations

import logging
from collections.abc import Callable

from helios_core.errors import HeliosError, Internal
from helios_core.health import Health

log = logging.getLogger(__name__)


def typed(error: Exception) -> HeliosError:
    """The error itself, or what stands for one that nobody foresaw; that one is logged."""
    if isinstance(error, HeliosError):
        return error
    log.error("unforeseen", exc_info=error)
    return Internal(f"{type(error).__name__}: {error}; see the detector's log")


def ended_well(what: str, health: Health, job: Callable[[], None]) -> bool:
    """The last resort of a thread: where its job ends by an exception, `health` says what and why,
    and this is False."""
    try:
        job()
        return True
    except Exception as error:
        message = f"{what}: {typed(error).message}"
        log.error("%s", message)
        health.degraded(message)
        return False
