"""Memory, handles, threads and latency of the services over time, and their growth."""

from __future__ import annotations

import csv
import io
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import psutil
from helios_client.sdk import Helios
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError

from helios_chaos.stack import MODULES, Stack

MB = 1e6
WRITE_S = 60.0


@dataclass(frozen=True)
class Sample:
    """State of one service at one time. `latency_ms` is that of a request which it answers."""

    at_s: float
    service: str
    pid: int
    rss_mb: float
    handles: int
    threads: int
    cpu_s: float
    latency_ms: float | None
    state_mb: float  # of the whole state folder
    at_rest: bool = True  # no task runs


class ResourceLog:
    """Thread that samples all services every `period_s` and keeps a CSV file of them."""

    def __init__(self, stack: Stack, path: Path, period_s: float) -> None:
        self._stack, self._path, self._period_s = stack, path, period_s
        self._samples: list[Sample] = []
        self.at_rest = True  # no task runs now; the owner sets it
        self._ending = threading.Event()
        self._began_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="resources", daemon=True)
        self._thread.start()

    def close(self) -> list[Sample]:
        """End, write the file, and return all samples."""
        self._ending.set()
        self._thread.join()
        write_file(self._path, as_csv(self._samples))
        return self._samples

    def _run(self) -> None:
        written_s = time.monotonic()
        with self._stack.client() as helios:
            while not self._ending.wait(self._period_s):
                self._samples += self._sampled(helios)
                if time.monotonic() - written_s > WRITE_S:
                    written_s = time.monotonic()
                    write_file(self._path, as_csv(self._samples))

    def _sampled(self, helios: Helios) -> list[Sample]:
        at_s = round(time.monotonic() - self._began_s, 2)
        state_mb = folder_mb(self._stack.state_dir)
        asks: dict[str, Callable[[], object]] = {
            "gateway": helios.status,
            "map2d": helios.frontiers,
            "objectmap": helios.objects,
            "planner": helios.tasks,
            "bridge": helios.robot,
        }
        out = []
        for service in ("supervisor", "fork server", *MODULES):
            with suppress(psutil.Error):
                process = psutil.Process(self._stack.pid(service))
                with process.oneshot():
                    used = process.cpu_times()
                    out.append(Sample(
                        at_s, service, process.pid, round(process.memory_info().rss / MB, 2),
                        process.num_fds(), process.num_threads(), round(used.user + used.system, 2),
                        _latency_ms(asks[service]) if service in asks else None, state_mb,
                        self.at_rest,
                    ))  # fmt: skip
        return out


def as_csv(samples: Sequence[Sample]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Sample)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(sample) for sample in samples)
    return text.getvalue()


def folder_mb(folder: Path) -> float:
    size = 0
    for path in folder.rglob("*"):
        with suppress(OSError):  # a temporary file that is gone
            size += path.stat().st_size if path.is_file() else 0
    return round(size / MB, 3)


def slope_per_h(at_s: Sequence[float], values: Sequence[float]) -> float:
    """Slope of the least-squares line through the values, per hour; 0 for fewer than two times."""
    if len(set(at_s)) < 2:
        return 0.0
    return float(np.polyfit(np.asarray(at_s) / 3600.0, np.asarray(values, float), 1)[0])


def growth(values: Sequence[float]) -> float:
    """Median of the last quarter minus that of the first."""
    if not values:
        return 0.0
    quarter = max(1, len(values) // 4)
    return float(np.median(values[-quarter:]) - np.median(values[:quarter]))


def _latency_ms(ask: Callable[[], object]) -> float | None:
    began_s = time.perf_counter()
    try:
        ask()
    except HeliosError:
        return None
    return round((time.perf_counter() - began_s) * 1e3, 2)
