"""Check that an address belongs to this machine."""

from __future__ import annotations

import socket

from helios_client.http.address import STANDARD_PORTS, split_url
from helios_client.usage_errors import UsageError


def local_port_of_url(url: str, elsewhere: str) -> int:
    """Port of a URL of this machine; the scheme may be missing.

    elsewhere: end of the error sentence for another machine, with the remedy; HOST in it stands for
    that machine. Raises UsageError for a URL of another machine and for an invalid URL.
    """
    try:
        parts = split_url(url)
    except ValueError as error:
        raise UsageError(str(error)) from error
    assert parts.hostname is not None
    if not _is_here(parts.hostname):
        said_instead = elsewhere.replace("HOST", parts.hostname)
        raise UsageError(f"{url} is not on this machine, so {said_instead}")
    return parts.port or STANDARD_PORTS[parts.scheme]


def _is_here(host: str) -> bool:
    """True if the host is this machine: a socket can be bound to one of its addresses."""
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)
    except OSError:
        return False
    for family, kind, protocol, _, address in found:
        try:
            with socket.socket(family, kind, protocol) as s:
                s.bind(address)
                return True
        except OSError:
            continue
    return False
