"""Download of one file over HTTP that continues where an earlier attempt ended."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import httpx
from helios_core.errors import Unavailable

TIMEOUT_S = 30.0
PART = ".part"
Progress = Callable[[int, int | None], None]  # bytes so far, bytes of all if known


def download(url: str, to: Path, progress: Progress) -> None:
    """Download into `to`; an incomplete download stays beside it as `NAME.part`.

    Raises Unavailable if the server fails or sends too little, and OSError.
    """
    part = to.with_name(to.name + PART)
    part.parent.mkdir(parents=True, exist_ok=True)
    have = part.stat().st_size if part.exists() else 0
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
    try:
        with httpx.stream(
            "GET", url, headers=headers, follow_redirects=True, timeout=TIMEOUT_S
        ) as answer:
            if answer.status_code == httpx.codes.REQUESTED_RANGE_NOT_SATISFIABLE:
                part.unlink()  # longer than the file: from another version
                raise Unavailable(f"{url} has changed; run the command again")
            answer.raise_for_status()
            if answer.status_code != httpx.codes.PARTIAL_CONTENT:
                have = 0
            length = answer.headers.get("content-length")
            size = have + int(length) if length else None
            with part.open("ab" if have else "wb") as file:
                for block in answer.iter_raw():
                    file.write(block)
                    have += len(block)
                    progress(have, size)
    except httpx.HTTPStatusError as error:
        raise Unavailable(
            f"{url} cannot be fetched: the server says {error.response.status_code}"
        ) from error
    except httpx.HTTPError as error:
        raise Unavailable(
            f"{url} cannot be fetched ({type(error).__name__}: {error}); run the command again, it "
            f"continues after {have} bytes"
        ) from error
    if size is not None and have != size:
        raise Unavailable(f"{url} ended after {have} of {size} bytes; run the command again")
    part.replace(to)
