"""Run of `helios view`: a source and its sinks until it is stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from google.protobuf.message import Message
from helios_core.errors import Unavailable
from helios_core.router_link import RouterLink
from helios_core.viewing.channels import CHANNELS
from helios_core.viewing.entry import Entry
from helios_core.zenoh_bus import ZenohBus

if TYPE_CHECKING:
    from helios_viewers.foxglove_sink import FoxgloveSink

Say = Callable[[str], None]


@dataclass(frozen=True)
class ViewOptions:
    """Options of `helios view`."""

    recording: Path | None = None  # None: the running robot
    router: RouterLink | None = None  # of the running robot
    robot: str = "robot"
    foxglove_port: int | None = None  # None: no Foxglove
    rerun_port: int | None = None  # None: no server of Rerun
    web_port: int = 9090  # of Rerun's page
    save: Path | None = None  # file for Rerun
    speed: float = 1.0  # of a recording in Foxglove; 1: as recorded

    @property
    def name(self) -> str:
        """What is viewed, for the viewers' titles."""
        return self.recording.name if self.recording else self.robot


class Sink(Protocol):
    """Receiver of entries."""

    def show(self, log_time_ns: int, entry: Entry) -> None: ...
    def close(self) -> None: ...


def view(options: ViewOptions, stopping: threading.Event, say: Say) -> None:
    """View until `stopping` is set; a file alone ends with the recording. Raises HeliosError."""
    with ExitStack() as opened:
        if options.recording is not None:
            _view_recording(options, options.recording, stopping, say, opened)
        else:
            _view_robot(options, stopping, say, opened)


def _view_robot(
    options: ViewOptions, stopping: threading.Event, say: Say, opened: ExitStack
) -> None:
    from helios_viewers.live_source import LiveSource

    assert options.router is not None
    bus = opened.enter_context(closing(ZenohBus(options.router, options.robot)))
    sinks = _rerun_sinks(options, stopping, say, opened)
    if options.foxglove_port is not None:
        sinks.append(_foxglove(options, options.foxglove_port, CHANNELS, None, say, opened))
    source = opened.enter_context(closing(LiveSource(bus)))
    say("showing the running robot; Ctrl-C ends it")
    for log_time_ns, entry in source.until(stopping):
        for sink in sinks:
            sink.show(log_time_ns, entry)


def _view_recording(
    options: ViewOptions, path: Path, stopping: threading.Event, say: Say, opened: ExitStack
) -> None:
    """Rerun gets everything at once, as it has its own time line; then Foxglove plays it."""
    from helios_viewers.recorded_source import RecordedSource

    source = RecordedSource(path)
    player = None
    sinks = _rerun_sinks(options, stopping, say, opened)
    if options.foxglove_port is not None:
        from helios_viewers.playback import Player

        foxglove = _foxglove(
            options, options.foxglove_port, source.channels, source.range_ns, say, opened
        )
        player = Player(source, foxglove.show, foxglove.report, options.speed)
        foxglove.control = player.control
    if sinks:
        for log_time_ns, entry in source:
            if stopping.is_set():
                return
            for sink in sinks:
                sink.show(log_time_ns, entry)
        say(f"Rerun has all of {path}")
    if player is not None:
        say(f"playing {path}; Ctrl-C ends it")
        player.run(stopping)
    elif options.rerun_port is not None:
        say("Ctrl-C ends it")
        stopping.wait()
    if source.unreadable:
        say(f"{source.unreadable} messages of {path} could not be read")


def _foxglove(
    options: ViewOptions,
    port: int,
    channels: Mapping[str, type[Message]],
    range_ns: tuple[int, int] | None,
    say: Say,
    opened: ExitStack,
) -> FoxgloveSink:
    try:
        from helios_viewers.foxglove_sink import FoxgloveSink
    except ImportError as error:
        raise missing_extra("foxglove", error) from error
    sink = opened.enter_context(closing(FoxgloveSink(port, options.name, channels, range_ns)))
    say(f"Foxglove: open connection {sink.address}; layout: deploy/viewers/foxglove-layout.json")
    return sink


def _rerun_sinks(
    options: ViewOptions, stopping: threading.Event, say: Say, opened: ExitStack
) -> list[Sink]:
    if options.rerun_port is None and options.save is None:
        return []
    try:
        from helios_viewers.rerun_server import RerunServer
        from helios_viewers.rerun_sink import file_sink, server_sink
    except ImportError as error:
        raise missing_extra("rerun", error) from error
    out: list[Sink] = []
    if options.save is not None:
        out.append(opened.enter_context(file_sink(options.save, options.name)))
        say(f"Rerun: saving {options.save}")
    if options.rerun_port is not None:
        server = RerunServer(options.rerun_port, options.web_port, stopping)
        opened.enter_context(closing(server))
        out.append(opened.enter_context(closing(server_sink(server.url, options.name))))
        say(f"Rerun: open {server.page}, or run `rerun {server.url}`")
    return out


def missing_extra(extra: str, error: ImportError) -> Unavailable:
    return Unavailable(
        f"helios view --{extra} needs a package that is missing ({error}); "
        f"pip install 'helios-ovmm[{extra}]'"
    )
