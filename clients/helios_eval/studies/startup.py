"""Study of the start of `helios up`: seconds until it is ready, and memory of every process.

    python -m helios_eval.studies.startup --starts 5 --against /path/of/another/checkout

Starts the simulated robot in turns: one process per service, `--compact`, and the other checkout.
The first start of each is not counted, as it may compile kernels. Seconds depend on what else the
machine does; processor seconds and ratios depend on it less. PSS counts a page that several
processes share in equal parts, so that the sum is the memory in use. A part of it, `files`, are
unchanged pages of program files, which the system drops when it needs room. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from helios_client.supervision import state_file
from helios_client.supervision.service_specs import free_port
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput, Unavailable

from helios_eval.provenance import commit, machine

READY_WITHIN_S = 600.0
POLL_S = 0.02
SETTLE_S = 2.0  # from ready to the measurement of memory
WORLD = "helios_sim"
SOURCES = ("services", "shared", "clients")


@dataclass(frozen=True)
class Variant:
    """One way to start. checkout: folder of its source; None: this installation."""

    name: str
    flags: tuple[str, ...] = ()
    checkout: Path | None = None

    def environment(self) -> dict[str, str]:
        if self.checkout is None:
            return dict(os.environ)
        paths = os.pathsep.join(str(self.checkout / source) for source in SOURCES)
        return os.environ | {"PYTHONPATH": paths}


@dataclass(frozen=True)
class ProcessMemory:
    """Memory of one process, MB."""

    name: str
    rss_mb: float
    pss_mb: float
    uss_mb: float
    files_mb: float  # the part of pss_mb that the system may drop at any time


@dataclass(frozen=True)
class Start:
    """One start: seconds until ready, and memory afterwards."""

    variant: str
    ready_s: float
    cpu_s: float  # of all processes together, until ready
    load: float  # processes that wanted to run on this machine, mean over the last minute
    processes: tuple[ProcessMemory, ...]

    def total(self, kind: str, with_world: bool = True) -> float:
        """Memory of all processes, MB. kind: rss_mb, pss_mb, uss_mb or files_mb."""
        counted = [p for p in self.processes if with_world or p.name != WORLD]
        return sum(getattr(p, kind) for p in counted)


def measured(variant: Variant) -> Start:
    """Start, measure and stop. Raises Unavailable if it does not get ready."""
    with tempfile.TemporaryDirectory() as folder, _running(variant, Path(folder)) as process:
        began_s = time.monotonic()
        state = Path(folder) / "state"
        while not (state_file.read(state) or {}).get("ready"):
            log = (Path(folder) / "up.log").read_text(errors="replace")[-500:]
            if process.poll() is not None:
                raise Unavailable(f"{variant.name} ended with {process.returncode}: {log}")
            if time.monotonic() - began_s > READY_WITHIN_S:
                raise Unavailable(f"{variant.name} was not ready in {READY_WITHIN_S:g} s: {log}")
            time.sleep(POLL_S)
        ready_s, cpu_s = time.monotonic() - began_s, sum(map(_cpu_s, _processes(process.pid)))
        time.sleep(SETTLE_S)
        processes = tuple(map(_memory, _processes(process.pid)))
        return Start(variant.name, ready_s, cpu_s, os.getloadavg()[0], processes)


@contextmanager
def _running(variant: Variant, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    argv = [
        sys.executable, "-m", "helios_client", "up", "--robot", "sim", "--port", str(free_port()),
        "--state", str(folder / "state"), *variant.flags,
    ]  # fmt: skip
    with (folder / "up.log").open("wb") as log:
        process = subprocess.Popen(
            argv,
            stdout=log,
            stderr=subprocess.STDOUT,
            cwd=variant.checkout,
            env=variant.environment(),
        )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def _processes(supervisor: int) -> list[psutil.Process]:
    root = psutil.Process(supervisor)
    return [root, *root.children(recursive=True)]


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system + times.children_user + times.children_system


def _memory(process: psutil.Process) -> ProcessMemory:
    memory = process.memory_full_info()
    words = " ".join(process.cmdline()).split()
    name = next((w for w in words if w.startswith("helios_")), words[0])
    return ProcessMemory(
        name, memory.rss / 1e6, memory.pss / 1e6, memory.uss / 1e6, _files_mb(process.pid)
    )


def _files_mb(pid: int) -> float:
    """PSS of a process's unchanged file pages, MB."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss_File:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise Unavailable("/proc/PID/smaps_rollup has no Pss_File; this needs Linux 5.9")


def tables(starts: Sequence[Start]) -> str:
    """Markdown: one table of all variants, and one of the processes of each."""
    names = list(dict.fromkeys(start.variant for start in starts))
    lines = [
        "| start | ready, s | CPU, s | PSS, MB | without the world | files, MB | "
        "USS, MB | RSS, MB |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name in names:
        of_name = [s for s in starts if s.variant == name]
        numbers = (
            _median(s.total("pss_mb") for s in of_name),
            _median(s.total("pss_mb", with_world=False) for s in of_name),
            _median(s.total("files_mb") for s in of_name),
            _median(s.total("uss_mb") for s in of_name),
            _median(s.total("rss_mb") for s in of_name),
        )
        lines.append(
            f"| {name} | {_median(s.ready_s for s in of_name):.1f} | "
            f"{_median(s.cpu_s for s in of_name):.1f} | "
            + " | ".join(f"{n:.0f}" for n in numbers)
            + " |"
        )
    for name in names:
        last = [s for s in starts if s.variant == name][-1]
        lines += [
            "",
            f"{name}:",
            "",
            "| process | PSS, MB | USS, MB | RSS, MB |",
            "|---|--:|--:|--:|",
        ]
        lines += [
            f"| `{p.name}` | {p.pss_mb:.0f} | {p.uss_mb:.0f} | {p.rss_mb:.0f} |"
            for p in last.processes
        ]
    return "\n".join(lines)


def _median(values: Iterator[float]) -> float:
    return statistics.median(values)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.startup",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--starts", type=int, default=3, help="counted starts of each; default 3")
    parser.add_argument("--against", type=Path, help="another checkout of HELIOS, for comparison")
    parser.add_argument("--json", type=Path, help="file for all figures")
    args = parser.parse_args(argv)
    variants = [Variant("one process each"), Variant("--compact", ("--compact",))]
    try:
        if sys.platform != "linux":
            raise Unavailable("PSS is known on Linux only; run it there")
        if args.starts < 1:
            raise InvalidInput(f"--starts is {args.starts}; wanted 1 or more")
        if args.against is not None:
            if not (args.against / "services").is_dir():
                raise InvalidInput(f"--against {args.against} is no checkout of HELIOS")
            variants.append(Variant("the other checkout", checkout=args.against.resolve()))
        starts = _in_turns(variants, args.starts)
    except HeliosError as error:
        print(f"startup: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput) else 1
    print(f"machine: {machine()}; load {statistics.median(s.load for s in starts):.1f}\n")
    print(tables(starts))
    if args.json is not None:
        about = {"machine": machine(), "commit": commit(), "starts": [asdict(s) for s in starts]}
        write_file(args.json, json.dumps(about, indent=1))
    return 0


def _in_turns(variants: Sequence[Variant], count: int) -> list[Start]:
    out: list[Start] = []
    for round in range(count + 1):
        for variant in variants:
            start = measured(variant)
            print(
                f"{variant.name}: ready after {start.ready_s:.1f} s, {start.cpu_s:.1f} s of CPU, "
                f"{start.total('pss_mb'):.0f} MB{'' if round else ' (not counted)'}",
                file=sys.stderr,
            )
            if round:
                out.append(start)
    return out


if __name__ == "__main__":
    sys.exit(main())
