"""Entries to the WebSocket server of the Foxglove SDK, which any Foxglove app can open.

A viewer that connects late gets the last message of each channel.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import foxglove
from foxglove.channel import Channel
from foxglove.websocket import (
    ChannelView,
    Client,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)
from google.protobuf.message import Message
from helios_core.errors import Conflict
from helios_core.viewing.channel_schema import ENCODING, schema_of
from helios_core.viewing.entry import Entry

from helios_viewers.playback import PlayerState

HOST = "127.0.0.1"
Control = Callable[[bool, float, int | None], PlayerState]  # as `Player.control`


class FoxgloveSink:
    """A running server. `show` is for one thread; the server's threads only answer viewers."""

    def __init__(
        self,
        port: int,
        name: str,  # shown by the app
        channels: Mapping[str, type[Message]],
        range_ns: tuple[int, int] | None = None,  # of a recording, which the app can then control
    ) -> None:
        """channels: those known before. The SDK announces a later channel before it accepts
        subscriptions of it, and so refuses a quick viewer. Raises Conflict if the port is in use.
        """
        self._context = foxglove.Context()
        self._channels = {name: self._declared(name, kind) for name, kind in channels.items()}
        self._last: dict[str, tuple[bytes, int]] = {}  # channel -> message and its log time
        self._lock = threading.Lock()
        self._state: PlayerState | None = None
        self.control: Control | None = None  # set by the owner of a recording's player
        try:
            self._server = foxglove.start_server(
                name=name,
                host=HOST,
                port=port,
                context=self._context,
                server_listener=_Listener(self),
                playback_time_range=range_ns,
                capabilities=[foxglove.Capability.Time] if range_ns else [],
            )
        except (OSError, RuntimeError) as error:
            raise Conflict(
                f"the Foxglove server cannot listen on port {port} ({error}); choose another with "
                "--foxglove-port"
            ) from error

    @property
    def address(self) -> str:
        return f"ws://{HOST}:{self._server.port}"

    def show(self, log_time_ns: int, entry: Entry) -> None:
        """Send an entry to all viewers, on a channel of its own type."""
        channel = self._channels.get(entry.channel)
        if channel is None:
            channel = self._declared(entry.channel, type(entry.message))
            self._channels[entry.channel] = channel
        data = entry.message.SerializeToString()
        with self._lock:
            self._last[entry.channel] = data, log_time_ns
        channel.log(data, log_time=log_time_ns)

    def _declared(self, name: str, kind: type[Message]) -> Channel:
        schema = foxglove.Schema(
            name=kind.DESCRIPTOR.full_name, encoding=ENCODING, data=schema_of(kind)
        )
        return Channel(name, schema=schema, message_encoding=ENCODING, context=self._context)

    def report(self, state: PlayerState) -> None:
        """Tell the viewers where the playback of a recording is."""
        self._server.broadcast_time(state.time_ns)
        before, self._state = self._state, state
        if (
            before is None
            or state.sought
            or (before.playing, before.ended, before.speed)
            != (state.playing, state.ended, state.speed)
        ):
            self._server.broadcast_playback_state(playback_state(state, None))

    def on_subscribe(self, topic: str) -> None:
        """Repeat the last message of a channel for a new viewer."""
        with self._lock:
            last = self._last.get(topic)
        channel = self._channels.get(topic)
        if last is not None and channel is not None:
            channel.log(last[0], log_time=last[1])

    def close(self) -> None:
        self._server.stop()


class _Listener(ServerListener):
    def __init__(self, sink: FoxgloveSink) -> None:
        self._sink = sink

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._sink.on_subscribe(channel.topic)

    def on_playback_control_request(
        self, playback_control_request: PlaybackControlRequest
    ) -> PlaybackState | None:
        request = playback_control_request
        if self._sink.control is None:
            return None
        playing = request.playback_command == PlaybackCommand.Play
        state = self._sink.control(playing, request.playback_speed, request.seek_time)
        return playback_state(state, request.request_id)


def playback_state(state: PlayerState, request_id: str | None) -> PlaybackState:
    """The SDK's message. request_id: the request that it answers."""
    status = PlaybackStatus.Playing if state.playing else PlaybackStatus.Paused
    if state.ended:
        status = PlaybackStatus.Ended
    return PlaybackState(status, state.time_ns, state.speed, state.sought, request_id)
