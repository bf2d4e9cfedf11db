"""`make test` goes on where Chromium cannot be installed."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "install_browser.sh"


@pytest.mark.parametrize(
    ("apt_get", "said"), [("exit 100", "the dashboard's tests are skipped"), ("exit 0", "")]
)
def test_a_failed_installation_is_told_and_ends_nothing(
    tmp_path: Path, apt_get: str, said: str
) -> None:
    for name, does in (("uname", "echo Linux"), ("id", "echo 0"), ("apt-get", apt_get)):
        program = tmp_path / name
        program.write_text(f"#!/bin/bash\n{does}\n")
        program.chmod(0o755)
    done = subprocess.run(
        ["/bin/bash", str(SCRIPT)],
        env={"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert said in done.stderr
    assert bool(done.stderr) == bool(said)
