"""Settings of the services that an episode is played with.

`--set alpha_d=0.01` names a setting of one service; `--set planner.max_steps=5` says whose.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, cast

from helios_client.usage_errors import UsageError
from helios_core.agent_presets import settings_for
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
# What the evaluation sets itself, or what means nothing within one process.
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
        out[f"{service}.{field}"] = value if isinstance(value, Setting) else text.strip()
    return out


def of_stack(agent: str, settings: Mapping[str, Setting]) -> dict[str, Setting]:
    """What an agent's house runs with: the given settings, else the agent's own."""
    return {**settings_for(agent), **settings}


def that_change(
    agent: str, settings: Mapping[str, Setting], ran: Mapping[str, str] | None = None
) -> dict[str, Setting]:
    """Those that differ from what the agent's house runs with anyway; they name an episode.

    ran: what `ran_with` told when the episodes were played; where it says nothing, today's holds.
    """
    ran = ran or {}
    return {n: value for n, value in settings.items() if not _holds_anyway(agent, n, value, ran)}


def _holds_anyway(agent: str, name: str, value: Setting, ran: Mapping[str, str]) -> bool:
    service, _, field = name.partition(".")
    if service not in SERVICES:  # one of the evaluation's own
        return False
    info = SERVICES[service].model_fields.get(field)
    if info is None:  # of another version
        return False
    try:
        given = _value(service, field, str(value))
    except UsageError:  # allowed in another version
        return False
    if name in ran:
        return str(given) == ran[name]
    return given == settings_for(agent).get(name, info.default)


def ran_with(agent: str) -> dict[str, str]:
    """Every setting of every service that an agent's house runs with, where no `--set` says
    otherwise, by "service.setting"."""
    out = {
        f"{service}.{name}": str(info.get_default(call_default_factory=True))
        for service, settings in SERVICES.items()
        for name, info in settings.model_fields.items()
        if name not in _OURS
    }
    return out | {name: str(value) for name, value in settings_for(agent).items()}


def of_service(service: str, settings: Mapping[str, Setting]) -> dict[str, Any]:
    """The settings of one service, by its own names and of its own types."""
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
    """The settings most like a misspelt one; where none is, how to see them all."""
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
    """The text as the setting's type; a tuple as "0.1,0.2"."""
    info = SERVICES[service].model_fields[field]
    adapter: TypeAdapter[object] = TypeAdapter(cast(Any, info.annotation))
    given: object = text
    if str(info.annotation).startswith("tuple"):
        given = tuple(part.strip() for part in text.split(","))
    elif text.lower() == "none":
        given = None
    try:
        value = adapter.validate_python(given)
        SERVICES[service].__pydantic_validator__.validate_assignment(
            SERVICES[service].model_construct(), field, value
        )
        return value
    except ValidationError as error:
        raise UsageError(
            f"--set {service}.{field}={text}: {error.errors()[0]['msg'].lower()}"
        ) from error
