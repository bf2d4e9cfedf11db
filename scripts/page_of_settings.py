"""Tables of every service's settings, in docs/reference/settings.md."""

from __future__ import annotations

import importlib
import math
import types
import typing
from collections.abc import Iterator
from typing import Any, Literal

import annotated_types as limits
from helios_core.settings import ServiceSettings
from helios_core.settings_spelling import SERVICES, variable
from helios_planner.settings import OWN
from pydantic import SecretStr
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from scripts.markdown_tables import DOCS, Block, code, plain, sentence, table, unit_of

MODULES = {  # services whose settings module is not `helios_<service>.settings`
    "world": "helios_sim.settings",
}
KINDS = {bool: "true or false", int: "whole number", float: "number", str: "text"}
ABSENT = ("none", "empty")
HEAD = ("setting and variable", "default", "unit", "values", "meaning")
OF_TASK = "A task may set it for itself (`helios task --set`)."


def page() -> str:
    """One section for the settings common to all services, then one per service."""
    out = ["## Every service\n", _table("<SERVICE>", ServiceSettings.model_fields)]
    for service, kind in sorted(settings_classes().items()):
        out += [f"## {service}\n", f"`python -m {_program(kind)}`\n", _table(service, own(kind))]
    return "\n".join(out)


def settings_classes() -> dict[str, type[ServiceSettings]]:
    """Settings class of each service, by its name in variables and in the settings file."""
    classes = {}
    for service in SERVICES:
        module = importlib.import_module(MODULES.get(service, f"helios_{service}.settings"))
        (classes[service],) = (
            kind
            for kind in vars(module).values()
            if isinstance(kind, type)
            and issubclass(kind, ServiceSettings)
            and kind.__module__ == module.__name__
        )
    return classes


def own(kind: type[ServiceSettings]) -> dict[str, FieldInfo]:
    """Settings of a service beyond those common to all services."""
    common = ServiceSettings.model_fields
    return {name: field for name, field in kind.model_fields.items() if name not in common}


def _program(kind: type[ServiceSettings]) -> str:
    package = kind.__module__.partition(".")[0]
    return "helios_bridge" if package == "helios_spot" else package


def _table(service: str, fields: dict[str, FieldInfo]) -> str:
    return table(HEAD, (_row(service, name, field) for name, field in fields.items()))


def _row(service: str, name: str, field: FieldInfo) -> tuple[str, ...]:
    meaning = plain(sentence(field.description or ""))
    if service == "planner" and name in OWN:
        meaning += f" {OF_TASK}"
    return (
        f"`{name}`<br>`{variable(service, name)}`",
        default_of(field),
        unit_of(name),
        ", ".join(values_of(field)),
        meaning,
    )


def default_of(field: FieldInfo) -> str:
    """Default of a setting, as a user would type it."""
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "required"
    if isinstance(value, SecretStr):
        value = value.get_secret_value()
    if value is None or value == "":
        return ABSENT[value == ""]
    if isinstance(value, bool):
        return code(str(value).lower())
    if isinstance(value, tuple):
        return code(", ".join(f"{part:g}" for part in value))
    if isinstance(value, float):
        return "no limit" if math.isinf(value) else code(f"{value:.4g}")
    return code(str(value))


def values_of(field: FieldInfo) -> Iterator[str]:
    """Allowed values of a setting: choices, bounds, or kind of value."""
    kinds = [kind for kind in _alternatives(field.annotation) if kind is not type(None)]
    choices = [code(str(c)) for kind in kinds if _is_choice(kind) for c in typing.get_args(kind)]
    choices += [code(c) for meta in field.metadata for c in _choices_of(meta)]
    if choices:
        yield from choices
        return
    bounds = _bounds(field)
    yield bounds or _kind(kinds[0])
    if bounds and kinds[0] is int:
        yield "whole"


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    union = typing.get_origin(annotation) in (typing.Union, types.UnionType)
    return typing.get_args(annotation) if union else (annotation,)


def _is_choice(kind: Any) -> bool:
    return typing.get_origin(kind) is Literal


def _choices_of(meta: Any) -> list[str]:
    """Choices in a pattern such as ^(a|b)$; empty if it lists none."""
    pattern = str(getattr(meta, "pattern", None) or "")
    choices: list[str] = pattern.removeprefix("^(").removesuffix(")$").split("|")
    words = "".join(choices).replace("-", "")
    return choices if len(choices) > 1 and words.isalnum() else []


def _bounds(field: FieldInfo) -> str:
    low = high = ""
    for meta in field.metadata:
        match meta:
            case limits.Ge(ge=edge):
                low = f"{edge:g}"
            case limits.Gt(gt=edge):
                low = f"above {edge:g}"
            case limits.Le(le=edge):
                high = f"{edge:g}"
            case limits.Lt(lt=edge):
                high = f"below {edge:g}"
            case _:
                pass
    if low and high:
        return f"{low} to {high}"
    if high:
        return high if high.startswith("below") else f"at most {high}"
    return low if low.startswith("above") or not low else f"{low} or more"


def _kind(kind: Any) -> str:
    if typing.get_origin(kind) is tuple:
        return "numbers"
    return KINDS.get(kind, "path" if kind.__name__ == "Path" else "text")


BLOCK = Block(
    DOCS / "reference/settings.md", "settings", "python -m scripts.page_of_settings", page
)

if __name__ == "__main__":
    BLOCK.main()
