"""Runs every command of the README as written, in order, against one simulated home.

Only port, state folder and task id are replaced.
`HELIOS_TEST_SCREENSHOTS=DIR` keeps screenshots of the dashboard, including those of the README.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.browser import chromium
from tests.helios_up import is_ready, started
from tests.support import LOOPBACK, free_port, wait_until

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
# Commands that do not run here, with the reason.
EXEMPT = {
    "make demo": "installs, then does what tests/e2e/test_system.py and the next commands do",
    "make test": "is this suite",
    "source .venv/bin/activate": "the test puts the same folder into PATH",
    "helios record": "records until Ctrl-C; tests/e2e/test_recording.py does",
    "helios view": "serves until Ctrl-C; tests/unit/viewers connects real clients",
    "helios up --robot spot": "needs a Spot; tests/e2e/test_spot_task.py has a fake one",
    "helios replay": "needs a recording and a model; tests/e2e/test_replay.py plays made-up ones",
    "helios eval": "plays for an hour; tests/e2e/test_eval.py plays an episode",
    "helios bench": "takes minutes; each row's unit test runs it small",
    "helios mcp": "speaks to an agent; tests/unit/client/test_client_mcp.py is one",
}

SIZES = {"light": (1600, 1150), "dark": (1600, 1150), "tablet": (820, 1180)}  # of the dashboard

# Exempt commands that the README names only in its text, or may name in the future.
BESIDES = ("helios bench", "helios mcp", "helios record", "helios up --robot spot")


def readme_commands() -> list[str]:
    """The commands of the README's bash blocks, each on one line, without comments."""
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    bare = (re.sub(r"\s+#.*$", "", line).strip() for line in lines)
    return [" ".join(line.split()) for line in bare if line and not line.startswith("#")]


def why_exempt(command: str) -> str | None:
    return next((why for start, why in EXEMPT.items() if command.startswith(start)), None)


COMMANDS = [c for c in readme_commands() if why_exempt(c) is None]


@dataclass
class Stack:
    """The stack that the README's `helios up` started, and its folder and port."""

    folder: Path
    port: int = field(default_factory=free_port)
    task_id: str = ""

    @property
    def environment(self) -> dict[str, str]:
        state = {"XDG_STATE_HOME": str(self.folder / "state"), "MUJOCO_GL": "egl"}
        return os.environ | state | {"PATH": f"{BIN}:{os.environ['PATH']}"}

    def adapted(self, command: str) -> str:
        """The command with this stack's port and task id."""
        command = command.replace("localhost:8080", f"localhost:{self.port}")
        command = re.sub(r"\b(ID|TASK)\b", self.task_id, command)
        if command.startswith("helios ") and not command.startswith("helios key"):
            command += f" --port {self.port}"
        return command

    def newest_task(self) -> dict:
        return LOOPBACK.get(f"http://127.0.0.1:{self.port}/v1/tasks", timeout=60).json()["tasks"][0]


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    stack = Stack(tmp_path_factory.mktemp("readme"))
    [up] = [c for c in COMMANDS if c.startswith("helios up")][:1]
    argv = [*shlex.split(stack.adapted(up)), "--state", str(stack.folder / "up")]
    with started(argv, stack.folder / "up.log", stack.environment, stack.folder):
        wait_until(lambda: is_ready(stack.port), 200, "all services are ready")
        yield stack


def test_each_readme_command_runs_or_is_exempt_with_a_reason() -> None:
    assert len(COMMANDS) >= 8
    stale = [start for start in EXEMPT if not any(c.startswith(start) for c in readme_commands())]
    assert set(stale) <= set(BESIDES), "said to be exempt, and no longer there"
    assert len([c for c in COMMANDS if c.startswith("helios up")]) == 1, "each further one is new"


@pytest.mark.timeout(600)
def test_the_readme_commands_succeed_in_order(stack: Stack) -> None:
    for command in COMMANDS:
        if command.startswith("helios up"):
            continue
        began_s = time.monotonic()
        done = subprocess.run(
            ["bash", "-c", stack.adapted(command)],
            env=stack.environment,
            cwd=stack.folder,
            capture_output=True,
            text=True,
            timeout=500,
            check=False,
        )
        print(f"{time.monotonic() - began_s:6.1f} s  {command}")
        assert done.returncode == 0, f"{command}\n{done.stdout[-1500:]}\n{done.stderr[-1500:]}"
        if command.startswith("curl"):
            assert '"type":"helios:' not in done.stdout, f"{command}\n{done.stdout}"
        if command.startswith("helios task "):
            stack.task_id = stack.newest_task()["id"]


def test_the_dashboard_shows_the_succeeded_task(stack: Stack, tmp_path: Path) -> None:
    assert stack.task_id, "runs after the commands"
    with chromium() as browser:
        for name, (width, height) in SIZES.items():
            page = browser.new_page(
                viewport={"width": width, "height": height},
                has_touch=name == "tablet",
                color_scheme="dark" if name == "dark" else "light",
            )
            page.goto(f"http://localhost:{stack.port}")
            page.locator(f'#history [data-id="{stack.task_id}"]').click()
            page.locator("#task-state", has_text="succeeded").wait_for()
            page.locator("#why-table").wait_for()
            page.locator("#camera").wait_for()
            page.locator("#map-empty").wait_for(state="hidden")
            page.locator("#objects button").first.click()
            page.locator("#object-view").wait_for()
            page.locator("#object-views img").first.wait_for()
            page.evaluate("scrollTo(0, 0)")
            folder = Path(os.environ.get("HELIOS_TEST_SCREENSHOTS") or tmp_path)
            folder.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=folder / f"dashboard-home-{name}.png")
            page.close()
