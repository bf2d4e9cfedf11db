"""Progress of a running replay: the service that it waits for, and failures that end it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from helios_core.errors import DeadlineExceeded, Unavailable
from rich.console import Console
from rich.markup import escape

from helios_client.replay.frame_answers import FrameAcks
from helios_client.replay.results import status_count
from helios_client.supervision.service_table import ServiceRow, ServiceTable
from helios_client.supervision.supervisor import ProcessInfo
from helios_client.usage_errors import UsageError

if TYPE_CHECKING:
    from helios_client.replay.input_checks import CheckedInput
    from helios_client.replay.run import ReplayJob


SAY_WAITING_S = 5.0  # after this, services that are not ready are named on the screen
TROUBLE_S = 3.0  # a service degraded this long without progress ends the replay


class ReplayMonitor:
    """Monitor of a running replay; see `check_progress`."""

    def __init__(
        self, job: ReplayJob, known: CheckedInput, service_table: ServiceTable, console: Console
    ) -> None:
        self._job, self.known, self._service_table, self._console = (
            job,
            known,
            service_table,
            console,
        )
        self.classes = UnknownClassReport(job.detector, known.searches)
        self._began_s = self._moved_s = time.monotonic()
        self._heard = (0, 0)  # numbers of finished and of mapped frames
        self._started = False
        self._trouble_since_s: float | None = None

    def check_progress(self, table: Sequence[ProcessInfo], acks: FrameAcks) -> str:
        """Current activity in a few words, for the screen. Raises HeliosError if the replay cannot
        go on."""
        now_s, rows = time.monotonic(), self._service_table.rows(table)
        heard = (acks.finished_frames, acks.occupancy_frames)
        if heard != self._heard:
            self._heard, self._moved_s, self._started = heard, now_s, True
        self.classes.check(self._service_table, over=False, console=self._console)
        late = [] if self._started else [r for r in rows if r.state != "ready"]
        if not late and not self._started:
            self._started, self._moved_s = True, now_s
        if late and now_s - self._began_s > self._job.start_s:
            raise DeadlineExceeded(_not_started(self._job, late))
        self._check_trouble(failure_reason(rows, self._service_table), now_s)
        still_s = now_s - self._moved_s
        if self._started and still_s > self._job.patience_s:
            raise DeadlineExceeded(_stalled(self._job, heard[0], self.known.frames, rows))
        if late:
            names = ", ".join(row.name for row in late)
            is_long = now_s - self._began_s > SAY_WAITING_S
            return f"waiting for {escape(names)}" if is_long else "starting the services"
        if still_s > SAY_WAITING_S:
            return f"waiting for {escape(waits_for(rows, self._job.playback.rate))}"
        return "frames" if heard[1] else "the first frame"

    def _check_trouble(self, trouble: str, now_s: float) -> None:
        if not trouble:
            self._trouble_since_s = None
        elif self._trouble_since_s is None:
            self._trouble_since_s = now_s
        elif now_s - max(self._trouble_since_s, self._moved_s) > TROUBLE_S:
            raise Unavailable(trouble)


def failure_reason(rows: Sequence[ServiceRow], service_table: ServiceTable) -> str:
    """Status reason of a service that cannot go on; empty if there is none."""
    for row in rows:
        # A detector waits only for its model; other services wait for input that is still to come.
        missing = row.name == "detector" and row.state == "waiting"
        degraded = row.state == "degraded" and not (
            row.name == "detector" and _goes_on(service_table)
        )
        if degraded or (missing and not row.reason.startswith("loading")):
            return f"{row.name}: {row.reason}"
    return ""


def waits_for(rows: Sequence[ServiceRow], rate: float = 0.0) -> str:
    """Cause of the wait, as the services report it. rate: speed of the replay, as `--rate`."""
    if said := [f"{r.name}: {r.reason}" for r in rows if r.reason]:
        return "; ".join(said)
    if rate:
        return f"the time of the next frame in the recording (--rate {rate:g})"
    return "a response; no service reports a reason"


class UnknownClassReport:
    """Reports the sought classes that the detector does not know."""

    def __init__(self, detector: str, searches: Sequence[frozenset[str]]) -> None:
        """searches: class names of each search of the replay."""
        self._detector, self._kinds = detector, frozenset(searches)
        self._printed: set[str] = set()

    def check(self, service_table: ServiceTable, over: bool, console: Console) -> None:
        """Print new findings. over: no further search will come. Raises UsageError if the detector
        knows no class of any search."""
        status = service_table.status("detector")
        if status is None or status.state != "degraded":
            return
        unknown = status_count(service_table, "detector", "contexts_unknown")
        sought = status_count(service_table, "detector", "contexts_sought")
        if unknown and not sought and (over or len(self._kinds) == 1):
            raise UsageError(
                f"the detector {self._detector} knows none of the classes to find: {status.reason}"
            )
        refused = status_count(service_table, "detector", "classes_refused")
        if refused and status.reason not in self._printed:
            self._printed.add(status.reason)
            console.print(f"[yellow]not searched for[/]: {escape(status.reason)}", soft_wrap=True)


def _goes_on(service_table: ServiceTable) -> bool:
    """True if the detector is degraded only because it does not know some class."""
    failed = status_count(service_table, "detector", "keyframes_failed")
    return bool(status_count(service_table, "detector", "classes_refused")) and not failed


def _not_started(job: ReplayJob, late: Sequence[ServiceRow]) -> str:
    """Sentence with state, reason and log of each service that is not ready."""
    each = [
        f"{r.name} is {r.state} ({r.reason or 'no report yet'}; log "
        f"{job.log_dir / f'{r.name}.log'})"
        for r in late
    ]
    return f"the services were not ready within {job.start_s:g} s: {'; '.join(each)}"


def _stalled(job: ReplayJob, over: int, total: int, rows: Sequence[ServiceRow]) -> str:
    waiting = "; ".join(f"{r.name} is {r.state} {r.reason}".strip() for r in rows)
    return (
        f"no new frame for {job.patience_s:g} s after {over} of {total} ({waiting}); see the "
        f"logs in {job.log_dir}"
    )
