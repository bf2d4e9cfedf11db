"""Error responses as `application/problem+json` (RFC 9457): type, title, status, detail."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Awaitable, Callable, Iterator
from http import HTTPStatus

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    HeliosError,
    InvalidInput,
    Unavailable,
)
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from helios_gateway.request_validation import sentence, unreadable_body

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
_KINDS: dict[type[HeliosError], tuple[int, str, str]] = {
    InvalidInput: (400, "invalid", "The request is wrong"),
    Unavailable: (503, "unavailable", "A service cannot answer now"),
    DeadlineExceeded: (504, "timeout", "A service did not answer in time"),
    Conflict: (409, "conflict", "Refused in the present state"),
}
_INTERNAL = (500, "internal", "A fault in a service")


class NotFound(InvalidInput):
    """The addressed resource does not exist."""


class Unauthorized(InvalidInput):
    """The request has no key, or an unknown one."""


class Forbidden(InvalidInput):
    """The scope of the key is too low."""


_KINDS[NotFound] = (404, "not-found", "Not found")
_KINDS[Unauthorized] = (401, "unauthorized", "A key is needed")
_KINDS[Forbidden] = (403, "forbidden", "Forbidden")


class Problem(BaseModel):
    """Error that states the received value, the expected value and the remedy."""

    type: str = Field(description="kind of the problem", examples=["helios:invalid"])
    title: str = Field(description="the kind in words", examples=["The request is wrong"])
    status: int = Field(description="the HTTP status", examples=[400])
    detail: str = Field(
        description="what came, what was wanted, what to do",
        examples=["'dance' is no instruction; say for example: move the mug to the table"],
    )


_WORDS = {
    400: "the request is wrong",
    401: "an API key is needed",
    403: "the key does not allow it, or a foreign page asked",
    404: "there is no such thing",
    408: "the body came too slowly",
    409: "refused in the present state",
    413: "the body is too large",
    429: "too many requests",
    503: "a service cannot answer now",
    504: "a service did not answer in time",
}
_ANYWHERE = (400, 401, 403, 429, 503, 504)
_WITH_BODY = (408, 413)


def problems(*statuses: int, body: bool = False) -> dict[int | str, dict]:
    """OpenAPI `responses` of a route: these statuses, and those that any route may return."""
    return {
        status: {"model": Problem, "description": _WORDS[status]}
        for status in sorted({*statuses, *_ANYWHERE, *(_WITH_BODY if body else ())})
    }


def problem(status: int, kind: str, title: str, detail: str) -> JSONResponse:
    """Response for one problem."""
    content = Problem(type=f"helios:{kind}", title=title, status=status, detail=detail)
    return JSONResponse(content.model_dump(), status, media_type=MEDIA_TYPE)


def kind_of(error: HeliosError) -> str:
    """Last part of a problem's type: invalid, conflict, unavailable, timeout, …."""
    return _KINDS.get(type(error), _INTERNAL)[1]


def problem_of(error: HeliosError) -> JSONResponse:
    """Response for a typed error; 500 if neither the caller nor the state caused it."""
    status, kind, title = _KINDS.get(type(error), _INTERNAL)
    out = problem(status, kind, title, error.message)
    if status == 401:
        out.headers["www-authenticate"] = "Bearer"
    return out


@contextlib.contextmanager
def invalid_as_not_found() -> Iterator[None]:
    """Raise NotFound for an InvalidInput, in calls whose only input comes from the path."""
    try:
        yield
    except InvalidInput as error:
        raise NotFound(error.message) from error


def add_problems(app: FastAPI) -> None:
    """Install handlers that turn every error of the application into a problem response."""

    async def typed(_: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HeliosError)
        return problem_of(error)

    async def unreadable(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        return problem(400, "invalid", "The request is wrong", sentence(request, error))

    async def http(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        title = HTTPStatus(error.status_code).phrase
        detail = str(error.detail)
        if detail == title:
            detail = f"{title}: see /docs for the addresses and methods there are"
        elif error.status_code == 400:  # the framework could not read the body
            detail = unreadable_body(request, detail)
        kind = title.lower().replace(" ", "-")
        out = problem(error.status_code, kind, title, detail)
        out.headers.update(error.headers or {})
        return out

    async def unforeseen(request: Request, error: Exception) -> JSONResponse:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return problem(
            500, "internal", "A fault in the gateway", "the gateway's log says what went wrong"
        )

    handlers: list[tuple[type[Exception], Callable[..., Awaitable[JSONResponse]]]] = [
        (HeliosError, typed),
        (RequestValidationError, unreadable),
        (HTTPException, http),
        (Exception, unforeseen),
    ]
    for kind, handler in handlers:
        app.add_exception_handler(kind, handler)
