"""Provenance of a measurement: the machine and the source commit."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Sequence
from pathlib import Path

LEDGER = Path("docs/results/ledger.jsonl")  # ledger of homes, under the root of the checkout
UNKNOWN = "unknown"  # commit outside a checkout
DIRTY = "-dirty"  # end of a commit whose files were changed
_DIGITS = 8
_CODE = ("services", "shared", "clients")  # folders whose code plays episodes


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


def usable_cores() -> int:
    """Number of processor cores that this process may use; fewer than the machine's if it is bound
    to some of them."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def checkout() -> Path | None:
    """Root folder of the source checkout that this program runs from; None if it is installed."""
    root = Path(__file__).resolve().parents[2]
    return root if (root / ".git").exists() else None


def commit() -> str:
    """Commit of this source, or UNKNOWN outside a checkout. It ends with DIRTY if tracked files
    differ from the commit, or code is not tracked; the ledger of homes may differ, since each run
    adds to it."""
    name = _git("rev-parse", f"--short={_DIGITS}", "HEAD")
    if not name:
        return UNKNOWN
    changed = _git("status", "--porcelain", "-uno", "--", ":/", f":(top,exclude){LEDGER}")
    untracked = _git("ls-files", "--others", "--exclude-standard", "--", *_in_root(_CODE))
    return name if changed == untracked == "" else f"{name}{DIRTY}"


def same_code(one: str, other: str) -> bool:
    """True if the code of two commits is equal; False also if this checkout lacks one of them."""
    return _git("diff", "--quiet", one, other, "--", *_in_root(_CODE)) is not None


def _in_root(folders: Sequence[str]) -> list[str]:
    return [f":/{folder}" for folder in folders]


def _git(*words: str) -> str | None:
    """Output of a git command in this source's folder; None if it fails or there is no git."""
    try:
        done = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), *words],
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None
