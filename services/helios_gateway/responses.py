"""Pictures and files: sent with a tag, so that a viewer that has them is told so."""

from __future__ import annotations

import hashlib

from fastapi import Request, Response

PNG = "image/png"
JPEG = "image/jpeg"
NPZ = "application/octet-stream"


def tagged(request: Request, content: bytes, media_type: str, **headers: str) -> Response:
    """The content, or 304 when the request names the same content."""
    tag = f'"{hashlib.blake2b(content, digest_size=10).hexdigest()}"'
    common = {"etag": tag, "cache-control": "no-cache"} | {
        name.replace("_", "-"): value for name, value in headers.items()
    }
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=common)
    return Response(content, media_type=media_type, headers=common)


def content_docs(media_type: str, description: str) -> dict[int | str, dict]:
    """For the interface's description: a response that is no JSON."""
    schema = {"schema": {"type": "string", "format": "binary"}}
    return {200: {"description": description, "content": {media_type: schema}}}
