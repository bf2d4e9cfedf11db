"""Write the tables of all bus keys into docs/reference/wire-contract.md; `--check` exits 1 if
stale."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from helios_core.bus_access import ACCESS, SERVICES, SIMULATED_DETECTOR, Access
from helios_core.topics import (
    ANY_STATUS,
    METHODS,
    TOPICS,
    Method,
    Topic,
    settings_method,
    spans_method,
    status_topic,
)

from scripts.markdown_tables import DOCS, Block, code, table

PEOPLE = ("recorder", "operator", "program")  # hear every topic; the text says so
FIRST = SERVICES[0]  # stands for every service


def tables() -> str:
    """Tables of topics and methods, from `helios_core.topics` and `helios_core.bus_access`."""
    data = (
        (code(t.name), code(t.type.DESCRIPTOR.name), code(t.qos.name), _senders(t), _hearers(t))
        for t in TOPICS
    )
    status = status_topic("<service>")
    of_status = (
        code(status.name),
        code(status.type.DESCRIPTOR.name),
        code(status.qos.name),
        "the service",
        _names(a for a in ACCESS if {ANY_STATUS, status_topic(FIRST)} & {*ACCESS[a].subscribes}),
    )
    methods = (
        (
            code(f"{'truth: ' if m.truth else ''}{m.name}"),
            code(m.request.DESCRIPTOR.name),
            code(m.reply.DESCRIPTOR.name),
            _callers(m),
        )
        for m in METHODS
    )
    return "\n".join(
        [
            "Data, below `helios/v1/<robot>/`. `recorder`, `operator` and `program` receive "
            "everything:\n",
            table(("data", "message", "quality of service", "from", "to"), (*data, of_status)),
            "Methods, below `helios/v1/<robot>/svc/` (`truth`: `helios/v1/<robot>/truth/svc/`). "
            "The first word is the service that answers; `robot` also answers `world/…`, without "
            "the truth:\n",
            table(("method", "request", "reply", "may call it"), (*methods, *_of_each_service())),
        ]
    )


def _of_each_service() -> Iterator[tuple[str, ...]]:
    """Rows of the methods that every service has."""
    for of in (settings_method, spans_method):
        method = of("<service>")
        yield (
            code(method.name),
            code(method.request.DESCRIPTOR.name),
            code(method.reply.DESCRIPTOR.name),
            _names(name for name, access in ACCESS.items() if of("objectmap") in access.calls),
        )


def _senders(topic: Topic) -> str:
    return _names(name for name, access in ACCESS.items() if topic in access.publishes)


def _hearers(topic: Topic) -> str:
    return _names(
        name for name, a in ACCESS.items() if topic in a.subscribes and name not in PEOPLE
    )


def _callers(method: Method) -> str:
    def may(name: str, access: Access) -> bool:
        more = SIMULATED_DETECTOR.calls if name == "detector" else ()
        return method in (*access.calls, *more)

    return _names(name for name, access in ACCESS.items() if may(name, access))


def _names(names: Iterable[str]) -> str:
    return ", ".join(names)


BLOCK = Block(DOCS / "reference/wire-contract.md", "keys", "python -m scripts.page_of_keys", tables)

if __name__ == "__main__":
    BLOCK.main()
