"""HTTP interface from the gateway's OpenAPI document, for docs/reference/http-api.md.

The page itself holds the list of all addresses; `--check` exits 1 if it is stale. Parameters,
requests and responses are inserted when the site is built.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from helios_gateway.robot_registry import RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app

from scripts.markdown_tables import DOCS, Block, code, plain, sentence, table, unit_of

METHODS = ("get", "post", "put", "patch", "delete")
ELSEWHERE = {"Problem"}  # documented once, under "Errors"
Schema = dict[str, Any]


@cache
def description() -> Schema:
    """OpenAPI document of a gateway with the default settings."""
    return create_app(RobotRegistry({}), Settings.load([])).openapi()


def operations() -> Iterator[tuple[str, str, Schema]]:
    """Method, path and description of every operation, in the order of the document."""
    for path, methods in description()["paths"].items():
        for method in METHODS:
            if method in methods:
                yield method.upper(), path, methods[method]


def listed() -> str:
    """Table of all addresses with their summaries."""
    rows = (
        (f"`{method} {path}`", plain(described["summary"]))
        for method, path, described in operations()
    )
    return table(("address", "does"), rows)


def errors() -> str:
    """Table of all error statuses with their meanings."""
    known = {
        status: answer["description"]
        for _, _, described in operations()
        for status, answer in described["responses"].items()
        if status >= "400" and "application/problem+json" in answer.get("content", {})
    }
    return table(("status", "when"), ((f"`{s}`", plain(text)) for s, text in sorted(known.items())))


def details() -> str:
    """One section per group of addresses, then one for all objects in requests and responses."""
    out: list[str] = []
    groups: dict[str, list[str]] = {}
    for method, path, described in operations():
        groups.setdefault(described["tags"][0], []).append(_operation(method, path, described))
    for group, sections in groups.items():
        out += [f"### Addresses: {group}\n", *sections]
    out.append("### Objects\n")
    out.append("Requests and answers are made of these JSON objects.\n")
    for name, schema in sorted(description()["components"]["schemas"].items()):
        if "properties" in schema and name not in ELSEWHERE:
            out.append(_object(name, schema))
    return "\n".join(out)


def _operation(method: str, path: str, described: Schema) -> str:
    out = [f"#### {method} {path}\n", plain(sentence(described["summary"])) + "\n"]
    out += [
        f"{paragraph}\n"
        for paragraph in described.get("description", "").split("\n\n")
        if paragraph
    ]
    if parameters := described.get("parameters"):
        rows = ((code(p["name"]), p["in"], *_field(p["name"], p["schema"], p)) for p in parameters)
        out.append(table(("parameter", "in", "type", "unit", "default", "meaning"), rows))
    for kind, content in described.get("requestBody", {}).get("content", {}).items():
        out.append(f"Body (`{kind}`): {_body(content['schema'])}\n")
    out.append("Answers: " + "; ".join(_answers(described["responses"])) + ".\n")
    return "\n".join(out)


def _body(schema: Schema) -> str:
    if "properties" not in schema:
        return _type(schema)
    return "\n\n" + _fields(schema)


def _answers(responses: Schema) -> Iterator[str]:
    """Success responses one by one, then all error statuses together."""
    failures = []
    for status, answer in sorted(responses.items()):
        content = answer.get("content", {})
        if "application/problem+json" in content:
            failures.append(status)
            continue
        words = [f"`{status}`"]
        words += [f"{_typed(kind, body)}" for kind, body in content.items()]
        if answer["description"] != "Successful Response":
            words.append(f"({plain(answer['description'])})")
        yield " ".join(words)
    if failures:
        yield "[errors](#errors) " + ", ".join(f"`{status}`" for status in failures)


def _typed(kind: str, body: Schema) -> str:
    known = _type(body.get("schema", {})) if kind == "application/json" else ""
    return known if known not in ("", "any") else f"`{kind}`"


def _object(name: str, schema: Schema) -> str:
    words = schema.get("description", "")
    return "\n".join(
        [
            f"({_label(name)})=",
            f"#### {name}\n",
            *([f"{words}\n"] if words else []),
            _fields(schema),
        ]
    )


def _fields(schema: Schema) -> str:
    required = schema.get("required", ())
    rows = (
        (code(name), *_field(name, field, {"required": name in required}))
        for name, field in schema["properties"].items()
    )
    return table(("field", "type", "unit", "default", "meaning"), rows)


def _field(name: str, schema: Schema, described: Schema) -> tuple[str, str, str, str]:
    """Type with bounds, unit, default and meaning of a field."""
    kinds = ", ".join(filter(None, (_type(schema), _bounds(schema))))
    default = "" if described.get("required") else _default(schema)
    meaning = described.get("description") or schema.get("description") or ""
    if (examples := schema.get("examples")) and len(str(examples[0])) < 60:
        meaning += (
            f"{'; ' if meaning else ''}such as `{json.dumps(examples[0], ensure_ascii=False)}`"
        )
    return kinds, unit_of(name), default, meaning


def _default(schema: Schema) -> str:
    if "default" not in schema:
        return "may be left out"
    return code(json.dumps(schema["default"], ensure_ascii=False))


def _type(schema: Schema) -> str:
    """JSON type of a schema; one of our objects as a link to its section."""
    if reference := schema.get("$ref", ""):
        name = reference.rpartition("/")[2]
        known = "properties" in description()["components"]["schemas"][name]
        return f"[{name}](#{_label(name)})" if known else "any JSON"
    if choices := schema.get("anyOf"):
        return " or ".join(dict.fromkeys(map(_type, choices)))
    if values := schema.get("enum"):
        return ", ".join(code(str(value)) for value in values)
    kind = schema.get("type", "any")
    if kind == "array":
        inner = schema.get("prefixItems")
        return f"array of {_type(schema.get('items', inner[0] if inner else {}))}"
    if kind == "object" and isinstance(values := schema.get("additionalProperties"), dict):
        return f"object of {_type(values)}"
    return "file" if schema.get("contentMediaType") else kind


def _bounds(schema: Schema) -> str:
    """Bounds of the schema, or of its first alternative that has some."""
    for part in (schema, *schema.get("anyOf", ())):
        low, high = part.get("minimum"), part.get("maximum")
        if "exclusiveMinimum" in part:
            return f"above {part['exclusiveMinimum']:g}" + ("" if high is None else f" to {high:g}")
        if low is not None and high is not None:
            return f"{low:g} to {high:g}"
        if low is not None or high is not None:
            return f"{low:g} or more" if high is None else f"at most {high:g}"
    return ""


def _label(name: str) -> str:
    return f"http-{name.lower().replace('_', '-')}"


BLOCK = Block(DOCS / "reference/http-api.md", "addresses", "scripts/page_of_http.py", listed)

if __name__ == "__main__":
    BLOCK.main()
