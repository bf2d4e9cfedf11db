"""Download of one file over HTTP that continues where an earlier attempt ended.

An incomplete download is `NAME.part`. `NAME.part.version` beside it has the server's ETag, or its
Last-Modified. The next attempt sends that as `If-Range`: the server then sends the rest, or all of
a newer version. Without a version, the next attempt starts anew.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
from helios_core.atomic_file import write_file
from helios_core.errors import Unavailable

TIMEOUT_S = 30.0
PART, VERSION = ".part", ".part.version"
Progress = Callable[[int, int | None], None]  # bytes so far, bytes of all if known
_RANGE = re.compile(r"bytes (?:(?P<begin>\d+)-\d+|\*)/(?P<total>\d+|\*)")


@dataclass(frozen=True)
class _Partial:
    """An incomplete download and the version of the file that it is a part of."""

    path: Path
    version_path: Path

    def kept(self) -> tuple[int, str]:
        """Bytes that a download can continue, and their version; 0 and empty if there are none."""
        try:
            version = _printable(self.version_path.read_text())
            size = self.path.stat().st_size
        except (FileNotFoundError, UnicodeDecodeError):
            return 0, ""
        return (size, version) if size and version else (0, "")

    def begin(self, version: str) -> None:
        """Forget the earlier attempt. In this order, no bytes ever lie beside another version."""
        self.version_path.unlink(missing_ok=True)
        self.path.unlink(missing_ok=True)
        if version:
            write_file(self.version_path, version)

    def become(self, to: Path) -> None:
        self.path.replace(to)
        self.version_path.unlink(missing_ok=True)


def download(url: str, to: Path, progress: Progress) -> None:
    """Download into `to`; an incomplete download stays beside it.

    Raises Unavailable if the server fails or sends too little, and OSError.
    """
    part = _Partial(to.with_name(to.name + PART), to.with_name(to.name + VERSION))
    part.path.parent.mkdir(parents=True, exist_ok=True)
    try:
        if not _is_fetched(url, part, progress):
            part.begin("")
            _is_fetched(url, part, progress)
    except httpx.HTTPStatusError as error:
        raise Unavailable(
            f"{url} cannot be fetched: the server says {error.response.status_code}"
        ) from error
    except httpx.HTTPError as error:
        have, _ = part.kept()
        then = f"it continues after {have} bytes" if have else "it starts anew"
        raise Unavailable(
            f"{url} cannot be fetched ({type(error).__name__}: {error}); run the command again, "
            f"{then}"
        ) from error
    part.become(to)


def _is_fetched(url: str, part: _Partial, progress: Progress) -> bool:
    """Fetch what is missing. False if the answer does not fit the bytes that are there.

    Raises httpx.HTTPError, Unavailable for an answer that is too short, and OSError.
    """
    have, version = part.kept()
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers |= {"Range": f"bytes={have}-", "If-Range": version}
    with httpx.stream(
        "GET", url, headers=headers, follow_redirects=True, timeout=TIMEOUT_S
    ) as answer:
        is_same = _version(answer) in ("", version)
        begin, total = _content_range(answer)
        if have and answer.status_code == httpx.codes.REQUESTED_RANGE_NOT_SATISFIABLE:
            return is_same and total == have  # it was complete already
        answer.raise_for_status()
        if have and answer.status_code == httpx.codes.PARTIAL_CONTENT:
            if not is_same or begin != have:
                return False
        else:
            have, total = 0, None
            part.begin(_version(answer))
        if total is None and (length := answer.headers.get("content-length")):
            total = have + int(length)
        with part.path.open("ab" if have else "wb") as file:
            for block in answer.iter_raw():
                file.write(block)
                have += len(block)
                progress(have, total)
    if total is not None and have != total:
        raise Unavailable(f"{url} ended after {have} of {total} bytes; run the command again")
    return True


def _version(answer: httpx.Response) -> str:
    """Version of the file in an answer; empty if it has none that is the same only for the same
    bytes, as for a weak ETag."""
    tag = answer.headers.get("etag", "")
    if tag.startswith("W/"):
        return ""
    return _printable(tag or answer.headers.get("last-modified", ""))


def _printable(text: str) -> str:
    """The text if it can be sent in a header, otherwise empty."""
    text = text.strip()
    return text if text.isascii() and text.isprintable() else ""


def _content_range(answer: httpx.Response) -> tuple[int | None, int | None]:
    """First byte of an answer, and bytes of the whole file; None where it does not say so."""
    found = _RANGE.fullmatch(answer.headers.get("content-range", ""))
    values: dict[str, int] = {}
    for name, text in (found.groupdict() if found else {}).items():
        with suppress(TypeError, ValueError):  # None or *
            values[name] = int(text)
    return values.get("begin"), values.get("total")
