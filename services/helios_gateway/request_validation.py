"""Validation errors of a request as sentences: received value, expected value, remedy."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.params import Form
from fastapi.routing import APIRoute
from helios_core.printable_text import plain_error, printable
from pydantic import BaseModel
from pydantic.fields import FieldInfo

MOST_ERRORS = 5
MOST_CHARACTERS = 80  # of a quoted value
JSON_HEADER = "with the header content-type: application/json"
_PARTS = ("body", "query", "path", "header", "cookie")
_NO_OBJECT = ("model_attributes_type", "model_type", "dict_type")


def sentence(request: Request, error: RequestValidationError) -> str:
    """Sentence for the validation errors of a request to a route."""
    route = request.scope.get("route")
    found = error.errors()[:MOST_ERRORS]
    if not isinstance(route, APIRoute):
        return errors_text(found)
    whole = [e for e in found if tuple(e["loc"]) == ("body",) or e["type"] == "json_invalid"]
    if whole:
        return _whole_body(whole[0], route)
    said = "; ".join(_said(e, _field(route, e["loc"])) for e in found)
    example = _example(route) if any(e["loc"][:1] == ("body",) for e in found) else ""
    return f"{said}; for example {example}" if example else said


def unreadable_body(request: Request, why: str) -> str:
    """Sentence for a body that the framework could not parse. why: in its words."""
    came = _came(request.headers.get("content-type", ""))
    said = f"the body cannot be read ({why.rstrip('.')}); it came with content-type {came}"
    route = request.scope.get("route")
    if not isinstance(route, APIRoute) or route.body_field is None:
        return f"{said}; see /docs for what to send"
    if isinstance(route.body_field.field_info, Form):
        names = ", ".join(field.alias for field in route.dependant.body_params)
        return f"{said}; send {names} as multipart/form-data with a boundary, as curl -F does"
    example = _example(route)
    return f"{said}; send a JSON object{example and f' such as {example}'}, {JSON_HEADER}"


def errors_text(errors: Sequence[Mapping[str, Any]]) -> str:
    """Sentence for the validation errors of a model that was parsed from JSON."""
    return "; ".join(_said(e, None) for e in errors[:MOST_ERRORS])


def _whole_body(error: Mapping[str, Any], route: APIRoute) -> str:
    """Sentence for a body that is missing, no JSON, or no object."""
    field = route.body_field
    wanted = f"a JSON object, {JSON_HEADER}"
    if example := _example(route):
        wanted = f"a JSON object such as {example}, {JSON_HEADER}"
    elif field is not None and field.field_info.description:
        wanted = field.field_info.description
    if error["type"] == "missing":
        return f"the body is empty; send {wanted}"
    if error["type"] == "json_invalid":
        return f"the body is no JSON ({_json_trouble(error)}); send {wanted}"
    if error["type"] in _NO_OBJECT:
        return f"the body is no JSON object; send {wanted}"
    return _said(error, None)


def _said(error: Mapping[str, Any], field: FieldInfo | None) -> str:
    path = [part for part in error["loc"] if part not in _PARTS] or ["the body"]
    where = printable(".".join(map(str, path))[:MOST_CHARACTERS])
    kind, message = error["type"], error["msg"]
    if kind == "value_error":
        return plain_error(message)
    if kind == "json_invalid":
        return f"it is no JSON ({_json_trouble(error)})"
    if kind == "missing":
        what = f": {field.description}" if field is not None and field.description else ""
        return f"{where} is missing; send it{what}"
    if kind == "extra_forbidden":
        return f"{where} is not known here; leave it out"
    came = _came(error.get("input"))
    if message.startswith("Input should be "):
        return f"{where} is {came}; wanted {message.removeprefix('Input should be ')}"
    return f"{where} is {came}; {message[:1].lower()}{message[1:]}"


def _json_trouble(error: Mapping[str, Any]) -> str:
    why = str((error.get("ctx") or {}).get("error", error["msg"]))
    at = error["loc"][-1] if error["loc"] else None
    return f"{why} at character {at}" if isinstance(at, int) else why


def _came(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MOST_CHARACTERS else f"{text[: MOST_CHARACTERS - 1]}…"


def _field(route: APIRoute, loc: Sequence[str | int]) -> FieldInfo | None:
    """Field of a parameter or of the body's model; None if unknown."""
    if len(loc) != 2:
        return None
    part, name = loc
    if part == "body":
        return _model(route).get(str(name))
    known = [*route.dependant.query_params, *route.dependant.path_params]
    return next((p.field_info for p in known if name in (p.name, p.alias)), None)


def _model(route: APIRoute) -> dict[str, FieldInfo]:
    body = _body_model(route)
    return body.model_fields if body is not None else {}


def _body_model(route: APIRoute) -> type[BaseModel] | None:
    annotation = route.body_field.field_info.annotation if route.body_field is not None else None
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return None


def _example(route: APIRoute) -> str:
    """Example JSON body of a route; empty if it has none."""
    body = _body_model(route)
    extra = body.model_config.get("json_schema_extra") if body is not None else None
    example = extra.get("example") if isinstance(extra, dict) else None
    return json.dumps(example) if example else ""
