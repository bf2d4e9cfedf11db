"""Configurations of Zenoh sessions: one router, with every service as its client."""

from __future__ import annotations

import base64
import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from helios_core.errors import InvalidInput
from helios_core.router_link import RouterLink, check_readable
from helios_core.shared_payloads import WITHOUT

log = logging.getLogger(__name__)

LEASE_MS = 2000  # a peer without a sign of life is dropped after this time


@dataclass(frozen=True)
class Credentials:
    """Certificate of the authority, own certificate and own private key, each as PEM."""

    authority: bytes
    certificate: bytes
    key: bytes


def client_config(link: RouterLink | str) -> zenoh.Config:
    """Configuration of a client; a string is the endpoint, e.g. `tcp/127.0.0.1:7447`.

    Raises InvalidInput for an unusable session file, zenoh.ZError for a wrong endpoint.
    """
    link = RouterLink(link) if isinstance(link, str) else link
    if link.session is None:
        return _zenoh(client_values([link.endpoint]))
    config = _from_file(link.session)
    if link.endpoint:
        _use_endpoint(config, "connect", link.endpoint)
    return config


def open_session(config: zenoh.Config) -> tuple[zenoh.Session, bool]:
    """(open session, True if it can share memory with other processes of this machine).

    Without any shared memory, as in some containers, the session opens without it, and a warning
    says so. Raises zenoh.ZError like `zenoh.open`.
    """
    try:
        return zenoh.open(config), True
    except zenoh.ZError as error:
        if "shm" not in str(error).lower():
            raise
        log.warning(WITHOUT, error)
    config.insert_json5("transport/shared_memory/enabled", "false")
    return zenoh.open(config), False


def router_config(listen: str) -> zenoh.Config:
    """Configuration of the router, listening on `listen` only."""
    return _zenoh(router_values([listen]))


def router_config_of_file(file: Path, listen: str | None) -> zenoh.Config:
    """Configuration of the router in a file; listen: endpoint in place of the file's.

    Raises InvalidInput if the file cannot be used or others may read it.
    """
    config = _from_file(file)
    if listen is not None:
        _use_endpoint(config, "listen", listen)
    return config


def client_values(endpoints: Sequence[str], own: Credentials | None = None) -> dict[str, Any]:
    """Content of a client's configuration file."""
    tls = (
        None
        if own is None
        else {
            "root_ca_certificate_base64": _base64(own.authority),
            "connect_certificate_base64": _base64(own.certificate),
            "connect_private_key_base64": _base64(own.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }
    )
    return _common(tls) | {
        "mode": "client",
        "connect": {
            "endpoints": list(endpoints),
            "timeout_ms": 1000,
            "exit_on_failure": True,
            "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        },
    }


def router_values(
    endpoints: Sequence[str],
    own: Credentials | None = None,
    access_control: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Content of the router's configuration file."""
    tls = (
        None
        if own is None
        else {
            "root_ca_certificate_base64": _base64(own.authority),
            "listen_certificate_base64": _base64(own.certificate),
            "listen_private_key_base64": _base64(own.key),
            "enable_mtls": True,
        }
    )
    access = {} if access_control is None else {"access_control": access_control}
    return (
        _common(tls)
        | access
        | {"mode": "router", "listen": {"endpoints": list(endpoints), "exit_on_failure": True}}
    )


def _common(tls: dict[str, Any] | None) -> dict[str, Any]:
    link: dict[str, Any] = {"tx": {"lease": LEASE_MS}}
    if tls is not None:
        link |= {"tls": tls, "protocols": ["tls"]}
    return {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},  # needed by retained topics
        "transport": {"link": link},
    }


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _zenoh(values: dict[str, Any]) -> zenoh.Config:
    """Raises InvalidInput for an endpoint that is none."""
    try:
        return zenoh.Config.from_json5(json.dumps(values))
    except zenoh.ZError as error:
        given = values.get("listen", values.get("connect", {}))
        raise _no_endpoint(given.get("endpoints", ())) from error


def _use_endpoint(config: zenoh.Config, where: str, endpoint: str) -> None:
    """Replace the endpoints of a file's `where` (connect or listen). Raises InvalidInput."""
    try:
        config.insert_json5(f"{where}/endpoints", json.dumps([endpoint]))
    except zenoh.ZError as error:
        raise _no_endpoint([endpoint]) from error


def _no_endpoint(given: Sequence[str]) -> InvalidInput:
    return InvalidInput(
        f"{', '.join(map(repr, given))} is no endpoint; wanted for example tcp/127.0.0.1:7447"
    )


def _from_file(file: Path) -> zenoh.Config:
    check_readable(file)
    try:
        return zenoh.Config.from_file(str(file))
    except zenoh.ZError as error:
        raise InvalidInput(
            f"{file} is no configuration of Zenoh ({error}); create it again with helios certs"
        ) from error
