"""Who may do what: the key of a request, the scope a route needs, the session of a browser."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from fastapi import APIRouter, Depends, Request, Response
from fastapi.security import HTTPBearer
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, cookie_parser
from starlette.types import Scope as AsgiScope

from helios_gateway import api_models
from helios_gateway.api_keys import ApiKey, ApiKeys, Scope
from helios_gateway.error_responses import Forbidden, Unauthorized, problems

COOKIE = "helios_key"
_bearer = HTTPBearer(auto_error=False, description="an API key; none is asked for on loopback")


def key_of(scope: AsgiScope, keys: ApiKeys) -> ApiKey | None:
    """The entry of the key that a request carries: a bearer token, or the session's cookie."""
    headers = Headers(scope=scope)
    kind, _, secret = headers.get("authorization", "").partition(" ")
    if kind.lower() != "bearer":
        secret = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
    return keys.find(secret.strip()) if secret else None


def check(connection: HTTPConnection, needed: Scope) -> None:
    """Raises Unauthorized without a known key, Forbidden with one that does not suffice."""
    keys: ApiKeys = connection.app.state.keys
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
    """A dependency: only with a key of this scope, where keys are asked for.

    Asynchronous, as every dependency of stop-now is: others wait for one of the shared threads.
    """

    async def checked(connection: HTTPConnection) -> None:
        check(connection, scope)

    return checked


def secured(scope: Scope) -> list:
    """Of a router or a route: checked, and said in the interface's description."""
    return [Depends(needs(scope)), Depends(_bearer)]


def session_routes() -> APIRouter:
    """`/v1/session`: a browser cannot send a key with every picture; a cookie does."""
    routes = APIRouter(prefix="/v1/session", tags=["access"])

    @routes.get("", summary="Is a key asked for, and what may this one?", responses=problems())
    async def session(request: Request) -> api_models.Session:
        return _session(request, key_of(request.scope, request.app.state.keys))

    @routes.post("", summary="Keep a key in a cookie", responses=problems(401))
    async def open_session(
        request: Request, response: Response, body: api_models.SessionRequest
    ) -> api_models.Session:
        """The cookie is for this site alone and out of reach of scripts."""
        key = request.app.state.keys.find(body.key)
        if key is None:
            raise Unauthorized("this API key is not known; make one with helios key")
        response.set_cookie(
            COOKIE, body.key, httponly=True, samesite="strict",
            secure=request.url.scheme == "https",
        )  # fmt: skip
        return _session(request, key)

    @routes.delete("", summary="Forget the cookie", responses=problems())
    async def close_session(request: Request, response: Response) -> api_models.Session:
        response.delete_cookie(COOKIE, httponly=True, samesite="strict")
        return _session(request, None)

    return routes


def _session(request: Request, key: ApiKey | None) -> api_models.Session:
    return api_models.Session(
        required=request.app.state.keys.required,
        name=key.name if key else "",
        scope=key.scope.spoken if key else None,
    )
