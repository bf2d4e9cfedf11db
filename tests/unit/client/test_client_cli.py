"""The command line as a user calls it."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from helios_client.cli import run
from helios_client.commands import doctor
from helios_client.commands.doctor import examine
from helios_client.supervision.service_specs import StackOptions
from helios_client.version import helios_version

from tests.support import free_port


@dataclass(frozen=True)
class CommandResult:
    status: int
    out: str
    error: str


class Helios:
    """The command with its own state folder."""

    def __init__(self, home: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.home, self._capsys = home, capsys

    def __call__(self, *args: str) -> CommandResult:
        status = run(args)
        said = self._capsys.readouterr()
        return CommandResult(status, said.out, said.err)


@pytest.fixture
def helios(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Helios:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return Helios(tmp_path, capsys)


@pytest.mark.parametrize("heavy", ["numpy", "cv2", "zenoh", "httpx", "google.protobuf"])
def test_importing_the_command_line_loads_no_heavy_package(heavy: str) -> None:
    code = f"import sys, helios_client.cli; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    "command",
    [
        [],
        ["up"],
        ["task"],
        ["watch"],
        ["tasks"],
        ["names"],
        ["go"],
        ["explore"],
        ["home"],
        ["logs"],
        ["camera"],
        ["cancel"],
        ["status"],
        ["stop"],
        ["clear-stop"],
        ["objects"],
        ["map"],
        ["map", "export"],
        ["record"],
        ["replay"],
        ["bench"],
        ["doctor"],
        ["eval"],
        ["assets"],
    ],
)
def test_every_command_has_help(command: list[str], helios: Helios) -> None:
    done = helios(*command, "--help")
    assert (done.status, done.error) == (0, "")
    assert "Usage: helios" in done.out


@pytest.mark.parametrize(
    "args",
    [
        ["frobnicate"],
        ["task"],
        ["up", "--port", "many"],
        ["up", "--port", "0"],
        ["up", "--robot", "replay", "--detector", "simulated"],
        ["up", "--robot", "my_package:MyRobot"],
        ["up", "--robot", "replay", "--source", "/none.mcap"],
        ["replay", "x", "--classes", "cup,,", "--detector", "simulated", "--out", "y"],
        ["replay", "x", "--classes", "cup", "--detector", "bogus", "--out", "y"],
        ["up", "--detector", "onnx:"],
        ["up", "--name", "a/b"],
        ["bench", "--only", "nope", "--json", "x.json"],
        ["map", "paint"],
        ["tasks", "--state", "bogus"],
        ["map", "reset", "--only", "walls"],
    ],
)
def test_a_usage_error_prints_one_sentence_and_exits_with_status_2(
    args: list[str], helios: Helios
) -> None:
    done = helios(*args)
    assert done.status == 2
    assert done.error.startswith("helios: ")
    assert done.error.count("\n") == 1
    assert "Value error" not in done.error


@pytest.mark.parametrize("args", [[], ["map"], ["assets"]])
def test_a_command_group_without_a_command_prints_its_usage(
    args: list[str], helios: Helios
) -> None:
    done = helios(*args)
    assert (done.status, done.out) == (2, "")
    assert done.error.startswith("Usage: helios")


def test_an_unreachable_gateway_prints_one_sentence_and_exits_with_status_1(helios: Helios) -> None:
    for args in (
        ["status"], ["task", "move it"], ["go", "1", "-2"], ["explore"],
        ["home"], ["tasks"], ["cancel", "t1"], ["stop"], ["clear-stop"],
        ["objects"], ["map", "export"],
    ):  # fmt: skip
        done = helios(*args, "--port", str(free_port()))
        assert (done.status, done.error.count("\n")) == (1, 1)
        assert "helios up" in done.error


def test_up_names_a_port_in_use_and_leaves_no_files(helios: Helios) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = helios("up", "--port", str(port))
    assert (done.status, done.error.count("\n")) == (1, 1)
    assert str(port) in done.error
    assert "--port" in done.error
    assert not list(helios.home.iterdir())


@pytest.mark.parametrize(
    ("name", "status", "words"),
    [
        ("tour.mcap", 2, "no data set at"),
        ("nowhere", 2, "no data set at"),
        ("empty.mcap", 1, "no MCAP file"),
        (".", 1, "there is no data set at"),
    ],
)
def test_replay_reports_a_data_set_that_it_cannot_play(
    name: str, status: int, words: str, helios: Helios
) -> None:
    (helios.home / "empty.mcap").touch()
    done = helios(
        "replay",
        str(helios.home / name),
        "--classes",
        "cup",
        "--detector",
        "transformers:x/y",
        "--out",
        str(helios.home / "out"),
    )
    assert (done.status, done.error.count("\n")) == (status, 1)
    assert words in done.error


def test_the_doctor_names_missing_dependencies_and_how_to_install_them() -> None:
    absent = ("mujoco", "viser")
    found = examine(free_port(), lambda p: p not in absent, find_library=lambda _: None)
    missing = {f.what.split()[1]: f.remedy for f in found if not f.ok}
    assert missing["mujoco"] == "pip install 'helios-ovmm[sim]'"
    assert "apt-get install" in " ".join(missing.values())
    assert missing["viser,"] == "pip install 'helios-ovmm[viewer]'"
    assert {f.what.split()[1] for f in found if not f.ok and f.optional} == {"viser,"}
    assert set(missing) <= {"mujoco", "viser,", "EGL", "GL", "OSMesa", "in"}


@pytest.mark.parametrize(("port", "another"), [(80, 8080), (8080, 8081), (65535, 65534)])
def test_the_doctor_recommends_a_port_that_exists(
    port: int, another: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = OSError(errno.EADDRINUSE, "Address already in use")
    monkeypatch.setattr(doctor, "port_bind_error", lambda _: taken)
    [remedy] = [f.remedy for f in examine(port) if f.what == f"port {port} free"]
    assert remedy.endswith(f"helios up --port {another}")


def test_the_shell_completes_commands_and_subcommands(monkeypatch: pytest.MonkeyPatch) -> None:
    for words, expected in (("helios cl", "clear-stop"), ("helios map ex", "export")):
        done = subprocess.run(
            [sys.executable, "-c", "from helios_client.cli import main; main()"],
            env=os.environ
            | {
                "_HELIOS_COMPLETE": "complete_bash",
                "COMP_WORDS": words,
                "COMP_CWORD": str(words.count(" ")),
            },
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        assert expected in done.stdout.split(), done.stderr


@pytest.mark.parametrize(
    ("set_to", "folder"), [("1", Path("recordings")), ("0", None), (None, None)]
)
def test_an_environment_variable_makes_every_start_record(
    set_to: str | None,
    folder: Path | None,
    helios: Helios,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    started: list[StackOptions] = []
    monkeypatch.setattr("helios_client.supervision.up.up", lambda stack, *_: started.append(stack))
    if set_to is not None:
        monkeypatch.setenv("HELIOS_RECORD", set_to)
    assert helios("up", "--state", str(tmp_path)).status == 0
    assert started[0].record == (folder and tmp_path / folder)


def test_the_version_is_reported_by_an_option_and_by_the_doctor(helios: Helios) -> None:
    assert helios("--version") == CommandResult(0, f"helios {helios_version()}\n", "")
    reported = helios("doctor", "--port", str(free_port())).out
    assert f"ok      HELIOS {helios_version()}\n" in reported


@pytest.mark.parametrize(
    "args",
    [
        ["--port", "PORT", "status"],
        ["--port=PORT", "map", "export"],
        ["--url", "localhost:PORT", "objects"],
        ["--port", "1", "status", "--port", "PORT"],
        ["--robot", "x", "--port", "PORT", "tasks", "--limit", "3"],
        ["status", "--url", "http://localhost:PORT/"],
    ],
)
def test_address_options_are_accepted_before_or_after_the_command(
    args: list[str], helios: Helios
) -> None:
    port = str(free_port())
    done = helios(*(arg.replace("PORT", port) for arg in args))
    assert (done.status, done.out) == (1, "")
    assert f":{port}; start HELIOS with" in done.error


def test_other_options_before_the_command_are_refused_with_the_right_order(helios: Helios) -> None:
    done = helios("--json", "status")
    assert done.status == 2
    assert "helios COMMAND --json" in done.error
    assert helios("--port", "8080").status == 2
    assert helios("--port", "8080", "--help").status == 0


@pytest.mark.parametrize(
    "url", ["ftp://localhost", "http://", "localhost:99999", "a b:1?x=y", ":0"]
)
def test_an_invalid_url_is_a_usage_error(
    url: str, helios: Helios, monkeypatch: pytest.MonkeyPatch
) -> None:
    for args in (["status"], ["stop"], ["mcp"]):
        done = helios(*args, "--url", url)
        assert (done.status, done.error.count("\n")) == (2, 1)
        assert "wanted http://HOST:PORT or HOST:PORT" in done.error
    monkeypatch.setenv("HELIOS_URL", url)
    assert helios("tasks").status == 2


def test_the_doctor_prints_its_findings_as_json(helios: Helios) -> None:
    done = helios("doctor", "--json", "--port", str(free_port()))
    assert {"what", "ok", "remedy", "optional"} == set(json.loads(done.out)["findings"][0])
