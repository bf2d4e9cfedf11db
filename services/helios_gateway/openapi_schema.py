"""Corrections to the OpenAPI schema that FastAPI generates."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI

from helios_gateway.error_responses import MEDIA_TYPE

_METHODS = ("get", "post", "put", "patch", "delete")


def correct_error_responses(app: FastAPI) -> None:
    """Make the schema match the real error responses.

    Errors get the media type of problems. The framework's own 422 is removed, because the gateway
    never returns it.
    """
    made = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = made()
            for path in schema["paths"].values():
                for method in _METHODS:
                    if method in path:
                        _mend(path[method]["responses"])
            for name in ("HTTPValidationError", "ValidationError"):
                schema["components"]["schemas"].pop(name, None)
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = openapi


def _mend(responses: dict[str, Any]) -> None:
    responses.pop("422", None)
    for status, response in responses.items():
        content = response.get("content", {})
        schema = content.get("application/json", {}).get("schema", {})
        if status >= "400" and schema.get("$ref", "").endswith("/Problem"):
            response["content"] = {MEDIA_TYPE: {"schema": schema}}
