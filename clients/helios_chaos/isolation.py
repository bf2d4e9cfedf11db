"""Own namespaces for a run: loopback, mounts and shared memory that nothing else uses.

The run starts itself again under `unshare`. In its namespaces `tc` limits the rate of loopback, a
small disk can be mounted, and each service can have a `/dev/shm` of its own, as on two machines.
Where the system refuses that, the faults that need it are skipped with the reason.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from helios_chaos import wall_clock
from helios_chaos.schedule import KINDS, Kind

MARK = "HELIOS_CHAOS_ISOLATED"  # set for the run inside the namespaces
NO_NAMESPACES = "no namespaces of its own ({}); run it as root, or allow user namespaces"


@dataclass(frozen=True)
class Abilities:
    """What this run can do to the system. skipped: kinds of faults that it cannot play."""

    isolated: bool
    skipped: dict[Kind, str] = field(default_factory=dict)

    def playable(self, wanted: tuple[Kind, ...] = KINDS) -> tuple[Kind, ...]:
        """Wanted kinds without the skipped ones."""
        return tuple(kind for kind in wanted if kind not in self.skipped)


def enter(argv: list[str]) -> Abilities:
    """Replace this process by the same command in namespaces of its own, if the system allows it.

    argv: the command's arguments, after `helios`. Returns inside the namespaces, or outside them
    where there are none.
    """
    if os.environ.get(MARK) == "1":
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        return abilities(True, "")
    prefix, reason = _prefix()
    if not prefix:
        return abilities(False, reason)
    os.environ[MARK] = "1"
    sys.stdout.flush()
    return os.execvp(prefix[0], [*prefix, sys.executable, "-m", "helios_client", *argv])


def abilities(isolated: bool, reason: str) -> Abilities:
    """Abilities inside (`isolated`) or outside the namespaces. reason: why there are none."""
    skipped: dict[Kind, str] = {}
    if not isolated:
        skipped["disk"] = skipped["rate"] = NO_NAMESPACES.format(reason)
    elif why := _rate_fault():
        skipped["rate"] = f"`tc` cannot limit the rate of loopback here ({why})"
    if why := wall_clock.missing():
        skipped["clock"] = f"{why}, and no process may set the clock of this machine"
    return Abilities(isolated, skipped)


def limit_rate(mbit: float) -> None:
    """Limit the rate of loopback; 0 ends the limit. Only inside the namespaces."""
    if mbit:
        limit = ["rate", f"{mbit:g}mbit", "burst", "128kb", "latency", "400ms"]
        _tc("qdisc", "replace", "dev", "lo", "root", "tbf", *limit)
    else:
        _tc("qdisc", "del", "dev", "lo", "root")


def mount_small_disk(folder: Path, megabytes: int) -> None:
    """Mount an empty file system of that size. Only inside the namespaces, which take it along."""
    folder.mkdir(parents=True, exist_ok=True)
    size = f"size={megabytes}m"
    subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(folder)], check=True)


def _prefix() -> tuple[list[str], str]:
    """Command before the command that gives it namespaces; or empty, and the reason."""
    unshare = shutil.which("unshare")
    if unshare is None or shutil.which("ip") is None or shutil.which("mount") is None:
        return [], "unshare, ip or mount is missing"
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    prefix = [unshare, *user, "--net", "--mount"]
    tried = subprocess.run(
        [*prefix, "ip", "link", "set", "lo", "up"], capture_output=True, text=True, check=False
    )
    return (prefix, "") if tried.returncode == 0 else ([], tried.stderr.strip() or "refused")


def _rate_fault() -> str:
    if shutil.which("tc") is None:
        return "there is no `tc`: apt install iproute2"
    try:
        limit_rate(100)
        limit_rate(0)
    except subprocess.CalledProcessError as error:
        return error.stderr.strip()
    return ""


def _tc(*args: str) -> None:
    subprocess.run(["tc", *args], check=True, capture_output=True, text=True)
