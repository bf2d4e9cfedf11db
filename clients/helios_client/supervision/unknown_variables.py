"""Environment variables `HELIOS_…` that no part of HELIOS reads.

They are reported, not refused, as other programs may use such names. A service itself reports
errors in its own variables.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher

from helios_core.settings_spelling import PREFIX, SERVICES, variable

SHARED_VARIABLES = (
    "HELIOS_CERTS",
    "HELIOS_CONFIG",
    "HELIOS_FORK",
    "HELIOS_URL",
    "HELIOS_API_KEY",
    "HELIOS_RECORD",
    "HELIOS_MODELS",
    "HELIOS_MODELS_MIRROR",
)  # not of one service
OF_TESTS = "HELIOS_TEST_"
MIN_SIMILARITY = 0.7  # similarity (0 to 1) from which on a name is suggested


def unread_variables_message(variables: Iterable[str]) -> str:
    """Sentence with the unread names and similar known ones, never a value; empty if all are
    read."""
    names = sorted(name for name in variables if name.startswith(PREFIX) and not _is_read(name))
    if not names:
        return ""
    listed = (f"{name} (did you mean {near}?)" if (near := _near(name)) else name for name in names)
    return f"no part of HELIOS reads {', '.join(listed)}; the services are {', '.join(SERVICES)}"


def _is_read(name: str) -> bool:
    of_services = tuple(variable(service, "") for service in SERVICES)
    return name in SHARED_VARIABLES or name.startswith((OF_TESTS, *of_services))


def _near(name: str) -> str | None:
    """Known name most similar to `name`. A service may be written as two words, as in
    HELIOS_OBJECT_MAP_STRIDE_PX."""
    words = name.removeprefix(PREFIX).split("_")
    meant = [
        (_likeness(name.removeprefix(PREFIX), o.removeprefix(PREFIX)), o) for o in SHARED_VARIABLES
    ]
    for count in (1, 2):
        if setting := "_".join(words[count:]):
            said = "".join(words[:count])
            meant += [(_likeness(said, s.upper()), variable(s, setting)) for s in SERVICES]
    likeness, near = max(meant)
    return near if likeness >= MIN_SIMILARITY else None


def _likeness(a: str, b: str) -> float:
    return SequenceMatcher(None, a, b).ratio()
