"""Encoding of requests and replies of a method for Zenoh; large replies are split into pieces."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Callable, Iterator

import zenoh
from google.protobuf.message import DecodeError

from helios_core import proto as pb
from helios_core import tracing
from helios_core.errors import (
    HeliosError,
    Internal,
    InvalidInput,
    error_from_proto,
    error_to_proto,
)
from helios_core.topics import Method, Rep, Req

log = logging.getLogger(__name__)

CHUNK_BYTES = 512 * 1024  # size of a piece: a single 30 MB reply closed a slow transport
ERROR_ENCODING = "application/protobuf;helios.v1.Error"
HEAD = re.compile(rb"([0-9]{1,9})/([0-9]{1,9})/(-|[0-9a-f]{16})")  # see `pieces_of`


def request_of(method: Method[Req, Rep], data: bytes) -> Req:
    """Request in a query's payload. Raises InvalidInput for other bytes."""
    try:
        return method.request.FromString(data)
    except DecodeError as error:
        raise InvalidInput(
            f"the {len(data)} bytes sent to {method.name} are no "
            f"{method.request.DESCRIPTOR.full_name}; send that message"
        ) from error


def reply_of(method: Method[Req, Rep], data: bytes) -> Rep:
    """Reply in the assembled bytes. Raises Internal for other bytes."""
    try:
        return method.reply.FromString(data)
    except DecodeError as error:
        raise Internal(
            f"the {len(data)} bytes that {method.name} answered are no "
            f"{method.reply.DESCRIPTOR.full_name}; run one version of HELIOS everywhere"
        ) from error


def error_of(method: Method, data: bytes) -> HeliosError:
    """Typed error in the bytes of an error reply; Internal for other bytes."""
    try:
        return error_from_proto(pb.Error.FromString(data))
    except DecodeError:
        return Internal(
            f"{method.name} answered with an error of {len(data)} bytes that are no "
            f"{pb.Error.DESCRIPTOR.full_name}; run one version of HELIOS everywhere"
        )


def answer(
    query: zenoh.Query, key: str, method: Method[Req, Rep], handler: Callable[[Req], Rep]
) -> None:
    """Reply to a query with the handler's result or exception. Raises zenoh.ZError if no reply can
    be sent."""
    with query:
        try:
            data = query.payload.to_bytes() if query.payload is not None else b""
            attached = query.attachment.to_bytes() if query.attachment is not None else None
            with tracing.served(method.name, attached):
                reply = handler(request_of(method, data)).SerializeToString()
        except Exception as error:
            if not isinstance(error, HeliosError):
                log.exception("the handler of %s failed", method.name)
            query.reply_err(error_to_proto(error).SerializeToString(), encoding=ERROR_ENCODING)
            return
        for piece, head in pieces_of(reply):
            query.reply(key, piece, attachment=head)


def pieces_of(data: bytes) -> Iterator[tuple[bytes, str]]:
    """Pieces of at most CHUNK_BYTES, each with `index/count/hash of the whole`."""
    count = max(1, -(-len(data) // CHUNK_BYTES))
    digest = hashlib.blake2b(data, digest_size=8).hexdigest() if count > 1 else "-"
    for i in range(count):
        yield data[i * CHUNK_BYTES : (i + 1) * CHUNK_BYTES], f"{i}/{count}/{digest}"


def assembled(method: Method, replies: zenoh.Handler[zenoh.Reply]) -> bytes | None:
    """Complete reply; None without any reply.

    Raises the typed error of an error reply, TimeoutError, and Internal for missing or invalid
    pieces.
    """
    parts: dict[int, bytes] = {}
    count, digest = 0, "-"
    for reply in replies:
        if reply.err is not None:
            payload = reply.err.payload.to_bytes()
            if str(reply.err.encoding) == ERROR_ENCODING:
                raise error_of(method, payload)
            raise TimeoutError  # the only error that Zenoh itself replies with: "Timeout"
        sample = reply.ok
        if sample is None:
            continue
        head = sample.attachment.to_bytes() if sample.attachment is not None else b"0/1/-"
        index, count, digest = _head(method, head)
        parts[index] = sample.payload.to_bytes()
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


def _head(method: Method, head: bytes) -> tuple[int, int, str]:
    """(index, count, hash) of one piece."""
    found = HEAD.fullmatch(head)
    if found is None or int(found[1]) >= int(found[2]):
        shown = head[:40].decode(errors="replace")
        raise Internal(
            f"{method.name} answered with the attachment “{shown}” where `index/count/hash` of a "
            "piece was wanted; see who else serves it, and run one version of HELIOS everywhere"
        )
    return int(found[1]), int(found[2]), found[3].decode()
