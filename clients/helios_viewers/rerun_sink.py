"""Entries to Rerun: to its server, or into a file."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
from helios_core.atomic_file import replacing, unwritable_reason
from helios_core.errors import InvalidInput
from helios_core.viewing.entry import Entry

from helios_viewers.rerun_entities import entities_of, fixed_entities
from helios_viewers.rerun_layout import APPLICATION, TIMELINE, layout

log = logging.getLogger(__name__)

FLUSH_WITHIN_S = 10.0


class RerunSink:
    """A stream of entities to a server or a file. Not thread-safe."""

    def __init__(self, stream: rr.RecordingStream, name: str) -> None:
        """stream: with its sink set. name: shown by the viewer."""
        self._stream = stream
        stream.send_recording_name(name)
        stream.send_blueprint(layout(), make_active=True)
        for path, content in fixed_entities():
            stream.log(path, content, static=True)

    def show(self, log_time_ns: int, entry: Entry) -> None:
        """Log the entities of an entry at its time. A broken entry is reported and left out."""
        try:
            entities = list(entities_of(entry))
        except InvalidInput as error:
            log.warning("a message of %s cannot be shown: %s", entry.channel, error.message)
            return
        self._stream.set_time(TIMELINE, timestamp=np.datetime64(log_time_ns, "ns"))
        for path, content in entities:
            self._stream.log(path, content)

    def close(self) -> None:
        """Send or write what is left."""
        self._stream.flush(timeout_sec=FLUSH_WITHIN_S)
        self._stream.disconnect()


def new_stream() -> rr.RecordingStream:
    """Stream without Rerun's own timelines, which would have this machine's time."""
    stream = rr.RecordingStream(APPLICATION)
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


@contextmanager
def file_sink(path: Path, name: str) -> Iterator[RerunSink]:
    """Sink into an .rrd file, which replaces an older one when the block ends without an error.

    Devices and pipes are written directly. Raises InvalidInput if the file cannot be written.
    """
    stream = new_stream()
    with ExitStack() as opened:
        try:
            if why := unwritable_reason(path):
                raise InvalidInput(why)
            is_special = path.exists() and not path.is_file()
            stream.save(path if is_special else opened.enter_context(replacing(path)))
        except (OSError, RuntimeError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise InvalidInput(
                f"{path} cannot be written ({why}); name another file with --save"
            ) from error
        yield opened.enter_context(closing(RerunSink(stream, name)))


def server_sink(url: str, name: str) -> RerunSink:
    """Sink to a running server of Rerun."""
    stream = new_stream()
    stream.connect_grpc(url)
    return RerunSink(stream, name)
