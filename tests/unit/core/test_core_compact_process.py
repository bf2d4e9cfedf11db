"""Several services in one process: their names in the log, and how they end."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from helios_core.compact_process import ServiceName

RUN = [sys.executable, "-m", "helios_core.compact_process"]
SERVICE = """
    from helios_core.errors import InvalidInput, Unavailable
    from helios_core.memory_bus import MemoryBus, MemoryHub
    from helios_core import service_process
    from helios_core.service_process import Service
    from helios_core.settings import ServiceSettings

    service_process._connect = lambda *_: MemoryBus(MemoryHub())

    class Running:
        def close(self):
            print("{name} closed", flush=True)

    def build(bus, health):
        {build}
        return Running()

    def service(argv=None):
        return Service("{name}", ServiceSettings.load(argv), build)
"""


@pytest.mark.parametrize(
    ("logger", "thread", "name"),
    [
        ("helios_map2d.service", "x", "map2d"),
        ("helios_core.zenoh_bus", "read plan", "read plan"),
        ("uvicorn.error", "http", "http"),
    ],
)
def test_a_log_record_names_its_service(logger: str, thread: str, name: str) -> None:
    record = logging.LogRecord(logger, logging.INFO, "", 1, "text", (), None)
    record.threadName = thread
    assert ServiceName().filter(record)
    assert record.__dict__["service"] == name


@pytest.mark.parametrize(
    ("build", "flags", "status", "said"),
    [
        ("raise InvalidInput('no map; name one')", [], 2, "helios-second: no map; name one"),
        ("raise Unavailable('no disk; free some')", [], 1, "helios-second: no disk; free some"),
        ("1 / 0", [], 1, "ZeroDivisionError"),
        ("pass", ["--log-level", "loud"], 2, "no log level is called 'loud'"),
    ],
)
def test_if_one_service_ends_all_end_with_its_status(
    build: str, flags: list[str], status: int, said: str, tmp_path: Path
) -> None:
    for name, does in ("first", "pass"), ("second", build):
        folder = tmp_path / f"helios_{name}"
        folder.mkdir()
        (folder / "__init__.py").touch()
        code = textwrap.dedent(SERVICE).format(name=name, build=does)
        (folder / "__main__.py").write_text(code)
    services = json.dumps([["helios_first"], ["helios_second", *flags]])
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
    done = subprocess.run(
        [*RUN, services],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == status, done.stderr
    assert said in done.stderr
    assert ("first closed" in done.stdout) is (not flags)
