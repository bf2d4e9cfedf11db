"""Refusal of misspelt names of settings, with a suggestion.

A service refuses variables `HELIOS_<ITSELF>_…` without a setting of its own, and tables of the file
without a service. It ignores those of other services, whose settings it does not know.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

from helios_core.errors import InvalidInput

PREFIX = "HELIOS_"
SERVICES = (
    "bridge", "detector", "gateway", "map2d", "objectmap", "planner", "recorder", "replay", "ros2",
    "spot", "world",
)  # fmt: skip
OF_ALL = "all"  # table of the settings that every service has


def check_variables(service: str, settings: Collection[str], variables: Iterable[str]) -> None:
    """Raise InvalidInput, without any value in its text, for variables without a setting.

    variables: names in the environment.
    """
    prefix = variable(service, "")
    own = (name.upper() for name in variables if name.upper().startswith(prefix))
    unknown = sorted(name for name in own if name.removeprefix(prefix).lower() not in settings)
    if unknown:
        raise InvalidInput("; ".join(no_setting(service, settings, name) for name in unknown))


def check_tables(service: str, tables: Mapping[str, Any], path: str) -> None:
    """Raise InvalidInput for unknown tables. tables: content of a settings file."""
    known = {*SERVICES, service, OF_ALL}
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise InvalidInput(
                f"{path} has {name} outside of a table; put it under the table of its service, "
                f"such as [{service}]"
            )
        if name not in known:
            near = nearest(name, known)
            raise InvalidInput(
                f"{path} has a table [{name}], but there is no such service; "
                + (f"did you mean [{near}]? " if near else "")
                + f"The tables are {', '.join(sorted(known))}"
            )


def no_setting(service: str, settings: Collection[str], name: str) -> str:
    """Error text for a variable, or a key of a table, that is no setting."""
    prefix = variable(service, "")
    near = nearest(name.removeprefix(prefix), settings)
    if near is None:
        meant = "leave it out; docs/reference/settings.md shows how to list them"
    else:
        meant = f"did you mean {variable(service, near) if name.startswith(prefix) else near}?"
    return f"no setting of {service} is called {name}; {meant}"


def variable(service: str, setting: str) -> str:
    """Environment variable of a service's setting."""
    return f"{PREFIX}{service}_{setting}".upper()


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Known name closest to `name`; None if none is close."""
    return next(iter(get_close_matches(name.lower(), sorted(known), 1)), None)
