"""Schemas and channels of an MCAP file that is being written."""

from __future__ import annotations

from google.protobuf.message import Message
from mcap.records import Channel, Schema
from mcap.writer import Writer

from helios_core.viewing.channel_schema import ENCODING, schema_of


class McapChannels:
    """Registers each channel, with the schema of its messages, when it is first used."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self.channels: dict[str, Channel] = {}  # topic -> channel
        self.schemas: dict[str, Schema] = {}  # name -> schema

    def channel(self, topic: str, kind: type[Message]) -> Channel:
        """Channel of a topic with messages of that type."""
        known = self.channels.get(topic)
        if known is not None:
            return known
        name = kind.DESCRIPTOR.full_name
        schema = self.schemas.get(name)
        if schema is None:
            data = schema_of(kind)
            id = self._writer.register_schema(name, ENCODING, data)
            schema = self.schemas[name] = Schema(id, data, ENCODING, name)
        id = self._writer.register_channel(topic, ENCODING, schema.id)
        channel = self.channels[topic] = Channel(id, topic, ENCODING, {}, schema.id)
        return channel
