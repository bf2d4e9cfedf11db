"""Settings of the services for an episode.

`--set alpha_d=0.01` names a setting of one service; `--set planner.max_steps=5` names the service
too.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, cast, get_args

from helios_client.usage_errors import UsageError
from helios_core.agent_presets import settings_for
from helios_core.printable_text import plain_error
from helios_core.settings import ServiceSettings
from helios_detector.settings import Settings as DetectorSettings
from helios_map2d.settings import Settings as Map2DSettings
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.settings import Settings as PlannerSettings
from pydantic import TypeAdapter, ValidationError

from helios_eval.episodes.episode_record import Setting

SERVICES: dict[str, type[ServiceSettings]] = {
    "planner": PlannerSettings,
    "objectmap": ObjectMapSettings,
    "map2d": Map2DSettings,
    "detector": DetectorSettings,
}
# Set by the evaluation itself, or without effect within one process.
_OURS = frozenset(ServiceSettings.model_fields) | {
    "state_dir", "agent", "agent_seed", "detector", "noise", "noise_seed", "noise_level",
    "noise_correlation", "max_steps", "max_picks", "ack_timeout_s", "action_timeout_s",
    "call_timeout_s", "away_s", "retry_s", "threads",
}  # fmt: skip


def parsed(assignments: Iterable[str]) -> dict[str, Setting]:
    """`["alpha_d=0.01"]` as `{"planner.alpha_d": 0.01}`. Raises UsageError."""
    out: dict[str, Setting] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        service, field = _found(name.strip()) if name.strip() else ("", "")
        if not (equals and service):
            raise UsageError(f"--set {assignment!r} is no name=value; write --set alpha_d=0.01")
        value = _value(service, field, text.strip())
        out[f"{service}.{field}"] = value if isinstance(value, Setting) else _as_text(value)
    return out


def _as_text(value: object) -> str:
    """The one text of a value that is no `Setting`: a tuple as "0.1,0.2"."""
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def of_stack(agent: str, settings: Mapping[str, Setting]) -> dict[str, Setting]:
    """Settings of an agent's stack: the given ones, else the agent's own."""
    return {**settings_for(agent), **settings}


def differing_settings(
    agent: str, settings: Mapping[str, Setting], ran: Mapping[str, str] | None = None
) -> dict[str, Setting]:
    """Given settings that differ from the values of the agent's stack; they identify an episode.

    ran: result of `default_settings_of` when the episodes were played; the current value for a
    missing name.
    """
    ran = ran or {}
    return {n: value for n, value in settings.items() if not _holds_anyway(agent, n, value, ran)}


def _holds_anyway(agent: str, name: str, value: Setting, ran: Mapping[str, str]) -> bool:
    service, _, field = name.partition(".")
    if service not in SERVICES:  # a setting of the evaluation itself
        return False
    info = SERVICES[service].model_fields.get(field)
    if info is None:  # exists in another version only
        return False
    try:
        given = _value(service, field, str(value))
    except UsageError:  # valid in another version only
        return False
    if name in ran:
        return str(given) == ran[name]
    return given == settings_for(agent).get(name, info.default)


def default_settings_of(agent: str) -> dict[str, str]:
    """Values of all service settings in an agent's stack without `--set`, by "service.setting"."""
    out = {
        f"{service}.{name}": str(info.get_default(call_default_factory=True))
        for service, settings in SERVICES.items()
        for name, info in settings.model_fields.items()
        if name not in _OURS
    }
    return out | {name: str(value) for name, value in settings_for(agent).items()}


def of_service(service: str, settings: Mapping[str, Setting]) -> dict[str, Any]:
    """Settings of one service, by its own names and in its own types."""
    prefix = f"{service}."
    return {
        name.removeprefix(prefix): _value(service, name.removeprefix(prefix), str(value))
        for name, value in settings.items()
        if name.startswith(prefix)
    }


def _found(name: str) -> tuple[str, str]:
    service, dot, field = name.rpartition(".")
    wanted = [service] if dot else list(SERVICES)
    having = [
        s for s in wanted if s in SERVICES and field in SERVICES[s].model_fields.keys() - _OURS
    ]
    if not having:
        raise UsageError(f"no service has a setting {name!r} that can be set here; {_hint(field)}")
    if len(having) > 1:
        raise UsageError(
            f"{' and '.join(having)} have a setting {field!r}; say whose, --set {having[0]}.{field}"
        )
    return having[0], field


def _hint(field: str) -> str:
    """Hint that names the settings most like a misspelt one, or the command that lists all."""
    whose: dict[str, list[str]] = {}
    for service, settings in SERVICES.items():
        for name in settings.model_fields.keys() - _OURS:
            whose.setdefault(name, []).append(f"{service}.{name}")
    near = difflib.get_close_matches(field, sorted(whose), n=2)
    if near:
        return f"did you mean {' or '.join(full for name in near for full in whose[name])}?"
    modules = ", ".join(f"helios_{service}" for service in SERVICES)
    return f"list them with `python -m MODULE --help`; MODULE is one of {modules}"


def _value(service: str, field: str, text: str) -> object:
    """Text converted to the type of the setting; a tuple as "0.1,0.2".

    "none" is None where the setting may be None, and a word elsewhere.
    """
    info = SERVICES[service].model_fields[field]
    adapter: TypeAdapter[object] = TypeAdapter(cast(Any, info.annotation))
    given: object = text
    if str(info.annotation).startswith("tuple"):
        given = tuple(part.strip() for part in text.split(","))
    elif text.lower() == "none" and type(None) in get_args(info.annotation):
        given = None
    try:
        value = adapter.validate_python(given)
        SERVICES[service].__pydantic_validator__.validate_assignment(
            SERVICES[service].model_construct(), field, value
        )
        return value
    except ValidationError as error:
        raise UsageError(
            f"--set {service}.{field}={text}: {plain_error(error.errors()[0]['msg']).lower()}"
        ) from error
