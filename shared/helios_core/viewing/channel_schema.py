"""Schemas of the messages, as recordings and viewers need them."""

from __future__ import annotations

from functools import cache
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

ENCODING = "protobuf"


@cache
def schema_of(kind: type[Message]) -> bytes:
    """FileDescriptorSet of a message type, including all its imports, each before its users."""
    out = FileDescriptorSet()
    seen: set[str] = set()

    def add(file: Any) -> None:
        if file.name in seen:
            return
        seen.add(file.name)
        for needed in file.dependencies:
            add(needed)
        file.CopyToProto(out.file.add())

    add(kind.DESCRIPTOR.file)
    return out.SerializeToString()
