"""`helios up` with certificates: its flags, the processes it starts, services of other machines."""

from __future__ import annotations

import datetime as dt
import subprocess
import sys
from pathlib import Path

import pytest
from helios_client.certs.folder import create
from helios_client.certs.names import Names
from helios_client.cli import run
from helios_client.supervision.service_specs import StackOptions
from helios_client.supervision.service_table import NOT_SEEN, SILENT_S, ServiceTable, is_ready
from helios_core import proto as pb
from helios_core.errors import InvalidInput


@pytest.fixture
def certs(tmp_path: Path) -> Path:
    out = tmp_path / "certs"
    names = Names(("10.0.0.2",), 7447, 9).with_robots(("robot",), (), simulated=False)
    create(out, names, 9, dt.datetime.now(dt.UTC))
    return out


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--router-host", "0.0.0.0"], "certificates are needed: helios certs init DIR"),
        (["--router-host", "10.0.0.2"], "wanted 127.0.0.1 for this machine alone, or 0.0.0.0"),
        (["--certs", "none"], "helios certs creates it"),
    ],
)
def test_the_router_opens_only_with_certificates(
    flags: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["up", *flags]) != 0
    assert says in capsys.readouterr().err


def test_a_missing_certificate_is_reported_before_anything_starts(
    certs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = ["--certs", str(certs), "--state", str(tmp_path / "state"), "--port", "18999"]
    assert run(["up", *flags]) == 1
    out, err = capsys.readouterr()
    assert "world.robot.json5 does not exist" in err
    assert "helios certs add DIR --simulation" in err
    assert "starting" not in out


def test_every_process_gets_the_certificates_and_an_encrypted_router(certs: Path) -> None:
    stack = StackOptions("spot", 7447, Path("state"), port=8080, certs=certs, router_host="0.0.0.0")
    for spec in stack.processes():
        argv = list(spec.argv)
        assert argv[argv.index("--certs") + 1] == str(certs)
        flag, host = ("--listen", "0.0.0.0") if spec.name == "router" else ("--router", "127.0.0.1")
        assert argv[argv.index(flag) + 1] == f"tls/{host}:7447"
        if spec.name != "router":
            assert stack.link(spec.name).session == certs / "sessions" / f"{spec.name}.robot.json5"


def test_a_remote_robot_has_no_bridge_here_and_is_waited_for() -> None:
    stack = StackOptions("remote", 7447, Path("state"), port=8080)
    assert "bridge" not in [spec.name for spec in stack.processes()]
    now_s = 100.0
    table = ServiceTable(clock=lambda: now_s)
    assert [(r.state, r.reason) for r in table.rows((), ("bridge",))] == [("waiting", NOT_SEEN)]
    table.on_status(pb.ServiceStatus(service="bridge", state="ready", pid=7))
    assert is_ready(table.rows((), ("bridge",)))
    now_s += SILENT_S + 1
    [row] = table.rows((), ("bridge",))
    assert (row.state, "see its machine" in row.reason) == ("waiting", True)


@pytest.mark.parametrize("module", ["helios_map2d", "helios_core.router"])
def test_a_process_refuses_a_certificate_that_others_may_read(certs: Path, module: str) -> None:
    for file in (certs / "router.json5", certs / "sessions" / "map2d.robot.json5"):
        file.chmod(0o640)
    argv = [sys.executable, "-m", module, "--certs", str(certs)]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    [sentence] = done.stderr.splitlines()
    assert "mode 0640" in sentence
    assert "run: chmod 600" in sentence


def test_a_link_with_certificates_is_never_unencrypted(certs: Path) -> None:
    stack = StackOptions("spot", 7447, Path("state"), certs=certs)
    assert str(stack.link("map2d")) == "tls/127.0.0.1:7447"
    with pytest.raises(InvalidInput, match="does not exist"):
        stack.link("world")
