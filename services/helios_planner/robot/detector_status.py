"""Status of the detector while a task runs."""

from __future__ import annotations

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import status_topic


class DetectorStatus:
    """Newest status of the detector. Bus threads write it, the task's thread reads it."""

    def __init__(self, bus: Bus) -> None:
        self._state, self._reason = "", ""
        self._noting, self._noted = False, ""
        self._registration = bus.subscribe(status_topic("detector"), self._on_status)

    @property
    def trouble(self) -> str:
        """Reason why it is not ready now; empty if it is, and before its first status."""
        return "" if self._state in ("", "ready") else self._reason

    @property
    def noted(self) -> str:
        """Reason why it is degraded, or last was since `note_from_now`; empty if it never was."""
        return self._reason if self._state == "degraded" else self._noted

    def note_from_now(self) -> None:
        """Record faults from now on; earlier ones belong to another search."""
        self._noting = True

    def close(self) -> None:
        self._registration.close()

    def _on_status(self, status: pb.ServiceStatus) -> None:
        self._reason, self._state = status.reason, status.state
        if self._noting and status.state == "degraded":
            self._noted = status.reason
