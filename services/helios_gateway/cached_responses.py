"""Responses that are encoded once for many requests, with an ETag for conditional requests."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from fastapi import Request, Response
from pydantic import BaseModel

PNG = "image/png"
JPEG = "image/jpeg"
NPZ = "application/octet-stream"
JSON = "application/json"


@dataclass(frozen=True)
class Encoded:
    """Content as it is sent, with the ETag of its bytes."""

    content: bytes
    media_type: str
    tag: str
    about: tuple[tuple[str, str], ...] = ()  # additional headers

    @classmethod
    def of(cls, content: bytes, media_type: str, **about: str) -> Encoded:
        tag = f'"{hashlib.blake2b(content, digest_size=10).hexdigest()}"'
        headers = tuple((name.replace("_", "-"), value) for name, value in about.items())
        return cls(content, media_type, tag, headers)

    @classmethod
    def json(cls, model: BaseModel) -> Encoded:
        return cls.of(model.model_dump_json(by_alias=True).encode(), JSON)


def conditional_response(request: Request, encoded: Encoded) -> Response:
    """Response with the content, or 304 if the client already has it."""
    headers = {"etag": encoded.tag, "cache-control": "no-cache", **dict(encoded.about)}
    asked = request.headers.get("if-none-match", "")
    if encoded.tag in asked or asked.strip() == "*":
        return Response(status_code=304, headers=headers)
    return Response(encoded.content, media_type=encoded.media_type, headers=headers)


UNCHANGED: dict[int | str, dict] = {304: {"description": "as the tag in If-None-Match says"}}


def content_docs(media_type: str, description: str) -> dict[int | str, dict]:
    """OpenAPI `responses` of a route whose content is no JSON."""
    schema = {"schema": {"type": "string", "format": "binary"}}
    return {200: {"description": description, "content": {media_type: schema}}, **UNCHANGED}
