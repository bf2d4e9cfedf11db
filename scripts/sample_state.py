"""Make a sample of the state folder that this version leaves, for the tests of later versions.

    python -m scripts.sample_state tests/earlier_releases/state-0.3.0.tar.xz

It starts `helios up --robot sim --seed 3`, explores, begins the first suggested task, saves the
map, stops, and packs the state folder without logs, and `saved.map`.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

READY_S, TASK_S, STOP_S = 600.0, 300.0, 60.0  # deadlines
HELIOS = [sys.executable, "-m", "helios_client"]
EXPLORATION, SEARCH_S = "explore for five seconds", 25


def request(url: str, body: dict[str, Any] | None = None) -> Any:
    """JSON answer of a GET, or of a POST if there is a body."""
    data = None if body is None else json.dumps(body).encode()
    asked = urllib.request.Request(url, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(asked, timeout=30) as answer:
        return json.load(answer)


def wait_until_ready(port: int, process: subprocess.Popen) -> None:
    """Raises TimeoutError if the services do not get ready, RuntimeError if they end."""
    deadline = time.monotonic() + READY_S
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise RuntimeError(f"helios up ended with {process.returncode}")
        said = subprocess.run(
            [*HELIOS, "status", "--json", "--port", str(port)], capture_output=True, check=False
        )
        if said.returncode == 0 and json.loads(said.stdout).get("ready"):
            return
        time.sleep(1)
    raise TimeoutError(f"the services were not ready within {READY_S:.0f} s")


def do(api: str, instruction: str, more: dict[str, Any]) -> None:
    """Submit a task and wait for its end."""
    task = request(f"{api}/tasks", {"instruction": instruction, **more})
    deadline = time.monotonic() + TASK_S
    while time.monotonic() < deadline:
        now = request(f"{api}/tasks/{task['id']}")
        if now["state"] not in ("queued", "running"):
            print(f"{instruction}: {now['state']}, {now['message']}", flush=True)
            return
        time.sleep(1)
    raise TimeoutError(f"{instruction!r} did not end within {TASK_S:.0f} s")


def make(out: Path, port: int, folder: Path) -> None:
    state, api = folder / "state", f"http://127.0.0.1:{port}/v1"
    up = [*HELIOS, "up", "--robot", "sim", "--seed", "3", "--port", str(port), "--state", state]
    process = subprocess.Popen(up)
    try:
        wait_until_ready(port, process)
        do(api, EXPLORATION, {})
        do(api, request(f"{api}/suggestions")["tasks"][0], {"time_limit_s": SEARCH_S})
        saved = str(folder / "saved.map")
        subprocess.run([*HELIOS, "map", "save", "--port", str(port), saved], check=True)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(STOP_S)
    kept = [
        p for p in state.rglob("*") if p.is_file() and "logs" not in p.parts and p.stat().st_size
    ]
    with tarfile.open(out, "w:xz") as archive:
        for path in sorted([*kept, folder / "saved.map"]):
            archive.add(path, path.relative_to(folder))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, help="the file to write, state-VERSION.tar.xz")
    parser.add_argument(
        "--port", type=int, default=18431, help="port of helios up (default: 18431)"
    )
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        make(given.out.resolve(), given.port, Path(folder))


if __name__ == "__main__":
    main()
