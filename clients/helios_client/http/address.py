"""The address of a HELIOS, as people write it. Imports the standard library alone."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit


def base_url(text: str) -> str:
    """The address with its scheme and without a slash at its end; `localhost:8080` is
    `http://localhost:8080`. Raises ValueError with a sentence."""
    return split_url(text).geturl().rstrip("/")


def split_url(text: str) -> SplitResult:
    """The parts of an address, which may lack its scheme. Raises ValueError with a sentence."""
    wanted = f"the address is {text!r}; wanted http://HOST:PORT or HOST:PORT"
    said = text.strip()
    try:
        parts = urlsplit(said if "://" in said else f"http://{said}")
        has_port = parts.port is None or parts.port > 0
    except ValueError as error:
        raise ValueError(wanted) from error
    known = parts.scheme in ("http", "https") and parts.hostname
    if not (has_port and known) or parts.query or parts.fragment:
        raise ValueError(wanted)
    return parts
