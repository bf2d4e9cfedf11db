"""`helios record`: the recorder alone, beside services that run already."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NoReturn

from helios_core.errors import Unavailable

from helios_client.supervision import state_file


def record(
    out: Path, port: int, state: Path | None, router: str | None, name: str | None
) -> NoReturn:
    """Become the recorder; signals reach it as they are. Raises Unavailable when no router is
    named and none is known."""
    known = state_file.read(state or state_file.default_state_dir(port)) or {}
    router = router or known.get("router")
    if router is None:
        raise Unavailable(
            f"no `helios up` runs with --port {port}; start one, or name a router: "
            "--router tcp/HOST:PORT"
        )
    argv = ["--router", router, "--robot", name or known.get("robot", "robot"), "--out", str(out)]
    print(f"recording to {out.resolve()}; Ctrl-C ends it", file=sys.stderr, flush=True)
    os.execv(sys.executable, [sys.executable, "-m", "helios_recorder", *argv])
