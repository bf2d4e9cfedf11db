"""The address of a HELIOS, as people write it. Imports the standard library alone."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit


def base_url(text: str) -> str:
    """The address with its scheme and without a slash at its end; `localhost:8080` is
    `http://localhost:8080`. Raises ValueError with a sentence."""
    return split_url(text).geturl().rstrip("/")


def split_url(text: str) -> SplitResult:
    """The parts of an address, which may lack its scheme. Raises ValueError with a sentence."""
    said = text.strip()
    try:
        parts = urlsplit(said if "://" in said else f"http://{said}")
        usable = parts.hostname and (parts.port is None or parts.port > 0)
    except ValueError:
        usable = False
    if not usable or parts.scheme not in ("http", "https") or parts.query or parts.fragment:
        raise ValueError(f"the address is {text!r}; wanted http://HOST:PORT or HOST:PORT")
    return parts
