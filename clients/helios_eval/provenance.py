"""Provenance of a measurement: the machine and the source commit."""

from __future__ import annotations

import os
import platform
import subprocess
from pathlib import Path

LEDGER = Path("docs/results/ledger.jsonl")  # ledger of homes, under the root of the checkout


def machine() -> str:
    """Processor, number of cores and operating system."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    return f"{name}, {os.cpu_count()} cores, {platform.system()}"


def checkout() -> Path | None:
    """Root folder of the source checkout that this program runs from; None if it is installed."""
    root = Path(__file__).resolve().parents[2]
    return root if (root / ".git").exists() else None


def commit() -> str:
    """Git description of this source, or "unknown" outside a checkout. It ends with "-dirty" if
    tracked files differ from the commit; the ledger of homes may, since each run adds to it."""
    name = _git("describe", "--always")
    if not name:
        return "unknown"
    changed = _git("status", "--porcelain", "-uno", "--", ":/", f":(top,exclude){LEDGER}")
    return name if changed == "" else f"{name}-dirty"


def _git(*words: str) -> str | None:
    """Output of a git command in this source's folder; None if it fails or there is no git."""
    try:
        done = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), *words],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None
