"""A hub of models and of ONNX files on loopback: the addresses that the clients use, no more."""

from __future__ import annotations

import hashlib
import json
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

COMMIT = "c0ffee" + "0" * 34
ID = "someone/owl"
ONNX_PATH = "/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx"


@dataclass
class LocalHub:
    """The server. Tests change its fields while it runs."""

    files: dict[str, bytes] = field(default_factory=dict)  # of the model ID
    large: frozenset[str] = frozenset()  # files with a published SHA-256; others have a git id
    onnx: bytes = b""
    onnx_version: dict[str, str] | None = None  # its headers; None: an ETag of the content
    ignores_if_range: bool = False
    gated: bool = False
    cut_after: int | None = None  # bytes after which the next answer with content breaks off
    ranges: list[str] = field(default_factory=list)  # the Range headers that came
    if_ranges: list[str] = field(default_factory=list)  # the If-Range headers that came
    gets: list[str] = field(default_factory=list)  # paths of downloads

    def __post_init__(self) -> None:
        hub = self

        class Handler(_Handler):
            served = hub

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def info(self) -> dict[str, Any]:
        """The model's description, as the hub's interface gives it with `blobs=true`."""
        siblings = []
        for name, data in self.files.items():
            entry: dict[str, Any] = {"rfilename": name, "size": len(data), "blobId": git_id(data)}
            if name in self.large:
                entry["lfs"] = {"sha256": sha256(data), "size": len(data), "pointerSize": 100}
            siblings.append(entry)
        card = {"license": "apache-2.0"}
        return {"id": ID, "modelId": ID, "sha": COMMIT, "siblings": siblings, "cardData": card,
                "private": False, "tags": [], "downloads": 0, "likes": 0}  # fmt: skip

    def etag(self, name: str) -> str:
        data = self.files[name]
        return sha256(data) if name in self.large else git_id(data)

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    served: LocalHub

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def do_GET(self) -> None:
        self._answer(body=True)

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing."""

    def _answer(self, body: bool) -> None:
        hub, path = self.served, self.path.partition("?")[0]
        if path.startswith(f"/api/models/{ID}"):
            self._send(json.dumps(hub.info()).encode(), {"Content-Type": "application/json"}, body)
        elif path.startswith(f"/{ID}/resolve/") and hub.gated:
            headers = {"X-Error-Code": "GatedRepo", "X-Error-Message": "accept the licence"}
            self._send(b"", headers, body, 403)
        elif path.startswith(f"/{ID}/resolve/"):
            name = path.split("/", 5)[5]
            headers = {"ETag": f'"{hub.etag(name)}"', "X-Repo-Commit": COMMIT}
            self._content(hub.files[name], headers, body)
        elif path == ONNX_PATH:
            version = {"ETag": f'"{sha256(hub.onnx)}"'}
            self._content(hub.onnx, version if hub.onnx_version is None else hub.onnx_version, body)
        else:
            self._send(b"", {"X-Error-Code": "RepoNotFound"}, body, 404)

    def _content(self, data: bytes, headers: dict[str, str], body: bool) -> None:
        hub, status = self.served, 200
        if body:
            hub.gets.append(self.path)
            if asked := self._range(headers):
                begin = int(asked.removeprefix("bytes=").partition("-")[0])
                total = len(data)
                data, status = data[begin:], 206 if begin < total else 416
                sent = f"{begin}-{total - 1}" if begin < total else "*"
                headers = headers | {"Content-Range": f"bytes {sent}/{total}"}
        self._send(data, headers | {"Accept-Ranges": "bytes"}, body, status)

    def _range(self, headers: dict[str, str]) -> str | None:
        """Range to send; None for all, also when If-Range names another version."""
        hub = self.served
        asked, version = self.headers.get("Range"), self.headers.get("If-Range")
        hub.ranges += [asked] if asked else []
        hub.if_ranges += [version] if version else []
        is_other = version is not None and version not in headers.values()
        return None if is_other and not hub.ignores_if_range else asked

    def _send(self, data: bytes, headers: dict[str, str], body: bool, status: int = 200) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if not body:
            return
        cut, self.served.cut_after = self.served.cut_after, None
        if cut is not None and len(data) > cut:
            self.wfile.write(data[:cut])
            self.close_connection = True
            self.connection.close()
            return
        if cut is not None:
            self.served.cut_after = cut
        self.wfile.write(data)


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def git_id(data: bytes) -> str:
    """Id of a file's content in git."""
    return hashlib.sha1(f"blob {len(data)}\0".encode() + data, usedforsecurity=False).hexdigest()
