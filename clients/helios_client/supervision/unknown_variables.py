"""Variables `HELIOS_…` that nothing of HELIOS reads: said, not refused, for other programs may use
such names. What is wrong with one of a service, the service says itself."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher

from helios_core.settings_spelling import PREFIX, SERVICES, variable

OTHERS = ("HELIOS_CONFIG", "HELIOS_URL", "HELIOS_API_KEY", "HELIOS_RECORD")  # of no single service
OF_TESTS = "HELIOS_TEST_"
ALIKE = 0.7  # from this likeness on (0 to 1) one name may have been meant for another


def unread(variables: Iterable[str]) -> str:
    """One sentence with the near names, never a value; empty where all are read."""
    names = sorted(name for name in variables if name.startswith(PREFIX) and not _is_read(name))
    if not names:
        return ""
    listed = (f"{name} (did you mean {near}?)" if (near := _near(name)) else name for name in names)
    return f"nothing of HELIOS reads {', '.join(listed)}; the services are {', '.join(SERVICES)}"


def _is_read(name: str) -> bool:
    of_services = tuple(variable(service, "") for service in SERVICES)
    return name in OTHERS or name.startswith((OF_TESTS, *of_services))


def _near(name: str) -> str | None:
    """A service may have been written in two words, as HELIOS_OBJECT_MAP_STRIDE_PX."""
    words = name.removeprefix(PREFIX).split("_")
    meant = [(_likeness(name.removeprefix(PREFIX), o.removeprefix(PREFIX)), o) for o in OTHERS]
    for count in (1, 2):
        if setting := "_".join(words[count:]):
            said = "".join(words[:count])
            meant += [(_likeness(said, s.upper()), variable(s, setting)) for s in SERVICES]
    likeness, near = max(meant)
    return near if likeness >= ALIKE else None


def _likeness(a: str, b: str) -> float:
    return SequenceMatcher(None, a, b).ratio()
