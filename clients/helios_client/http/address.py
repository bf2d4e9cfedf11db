"""Address of a gateway, as users write it. Imports only the standard library."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import SplitResult, urlsplit

VARIABLE = "HELIOS_URL"
PORT = 8080
STANDARD_PORTS = {"http": 80, "https": 443}


def chosen(
    port: int | None, url: str | None, environment: Mapping[str, str]
) -> tuple[int | None, str]:
    """Port on this machine and base URL that a command uses.

    port, url: as typed; None: not typed. A typed value wins over HELIOS_URL, which wins over port
    8080. The port is None if a URL was chosen. Raises ValueError with a sentence, also for a typed
    port other than that of the typed URL.
    """
    source = "--url"
    if port is None and url is None:
        url, source = environment.get(VARIABLE), VARIABLE
    if not url:
        port = PORT if port is None else port
        return port, f"http://127.0.0.1:{port}"
    try:
        parts = split_url(url)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    named = parts.port or STANDARD_PORTS[parts.scheme]
    if port not in (None, named):
        raise ValueError(f"--url {url} names port {named}, but --port is {port}; give one of them")
    return None, url


def base_url(text: str) -> str:
    """Address with its scheme and without a slash at its end; `localhost:8080` becomes
    `http://localhost:8080`. Raises ValueError with a sentence."""
    return split_url(text).geturl().rstrip("/")


def split_url(text: str) -> SplitResult:
    """Parts of an address, which may lack its scheme. Raises ValueError with a sentence."""
    wanted = f"the address is {text!r}; wanted http://HOST:PORT or HOST:PORT"
    said = text.strip()
    try:
        parts = urlsplit(said if "://" in said else f"http://{said}")
        has_port = parts.port is None or parts.port > 0
    except ValueError as error:
        raise ValueError(wanted) from error
    known = parts.scheme in ("http", "https") and parts.hostname
    spaced = any(c.isspace() for c in said)
    if not (has_port and known) or parts.query or parts.fragment or spaced:
        raise ValueError(wanted)
    return parts
