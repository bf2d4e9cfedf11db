"""Requests and replies of a method as bytes on Zenoh: large replies go in pieces."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import zenoh
from google.protobuf.message import DecodeError

from helios_core import proto as pb
from helios_core.errors import Internal, InvalidInput, error_from_proto
from helios_core.topics import Method, Rep, Req

CHUNK_BYTES = 512 * 1024  # larger replies are cut: one 30 MB reply closed a slow transport
ERROR_ENCODING = "application/protobuf;helios.v1.Error"


def request_of(method: Method[Req, Rep], data: bytes) -> Req:
    """What was asked. Raises InvalidInput for other bytes."""
    try:
        return method.request.FromString(data)
    except DecodeError as error:
        raise InvalidInput(
            f"the {len(data)} bytes sent to {method.name} are no "
            f"{method.request.DESCRIPTOR.full_name}; send that message"
        ) from error


def pieces_of(data: bytes) -> Iterator[tuple[bytes, str]]:
    """Pieces of at most CHUNK_BYTES with `index/count/hash of the whole`."""
    count = max(1, -(-len(data) // CHUNK_BYTES))
    digest = hashlib.blake2b(data, digest_size=8).hexdigest() if count > 1 else "-"
    for i in range(count):
        yield data[i * CHUNK_BYTES : (i + 1) * CHUNK_BYTES], f"{i}/{count}/{digest}"


def assembled(method: Method, replies: zenoh.Handler[zenoh.Reply]) -> bytes | None:
    """The whole reply; None when nothing came.

    Raises the typed error that was answered, and TimeoutError.
    """
    parts: dict[int, bytes] = {}
    count, digest = 0, "-"
    for reply in replies:
        if reply.err is not None:
            payload = reply.err.payload.to_bytes()
            if str(reply.err.encoding) == ERROR_ENCODING:
                raise error_from_proto(pb.Error.FromString(payload))
            raise TimeoutError  # the one error of Zenoh's own: its word "Timeout"
        sample = reply.ok
        if sample is None:
            continue
        head = sample.attachment.to_string() if sample.attachment is not None else "0/1/-"
        index, total, digest = head.split("/")
        count = int(total)
        parts[int(index)] = sample.payload.to_bytes()
    if not parts:
        return None
    data = b"".join(parts[i] for i in sorted(parts))
    whole = digest == "-" or hashlib.blake2b(data, digest_size=8).hexdigest() == digest
    if len(parts) != count or not whole:
        raise Internal(
            f"{method.name} answered {len(parts)} of {count} pieces; ask again, and if it happens "
            "again, the link loses data"
        )
    return data
