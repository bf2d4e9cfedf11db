"""`/v1/session`: stores a browser's API key in a cookie, which image requests send, too."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from helios_gateway import api_models
from helios_gateway.api_keys import ApiKey, ApiKeys
from helios_gateway.dependencies import COOKIE, State, key_of
from helios_gateway.error_responses import Unauthorized, problems

router = APIRouter(prefix="/v1/session", tags=["access"])


@router.get(
    "", summary="Get the key requirement and the scope of the request's key", responses=problems()
)
async def session(request: Request, state: State) -> api_models.Session:
    return _session(state.keys, key_of(request.scope, state.keys))


@router.post("", summary="Open a browser session with an API key", responses=problems(401))
async def open_session(
    request: Request, response: Response, state: State, body: api_models.SessionRequest
) -> api_models.Session:
    """Store an API key in a cookie.

    The cookie is restricted to this site, and scripts cannot read it.
    """
    key = state.keys.find(body.key)
    if key is None:
        raise Unauthorized("this API key is not known; make one with helios key")
    response.set_cookie(
        COOKIE,
        body.key,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return _session(state.keys, key)


@router.delete("", summary="Close the browser session (delete the cookie)", responses=problems())
async def close_session(response: Response, state: State) -> api_models.Session:
    response.delete_cookie(COOKIE, httponly=True, samesite="strict")
    return _session(state.keys, None)


def _session(keys: ApiKeys, key: ApiKey | None) -> api_models.Session:
    return api_models.Session(
        required=keys.required,
        name=key.name if key else "",
        scope=key.scope.label if key else None,
    )
