"""HTTP errors as the typed errors of `helios_core.errors`."""

from __future__ import annotations

import httpx
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    HeliosError,
    Internal,
    InvalidInput,
    Unavailable,
)


class WrongRequest(InvalidInput):
    """Request that HELIOS read and refused: it is invalid, or names something that does not
    exist."""


class NoGateway(Unavailable):
    """Nothing listens at the address."""


_KINDS: dict[int, type[HeliosError]] = {
    400: WrongRequest, 401: InvalidInput, 403: InvalidInput, 404: WrongRequest, 405: InvalidInput,
    408: DeadlineExceeded, 409: Conflict, 413: InvalidInput, 422: WrongRequest, 429: Unavailable,
    503: Unavailable, 504: DeadlineExceeded,
}  # fmt: skip


def response_error(response: httpx.Response) -> HeliosError:
    """Typed error for a problem+json response."""
    kind = _KINDS.get(response.status_code, Internal)
    try:
        detail = response.json()["detail"]
    except (ValueError, KeyError, TypeError):
        detail = f"{response.request.url} answered {response.status_code}; is HELIOS there?"
        kind = InvalidInput if kind is WrongRequest else kind  # perhaps the server is not HELIOS
    return kind(str(detail))


def transport_error(error: httpx.TransportError, url: str) -> HeliosError:
    """Typed error for a response that never came from `url`."""
    if isinstance(error, httpx.ConnectError | httpx.ConnectTimeout):
        return NoGateway(f"nobody answers at {url}; start HELIOS with `helios up`")
    if isinstance(error, httpx.TimeoutException):
        return DeadlineExceeded(f"{url} gave no answer in time; see `helios status`")
    return Unavailable(f"{url} broke off ({error}); try again")
