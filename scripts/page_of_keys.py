"""Write the tables of all bus keys into docs/reference/wire-contract.md; `--check` exits 1 if
stale."""

from __future__ import annotations

from helios_core.topics import METHODS, TOPICS, settings_method, status_topic

from scripts.markdown_tables import DOCS, Block, code, table


def tables() -> str:
    """Tables of topics and methods, from `helios_core.topics`."""
    data = (
        (code(t.name), code(t.type.DESCRIPTOR.name), code(t.qos.name))
        for t in (*TOPICS, status_topic("<service>"))
    )
    methods = (
        (
            code(f"{'truth: ' if m.truth else ''}{m.name}"),
            code(m.request.DESCRIPTOR.name),
            code(m.reply.DESCRIPTOR.name),
        )
        for m in (*METHODS, settings_method("<service>"))
    )
    return "\n".join([
        "Data, below `helios/v1/<robot>/`:\n",
        table(("data", "message", "quality of service"), data),
        "Methods, below `helios/v1/<robot>/svc/` (`truth`: `helios/v1/<robot>/truth/svc/`):\n",
        table(("method", "request", "reply"), methods),
    ])  # fmt: skip


BLOCK = Block(DOCS / "reference/wire-contract.md", "keys", "python -m scripts.page_of_keys", tables)

if __name__ == "__main__":
    BLOCK.main()
