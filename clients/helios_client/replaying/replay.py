"""`helios replay`: a data set through the services, once, in lockstep, and what they made of it."""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from helios_core.bus import Bus
from helios_core.codec import context_to_proto
from helios_core.errors import DeadlineExceeded, HeliosError, InvalidInput, Unavailable
from helios_core.topics import CONTEXT
from helios_core.types import SearchContext
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from helios_client.replaying.results import Results, collect, unreadable_frames
from helios_client.replaying.tally import Tally
from helios_client.supervision.board import Board, ServiceRow
from helios_client.supervision.stack import Stack, free_port
from helios_client.supervision.supervisor import Supervisor
from helios_client.wrong_use import WrongUse

CHECK_PERIOD_S = 0.05
SAY_WAITING_S = 5.0  # whoever is not ready then is named on the screen
TROUBLE_S = 3.0  # a service that is degraded so long while nothing moves has said the last word
FLUSH_S = 1.5  # services report every second: their figures of the last frame


@dataclass(frozen=True)
class Pace:
    """Which part to play, and how."""

    limit: int = 0  # frames; 0: all
    from_s: float = 0.0  # seconds into it
    to_s: float | None = None  # None: its end
    rate: float = 0.0  # 1: as it was recorded; 0: without waiting
    free_running: bool = False
    topics: str = ""  # of a ROS bag
    strict: bool = False  # end at a frame that cannot be read


@dataclass(frozen=True)
class ReplayJob:
    """What to play and what to look for."""

    source: Path
    context: SearchContext | None  # None: the searches of the recording
    detector: str
    out: Path
    pace: Pace = Pace()
    start_s: float = 300.0  # longest time until every service is ready; models are loaded in it
    patience_s: float = 180.0  # longest time without a new frame

    @property
    def log_dir(self) -> Path:
        return self.out / "logs"


def replay(job: ReplayJob, console: Console) -> Results:
    """Play it to its end; processes of its own on a free port, none of which is left.

    Raises HeliosError: the data set, the detector or a class is not there, or nothing moves.
    """
    began_s = time.monotonic()
    total, longest_s = _examine(job, console)
    try:
        job.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"--out {job.out} cannot be made: {error.strerror}") from error
    pace = job.pace
    stack = Stack(
        robot="replay", router_port=free_port(), state_dir=job.out, detector=job.detector,
        source=job.source, limit=pace.limit, from_s=pace.from_s, to_s=pace.to_s, rate=pace.rate,
        topics=pace.topics or None, contexts=job.context is None, strict=pace.strict,
        lockstep=not pace.free_running, ack_timeout_s=job.patience_s,
    )  # fmt: skip
    job = replace(job, patience_s=job.patience_s + longest_s)
    specs = stack.specs()
    supervisor = Supervisor(specs, stack.log_dir, restart=False)
    supervisor.start()
    try:
        with _bus(stack, supervisor, job) as bus:
            board, tally = Board(), Tally()
            board.listen(bus, [spec.name for spec in specs])
            tally.listen(bus)
            if job.context is not None:
                bus.publish(CONTEXT, context_to_proto(job.context))
            _play(job, total, supervisor, board, tally, console)
            _settle(supervisor, FLUSH_S)
            _say_unreadable(unreadable_frames(board), total, job, console)
            return collect(bus, tally, board, total, time.monotonic() - began_s)
    finally:
        supervisor.stop()


def _examine(job: ReplayJob, console: Console) -> tuple[int, float]:
    """(frames, longest wait between two of them in seconds). Raises InvalidInput."""
    from helios_replay.opening import open_source  # late: OpenCV
    from helios_replay.source import Part

    pace = job.pace
    to_s = math.inf if pace.to_s is None else pace.to_s
    source = open_source(job.source, Part(pace.limit, pace.from_s, to_s, pace.topics))
    if cut := getattr(source, "cut", ""):
        console.print(f"[yellow]read up to where it is cut off[/]: {escape(cut)}", soft_wrap=True)
    if source.left_out:
        console.print(f"[yellow]{escape(source.left_out)}[/]", soft_wrap=True)
    if job.context is None and not any(source.contexts_before(i) for i in range(len(source.shots))):
        raise InvalidInput(
            f"{job.source} holds no search; say what to look for with --classes and --detector"
        )
    waits_s = [b.time_s - a.time_s for a, b in itertools.pairwise(source.shots)]
    return len(source.shots), max(waits_s, default=0.0) / pace.rate if pace.rate else 0.0


@contextlib.contextmanager
def _bus(stack: Stack, supervisor: Supervisor, job: ReplayJob) -> Iterator[Bus]:
    from helios_core.zenoh_bus import ZenohBus

    deadline_s = time.monotonic() + job.start_s
    while True:
        _check(supervisor)
        try:
            bus = ZenohBus(stack.router, stack.name)
            break
        except Unavailable as error:
            if time.monotonic() > deadline_s:
                raise DeadlineExceeded(
                    f"the router did not start within {job.start_s:g} s; its log is "
                    f"{job.log_dir / 'router.log'}"
                ) from error
            time.sleep(CHECK_PERIOD_S)
    try:
        yield bus
    finally:
        bus.close()


def _play(
    job: ReplayJob,
    total: int,
    supervisor: Supervisor,
    board: Board,
    tally: Tally,
    console: Console,
) -> None:
    """Until the recording is over. Raises when a process ends or nothing moves any more."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("{task.fields[pace]}"),
    )  # fmt: skip
    began_s = moved_s = time.monotonic()
    frames, started = 0, False
    trouble_since_s: float | None = None
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("starting the services", total=total, pace="")
        while not tally.finished:
            time.sleep(CHECK_PERIOD_S)
            _check(supervisor)
            now_s = time.monotonic()
            if not started:
                late = [r for r in board.rows(supervisor.table()) if r.state != "ready"]
                if not late:
                    started, moved_s = True, now_s
                    progress.update(bar, description="the first frame")
                elif now_s - began_s > job.start_s:
                    raise DeadlineExceeded(_not_started(job, late))
                elif now_s - began_s > SAY_WAITING_S:
                    names = ", ".join(row.name for row in late)
                    progress.update(bar, description=f"waiting for {escape(names)}")
            if tally.frames > frames:
                started = True
                frames, moved_s = tally.frames, now_s
                pace = f"{tally.pace_ms:.0f} ms a frame"
                progress.update(bar, completed=frames, description="frames", pace=pace)
            trouble = _trouble(supervisor, board)
            if not trouble:
                trouble_since_s = None
            elif trouble_since_s is None:
                trouble_since_s = now_s
            elif now_s - max(trouble_since_s, moved_s) > TROUBLE_S:
                raise Unavailable(trouble)
            if now_s - moved_s > job.patience_s:
                raise DeadlineExceeded(_stalled(job, frames, total, supervisor, board))
        progress.update(bar, completed=tally.frames)
    console.print(f"{tally.frames} frames in {time.monotonic() - began_s:.1f} s", highlight=False)


def _check(supervisor: Supervisor) -> None:
    for name, ending in supervisor.check():
        said = ending.reason.removeprefix(f"helios-{name}: ")
        kind = WrongUse if ending.usage_error else HeliosError
        raise kind(f"{name} ended: {said}")


def _settle(supervisor: Supervisor, seconds: float) -> None:
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        _check(supervisor)
        time.sleep(CHECK_PERIOD_S)


def _trouble(supervisor: Supervisor, board: Board) -> str:
    """What a service says that cannot go on; empty when all is well."""
    for row in board.rows(supervisor.table()):
        # A detector waits for nothing but its model; what others wait for is still to come.
        missing = row.name == "detector" and row.state == "waiting"
        if row.state == "degraded" or (missing and not row.reason.startswith("loading")):
            return f"{row.name}: {row.reason}"
    return ""


def _say_unreadable(unreadable: int, total: int, job: ReplayJob, console: Console) -> None:
    """Raises InvalidInput when there was nothing else."""
    where = f"{job.log_dir / 'bridge.log'} names each"
    if unreadable >= total:
        raise InvalidInput(f"none of the {total} frames of {job.source} can be read; {where}")
    if unreadable:
        console.print(
            f"[yellow]{unreadable} of {total} frames could not be read and were left out[/]; "
            f"{escape(where)}",
            soft_wrap=True,
        )


def _not_started(job: ReplayJob, late: Sequence[ServiceRow]) -> str:
    """Of each that is not ready: what it says, and where its log is."""
    each = [
        f"{r.name} is {r.state} ({r.reason or 'it has said nothing yet'}; log "
        f"{job.log_dir / f'{r.name}.log'})"
        for r in late
    ]
    return f"the services were not ready within {job.start_s:g} s: {'; '.join(each)}"


def _stalled(job: ReplayJob, frames: int, total: int, supervisor: Supervisor, board: Board) -> str:
    rows = board.rows(supervisor.table())
    waiting = "; ".join(f"{r.name} is {r.state} {r.reason}".strip() for r in rows)
    return (
        f"no new frame for {job.patience_s:g} s after {frames} of {total} ({waiting}); see the "
        f"logs in {job.log_dir}"
    )
