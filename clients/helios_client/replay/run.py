"""`helios replay`: play a data set once through the services, in lockstep, and collect the
results."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from helios_core.agent_presets import DEFAULT_AGENT
from helios_core.bus import Bus
from helios_core.codec import context_to_proto
from helios_core.errors import DeadlineExceeded, HeliosError, InvalidInput, Unavailable
from helios_core.topics import CONTEXT
from helios_core.types import SearchContext
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from helios_client.interrupt_signals import Interrupts
from helios_client.replay.frame_answers import FrameAcks
from helios_client.replay.input_checks import examine
from helios_client.replay.progress import ReplayMonitor
from helios_client.replay.results import Results, collect, unreadable_frames
from helios_client.supervision.child_process import ProcessSpec
from helios_client.supervision.forked_process import fork_server_for
from helios_client.supervision.model_check import check_models
from helios_client.supervision.service_specs import StackOptions, free_port
from helios_client.supervision.service_table import ServiceTable
from helios_client.supervision.supervisor import Supervisor
from helios_client.usage_errors import UsageError

CHECK_PERIOD_S = 0.05
FLUSH_S = 1.5  # services report every second: wait for their counts of the last frame


@dataclass(frozen=True)
class PlaybackOptions:
    """Part of the source to play, and its speed."""

    limit: int = 0  # number of frames; 0: all
    from_s: float = 0.0  # seconds into the recording
    to_s: float | None = None  # None: its end
    rate: float = 0.0  # speed; 1: as recorded; 0: without waiting
    free_running: bool = False
    topics: str = ""  # topic names in a ROS bag
    strict: bool = False  # end at an unreadable frame


@dataclass(frozen=True)
class ReplayJob:
    """Input, searches, detector and output of one replay."""

    source: Path
    context: SearchContext | None  # None: the searches of the recording
    detector: str
    out: Path
    playback: PlaybackOptions = PlaybackOptions()
    agent: str = DEFAULT_AGENT  # agent whose settings the object map uses
    start_s: float = 300.0  # longest time until every service is ready, model loading included
    patience_s: float = 180.0  # longest time without a new frame

    @property
    def log_dir(self) -> Path:
        return self.out / "logs"


def replay(job: ReplayJob, interrupts: Interrupts, console: Console) -> Results:
    """Play the source to its end or to an interrupt (`interrupted` in the summary). Starts
    processes of its own on a free port, and ends them all.

    Raises HeliosError if the data set, the detector or a class does not exist, or if there is no
    progress; KeyboardInterrupt if interrupted before any frame was mapped.
    """
    began_s = time.monotonic()
    with interrupts.raised():
        known = examine(job, console)
    check_models((job.detector,))
    try:
        job.log_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(
            f"--out {job.out} cannot be used ({error.filename}: {error.strerror}); choose another"
        ) from error
    playback = job.playback
    stack = StackOptions(
        robot="replay", router_port=free_port(), state_dir=job.out, detector=job.detector,
        source=job.source, limit=playback.limit, from_s=playback.from_s, to_s=playback.to_s,
        rate=playback.rate, topics=playback.topics or None, contexts=job.context is None,
        strict=playback.strict, lockstep=not playback.free_running,
        ack_timeout_s=job.patience_s, agent=job.agent,
    )  # fmt: skip
    job = replace(job, patience_s=job.patience_s + known.longest_wait_s)
    specs = stack.processes()
    with (
        _running(specs, stack.log_dir) as supervisor,
        _bus(stack, supervisor, job, interrupts) as bus,
    ):
        service_table, acks = ServiceTable(), FrameAcks()
        service_table.subscribe(bus, [spec.name for spec in specs])
        acks.listen(bus)
        if job.context is not None:
            bus.publish(CONTEXT, context_to_proto(job.context))
        watch = ReplayMonitor(job, known, service_table, console)
        _play(watch, supervisor, acks, interrupts, console)
        _settle(supervisor, interrupts)
        interrupted = interrupts.came
        if not interrupted:
            watch.classes.check(service_table, over=True, console=console)
            _say_unreadable(unreadable_frames(service_table), known.frames, job, console)
        results = collect(bus, acks, service_table, known.frames, time.monotonic() - began_s)
        more = {"lost": known.lost, "interrupted": interrupted}
        return replace(results, summary=results.summary | more)


@contextlib.contextmanager
def _running(specs: Sequence[ProcessSpec], log_dir: Path) -> Iterator[Supervisor]:
    """Started processes, which end after the block."""
    with fork_server_for(several=True) as server:
        supervisor = Supervisor(specs, log_dir, restart=False, fork_server=server)
        supervisor.start()
        try:
            yield supervisor
        finally:
            supervisor.stop()


@contextlib.contextmanager
def _bus(
    stack: StackOptions, supervisor: Supervisor, job: ReplayJob, interrupts: Interrupts
) -> Iterator[Bus]:
    from helios_core.zenoh_bus import ZenohBus

    deadline_s = time.monotonic() + job.start_s
    while True:
        interrupts.check()
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
    watch: ReplayMonitor,
    supervisor: Supervisor,
    acks: FrameAcks,
    interrupts: Interrupts,
    console: Console,
) -> None:
    """Show progress until the recording ends or an interrupt comes. Raises HeliosError if a process
    ends or there is no progress, and KeyboardInterrupt for an interrupt before any frame was
    mapped."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[pace]}"),
    )
    began_s = time.monotonic()
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("starting the services", total=watch.known.frames, pace="")
        while not (acks.finished or interrupts.came):
            acks.wait_finished(CHECK_PERIOD_S)
            _check(supervisor)
            description = watch.check_progress(supervisor.table(), acks)
            pace = f"{acks.pace_ms:.0f} ms per frame" if acks.frames > 1 else ""
            progress.update(bar, completed=acks.finished_frames, description=description, pace=pace)
        if not acks.occupancy_frames:
            interrupts.check()
        progress.update(bar, completed=acks.occupancy_frames)
    console.print(
        f"{acks.occupancy_frames} frames in {time.monotonic() - began_s:.1f} s", highlight=False
    )


def _check(supervisor: Supervisor) -> None:
    for name, ending in supervisor.check():
        said = ending.reason.removeprefix(f"helios-{name}: ")
        kind = UsageError if ending.usage_error else HeliosError
        raise kind(f"{name} ended: {said}")


def _settle(supervisor: Supervisor, interrupts: Interrupts) -> None:
    deadline_s = time.monotonic() + FLUSH_S
    while time.monotonic() < deadline_s and not interrupts.came:
        _check(supervisor)
        time.sleep(CHECK_PERIOD_S)


def _say_unreadable(unreadable: int, total: int, job: ReplayJob, console: Console) -> None:
    """Report unreadable frames, if any. Raises InvalidInput if no frame is readable."""
    where = f"{job.log_dir / 'bridge.log'} lists them"
    if unreadable >= total:
        raise InvalidInput(f"none of the {total} frames of {job.source} can be read; {where}")
    if unreadable:
        console.print(
            f"[yellow]{unreadable} of {total} frames could not be read and were skipped[/]; "
            f"{escape(where)}",
            soft_wrap=True,
        )
