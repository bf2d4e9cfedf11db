"""Typed errors, the same in Python and on the wire.

    HeliosError
    ├── InvalidInput       the request is wrong; a retry does not help
    ├── Unavailable        no service can answer now; retry later
    ├── DeadlineExceeded   no response within the deadline
    ├── Conflict           refused in the present state (lease, epoch, context, stop)
    └── Internal           a fault in the service

The text of an error gives the value received, the value expected, and what to do.
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
    """The request is wrong; a retry does not help."""

    kind = pb.ERROR_KIND_INVALID


class Unavailable(HeliosError):
    """No service can answer now; retry later."""

    kind = pb.ERROR_KIND_UNAVAILABLE


class DeadlineExceeded(HeliosError):
    """No response arrived within the deadline."""

    kind = pb.ERROR_KIND_TIMEOUT


class Conflict(HeliosError):
    """The request is refused in the present state (lease, epoch, context, stop)."""

    kind = pb.ERROR_KIND_CONFLICT


class Internal(HeliosError):
    """A fault in the service."""

    kind = pb.ERROR_KIND_INTERNAL


_BY_KIND: dict[int, type[HeliosError]] = {
    c.kind: c for c in (InvalidInput, Unavailable, DeadlineExceeded, Conflict, Internal)
}


def error_to_proto(error: Exception) -> pb.Error:
    """Message of any exception; one that is no HeliosError becomes an internal error."""
    if isinstance(error, HeliosError):
        return pb.Error(kind=error.kind, message=error.message)
    return pb.Error(kind=pb.ERROR_KIND_INTERNAL, message=f"{type(error).__name__}: {error}")


def error_from_proto(error: pb.Error) -> HeliosError:
    """Exception of an error message."""
    return _BY_KIND.get(error.kind, Internal)(error.message)
