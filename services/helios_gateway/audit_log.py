"""Record of every change over HTTP: who asked for what, when, and the answer, as JSON lines.

    {"at": "2026-05-04T10:11:12.131Z", "who": "tablet", "scope": "task", "host": "10.0.0.7",
     "method": "POST", "path": "/v1/tasks", "request": "{\"instruction\": ...}", "status": 202,
     "answer": "{\"id\": ...}"}

Threads write the lines, so that a slow disk delays no request, least of all a stop. Refused
requests are recorded, too; those without a known key, where one is required, in a small file of
their own: anyone can send any number of them. A WebSocket has one line when it opens and one when
it ends.
"""

from __future__ import annotations

import datetime as dt
import json
import logging
import os
import queue
import sys
import threading
import time
from io import TextIOWrapper
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput
from helios_core.printable_text import printable
from helios_core.private_file import FILE_MODE, check_private
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.api_keys import ApiKeys
from helios_gateway.dependencies import key_of

log = logging.getLogger(__name__)

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")  # of HTTP requests that change nothing
CHANGING_SOCKETS = ("/robot/teleop", "/frames/ws")
WITH_SECRET = ("/v1/session",)  # the body is an API key
KEPT_BYTES = 1000  # of a body, of an answer and of a path
FILE_BYTES, OLD_FILES = 50_000_000, 4  # then a new file begins; so many old ones are kept
KEYLESS_BYTES = 5_000_000  # the same for requests without a known key
WAITING = 10_000  # lines that wait for the disk; further ones are lost, with an error in the log
CLOSE_S = 0.5  # longest wait for the disk at the end, for each of the two files


class AuditLog:
    """Open record; `close` writes what waits. Thread-safe."""

    def __init__(self, file: Path) -> None:
        """Raises InvalidInput if the files cannot be written, or others may read them."""
        keyless = file.with_name(f"{file.stem}-without-key{file.suffix}")
        self._lines, self._keyless = _Lines(file, FILE_BYTES), _Lines(keyless, KEYLESS_BYTES)

    def write(self, entry: dict[str, Any], keyless: bool = False) -> None:
        """Add a line with the present time. keyless: about a request without the key that it
        needs. Never blocks."""
        now = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        line = json.dumps({"at": now} | entry, ensure_ascii=False)
        (self._keyless if keyless else self._lines).write(line)

    def close(self) -> None:
        self._lines.close()
        self._keyless.close()


class _Lines:
    """A file, its older files, and the thread that writes them."""

    def __init__(self, file: Path, most_bytes: int) -> None:
        """Raises InvalidInput if the file cannot be written, or others may read it."""
        try:
            if file.exists():
                check_private(file)
            handler = _File(file, maxBytes=most_bytes, backupCount=OLD_FILES, encoding="utf-8")
        except OSError as error:
            raise InvalidInput(
                f"the record {file} cannot be written ({error.strerror}); choose another with "
                "--audit"
            ) from error
        self._file, self._handler = file, handler
        self._waiting: queue.Queue[logging.LogRecord | None] = queue.Queue(WAITING)  # None: the end
        self._writer = threading.Thread(target=self._write_all, name="audit", daemon=True)
        self._writer.start()

    def write(self, line: str) -> None:
        try:
            self._waiting.put_nowait(logging.makeLogRecord({"msg": line}))
        except queue.Full:
            log.error("the disk is too slow for the record of changes: a line is lost")

    def close(self) -> None:
        """Write what waits, for at most CLOSE_S; lines that remain are lost."""
        until_s = time.monotonic() + CLOSE_S
        try:
            self._waiting.put(None, timeout=CLOSE_S)
            self._writer.join(max(0.0, until_s - time.monotonic()))
        except queue.Full:
            pass
        if self._writer.is_alive():
            log.error(
                "the disk is too slow for the record of changes: up to %d lines of %s are lost",
                self._waiting.qsize(),
                self._file,
            )
        else:
            self._handler.close()

    def _write_all(self) -> None:
        while (record := self._waiting.get()) is not None:
            self._handler.handle(record)


class _File(RotatingFileHandler):
    """Lines in a file that only its owner may read."""

    def _open(self) -> TextIOWrapper:
        def private(path: str, flags: int) -> int:
            return os.open(path, flags, FILE_MODE)

        raw = open(self.baseFilename, "ab", opener=private)  # noqa: SIM115  the handler closes it
        return TextIOWrapper(raw, encoding=self.encoding)

    def handleError(self, record: logging.LogRecord) -> None:
        log.error("a line of the record of changes is lost: %s", sys.exc_info()[1])


class AuditMiddleware:
    """ASGI middleware that records every request that may change something."""

    def __init__(self, app: ASGIApp, audit: AuditLog, keys: ApiKeys) -> None:
        self._app, self._audit, self._keys = app, audit, keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket" and scope["path"].endswith(CHANGING_SOCKETS):
            await self._socket(scope, receive, send)
        elif scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            await self._request(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    async def _request(self, scope: Scope, receive: Receive, send: Send) -> None:
        asked, answer = _Kept(Headers(scope=scope)), _Kept(Headers())
        status = 0  # no answer: the client has gone

        async def noting_body(kept: _Kept = asked) -> Message:
            message = await receive()
            kept.add(message.get("body", b""))
            return message

        async def noting_answer(message: Message) -> None:
            nonlocal status, answer
            if message["type"] == "http.response.start":
                status, answer = message["status"], _Kept(Headers(raw=message["headers"]))
            else:
                answer.add(message.get("body", b""))
            await send(message)

        about = self._about(scope) | {"method": scope["method"]}
        try:
            await self._app(scope, noting_body, noting_answer)
        except ClientDisconnect:
            raise
        except Exception:  # answered outside of this middleware
            status = status or 500
            raise
        finally:
            said = "" if scope["path"].rstrip("/") in WITH_SECRET else asked.text()
            self._write(about | {"request": said, "status": status, "answer": answer.text()})

    async def _socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        about = self._about(scope) | {"method": "WEBSOCKET"}
        messages, opened = 0, False

        async def counting() -> Message:
            nonlocal messages
            message = await receive()
            messages += message["type"] == "websocket.receive"
            return message

        async def noting(message: Message) -> None:
            nonlocal opened
            if message["type"] == "websocket.accept":
                opened = True
                self._write(about | {"status": 101, "answer": "opened"})
            elif message["type"] == "websocket.http.response.start":
                self._write(about | {"status": message["status"], "answer": "refused"})
            await send(message)

        try:
            await self._app(scope, counting, noting)
        finally:
            if opened:
                self._write(about | {"status": 0, "answer": f"ended, {messages} messages"})

    def _write(self, entry: dict[str, Any]) -> None:
        self._audit.write(entry, keyless=self._keys.required and entry["who"] is None)

    def _about(self, scope: Scope) -> dict[str, Any]:
        """Who asks, from where, for which path."""
        key = key_of(scope, self._keys) if self._keys.required else None
        query = scope.get("query_string", b"").decode("latin-1")
        return {
            "who": key.name if key else None,
            "scope": key.scope.label if key else None,
            "host": (scope.get("client") or ("",))[0],
            "path": printable((scope["path"] + (f"?{query}" if query else ""))[:KEPT_BYTES]),
        }


class _Kept:
    """Beginning of a body, if it is JSON; of any other, only its size."""

    def __init__(self, headers: Headers) -> None:
        self._is_text = "json" in headers.get("content-type", "")
        self._kept, self._size = b"", 0

    def add(self, data: bytes) -> None:
        self._size += len(data)
        if self._is_text:
            self._kept += data[: KEPT_BYTES - len(self._kept)]

    def text(self) -> str:
        if not self._is_text:
            return f"{self._size} bytes" if self._size else ""
        text = printable(self._kept.decode(errors="replace"))
        return text + ("…" if self._size > len(self._kept) else "")
