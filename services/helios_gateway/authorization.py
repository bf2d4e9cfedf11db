"""Who may do what: the key of a request, the scope an endpoint needs, the browser's session.

A browser cannot send a key with every picture, so `/v1/session` keeps it in a cookie.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from fastapi import APIRouter, Depends, Request, Response
from fastapi.security import HTTPBearer
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, cookie_parser
from starlette.types import Scope as AsgiScope

from helios_gateway import api_models
from helios_gateway.api_keys import ApiKey, ApiKeys, Scope
from helios_gateway.dependencies import State, state_of
from helios_gateway.error_responses import Forbidden, Unauthorized, problems

COOKIE = "helios_key"
router = APIRouter(prefix="/v1/session", tags=["access"])
_bearer = HTTPBearer(auto_error=False, description="an API key; none is asked for on loopback")


def key_of(scope: AsgiScope, keys: ApiKeys) -> ApiKey | None:
    """The key that a request carries as a bearer token or in its cookie; None for no known key."""
    headers = Headers(scope=scope)
    kind, _, secret = headers.get("authorization", "").partition(" ")
    if kind.lower() != "bearer":
        secret = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
    return keys.find(secret.strip()) if secret else None


def check(connection: HTTPConnection, needed: Scope) -> None:
    """Raises Unauthorized for a request without a known key, Forbidden where its scope is too low.

    Nothing is checked where the gateway asks for no keys.
    """
    keys = state_of(connection).keys
    if not keys.required:
        return
    key = key_of(connection.scope, keys)
    if key is None:
        raise Unauthorized(
            "no known API key came with the request; send Authorization: Bearer KEY, made with "
            "helios key"
        )
    if key.scope < needed:
        raise Forbidden(
            f"the key {key.name!r} may {key.scope.spoken}; this needs one that may "
            f"{needed.name.lower()}"
        )


def needs(scope: Scope) -> Callable[..., Awaitable[None]]:
    """A dependency that calls `check`."""

    async def checked(connection: HTTPConnection) -> None:
        check(connection, scope)

    return checked


def secured(scope: Scope) -> list:
    """`dependencies` of a router or an endpoint that needs a key of this scope.

    The second one only declares the bearer token in the OpenAPI description.
    """
    return [Depends(needs(scope)), Depends(_bearer)]


@router.get("", summary="Is a key asked for, and what may this one?", responses=problems())
async def session(request: Request, state: State) -> api_models.Session:
    return _session(state.keys, key_of(request.scope, state.keys))


@router.post("", summary="Keep a key in a cookie", responses=problems(401))
async def open_session(
    request: Request, response: Response, state: State, body: api_models.SessionRequest
) -> api_models.Session:
    """The cookie is for this site alone and out of reach of scripts."""
    key = state.keys.find(body.key)
    if key is None:
        raise Unauthorized("this API key is not known; make one with helios key")
    response.set_cookie(
        COOKIE, body.key, httponly=True, samesite="strict",
        secure=request.url.scheme == "https",
    )  # fmt: skip
    return _session(state.keys, key)


@router.delete("", summary="Forget the cookie", responses=problems())
async def close_session(response: Response, state: State) -> api_models.Session:
    response.delete_cookie(COOKIE, httponly=True, samesite="strict")
    return _session(state.keys, None)


def _session(keys: ApiKeys, key: ApiKey | None) -> api_models.Session:
    return api_models.Session(
        required=keys.required,
        name=key.name if key else "",
        scope=key.scope.spoken if key else None,
    )
