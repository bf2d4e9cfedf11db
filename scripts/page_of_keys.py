"""Write the tables of all keys into docs/reference/wire-contract.md; `--check`: are they stale?"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from helios_core.topics import METHODS, TOPICS, settings_method, status_topic

PAGE = Path(__file__).resolve().parent.parent / "docs/reference/wire-contract.md"
HEADING = "## All keys\n"


def tables() -> str:
    """The section, from `helios_core.topics`."""
    data = [
        f"| `{t.name}` | `{t.type.DESCRIPTOR.name}` | `{t.qos.name}` |"
        for t in (*TOPICS, status_topic("<service>"))
    ]
    methods = [
        f"| `{'truth: ' if m.truth else ''}{m.name}` | `{m.request.DESCRIPTOR.name}` "
        f"| `{m.reply.DESCRIPTOR.name}` |"
        for m in (*METHODS, settings_method("<service>"))
    ]
    return "\n".join([
        HEADING + "Data, below `helios/v1/<robot>/`:\n",
        "| data | message | quality of service |\n|---|---|---|", *data,
        "\nMethods, below `helios/v1/<robot>/svc/` (`truth`: below "
        "`helios/v1/<robot>/truth/svc/`):\n",
        "| method | request | reply |\n|---|---|---|", *methods,
    ]) + "\n"  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 if stale")
    page = PAGE.read_text()
    fresh = page[: page.index(HEADING)] + tables()
    if not parser.parse_args().check:
        PAGE.write_text(fresh)
    elif fresh != page:
        sys.exit(f"the keys on {PAGE.name} are stale; run scripts/page_of_keys.py")


if __name__ == "__main__":
    main()
