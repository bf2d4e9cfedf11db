"""The command as a person calls it, in processes of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from helios_client.doctor import examine

from tests.support import free_port


def helios(*args: str, home: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "helios_client", *args], capture_output=True, text=True, timeout=60,
        env=os.environ | {"XDG_STATE_HOME": str(home)}, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("heavy", ["numpy", "cv2", "zenoh", "httpx", "google.protobuf"])
def test_help_does_not_wait_for_heavy_imports(heavy: str) -> None:
    code = f"import sys, helios_client.cli; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    "command", [[], ["up"], ["task"], ["status"], ["replay"], ["bench"], ["doctor"]]
)
def test_every_command_has_help(command: list[str], tmp_path: Path) -> None:
    done = helios(*command, "--help", home=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Usage: helios" in done.stdout


@pytest.mark.parametrize(
    "args",
    [
        ["frobnicate"],
        ["task"],
        ["up", "--port", "many"],
        ["up", "--port", "0"],
        ["up", "--robot", "replay", "--detector", "simulated"],
        ["up", "--robot", "my_package:MyRobot"],
        ["replay", "x", "--classes", "cup,,", "--detector", "simulated", "--out", "y"],
    ],
)
def test_wrong_use_is_one_sentence_and_status_2(args: list[str], tmp_path: Path) -> None:
    done = helios(*args, home=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("helios: ")
    assert done.stderr.count("\n") == 1


def test_nobody_there_is_one_sentence_and_status_1(tmp_path: Path) -> None:
    for args in (["status"], ["task", "move it"]):
        done = helios(*args, "--port", str(free_port()), home=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert "helios up" in done.stderr


def test_a_port_in_use_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = helios("up", "--port", str(port), home=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert str(port) in done.stderr
    assert "--port" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "words"), [("tour.mcap", "MCAP"), ("nowhere", "no data set at"), (".", "meta.json")]
)
def test_a_data_set_that_cannot_be_played_is_said(name: str, words: str, tmp_path: Path) -> None:
    done = helios(
        "replay", str(tmp_path / name), "--classes", "cup", "--detector", "onnx:x.onnx", "--out",
        str(tmp_path / "out"), home=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert words in done.stderr


def test_the_doctor_names_what_is_missing_and_how_to_mend_it() -> None:
    found = examine(free_port(), has_package=lambda p: p != "mujoco", find_library=lambda _: None)
    missing = {f.what.split()[1]: f.mend for f in found if not f.ok}
    assert missing["mujoco"] == "pip install 'helios-ovmm[sim]'"
    assert "apt-get install" in " ".join(missing.values())
    assert set(missing) <= {"mujoco", "EGL", "GL", "OSMesa", "in"}
