"""Typed errors, the same in Python and on the wire.

    HeliosError
    ├── InvalidInput       the request is wrong; sending it again will not help
    ├── Unavailable        nobody could answer; try again later
    ├── DeadlineExceeded   no answer within the deadline
    ├── Conflict           refused because of the present state (lease, epoch, context, stop)
    └── Internal           a fault in the service

A message says what came, what was wanted and what to do.
"""

from __future__ import annotations

from typing import ClassVar

from helios_core import proto as pb


class HeliosError(Exception):
    """Base of all errors that cross a process boundary."""

    kind: ClassVar[pb.ErrorKind] = pb.ERROR_KIND_INTERNAL

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message


class InvalidInput(HeliosError):
    """The request is wrong; sending it again will not help."""

    kind = pb.ERROR_KIND_INVALID


class Unavailable(HeliosError):
    """Nobody could answer; try again later."""

    kind = pb.ERROR_KIND_UNAVAILABLE


class DeadlineExceeded(HeliosError):
    """No answer came within the deadline."""

    kind = pb.ERROR_KIND_TIMEOUT


class Conflict(HeliosError):
    """Refused because of the present state (lease, epoch, context, stop)."""

    kind = pb.ERROR_KIND_CONFLICT


class Internal(HeliosError):
    """A fault in the service."""

    kind = pb.ERROR_KIND_INTERNAL


_BY_KIND: dict[int, type[HeliosError]] = {
    c.kind: c for c in (InvalidInput, Unavailable, DeadlineExceeded, Conflict, Internal)
}


def error_to_proto(error: Exception) -> pb.Error:
    """The wire form of any exception; what is not a HeliosError is internal."""
    if isinstance(error, HeliosError):
        return pb.Error(kind=error.kind, message=error.message)
    return pb.Error(kind=pb.ERROR_KIND_INTERNAL, message=f"{type(error).__name__}: {error}")


def error_from_proto(error: pb.Error) -> HeliosError:
    """The exception that a wire error stands for."""
    return _BY_KIND.get(error.kind, Internal)(error.message)
