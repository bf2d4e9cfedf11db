"""`helios up` with a real router and services that do nothing."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import psutil
import pytest
from helios_client.supervision import state_file
from helios_client.supervision.service_specs import StackOptions
from helios_client.supervision.up import Screen, check_port
from helios_client.supervision.up import up as run_up
from helios_client.usage_errors import UsageError
from helios_core.errors import Conflict, InvalidInput

from tests.support import free_port, wait_until

PROGRAM = Path(__file__).with_name("client_small_stack.py")


class Up:
    """A running `helios up`."""

    def __init__(self, folder: Path, preset: str = "demo-v1", **variables: str) -> None:
        self.folder, self.port = folder, free_port()
        self.process = subprocess.Popen(
            [sys.executable, str(PROGRAM), str(self.port), str(folder / "state"), preset],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"XDG_STATE_HOME": str(folder / "home")} | variables,
        )
        self.children: set[psutil.Process] = set()

    def status(self) -> dict[str, Any]:
        """The status as `helios status` reads it; without a file, an empty list of services."""
        return state_file.read(self.folder / "state") or {"ready": False, "services": []}

    def wait_ready(self) -> None:
        wait_until(lambda: self.status()["ready"], 60, "all services are ready")
        self.children |= set(psutil.Process(self.process.pid).children(recursive=True))

    def service(self, name: str) -> dict[str, Any]:
        return next(s for s in self.status()["services"] if s["name"] == name)

    def nothing_left(self) -> bool:
        return not any(c.is_running() and c.status() != psutil.STATUS_ZOMBIE for c in self.children)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@pytest.fixture
def up(tmp_path: Path) -> Iterator[Up]:
    up = Up(tmp_path)
    yield up
    up.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_all_processes_and_clears_the_status(up: Up, number: signal.Signals) -> None:
    up.wait_ready()
    up.process.send_signal(number)
    out, error = up.process.communicate(timeout=60)
    assert (up.process.returncode, error) == (0, "")
    assert f"dashboard at http://127.0.0.1:{up.port}" in out
    assert up.nothing_left()
    assert up.status()["services"] == []


def test_a_killed_service_is_restarted_and_the_restart_is_reported(up: Up) -> None:
    up.wait_ready()
    before = up.service("gateway")["pid"]
    os.kill(before, signal.SIGKILL)
    wait_until(lambda: up.service("gateway")["restarts"] == 1, 60, "the restart is counted")
    up.wait_ready()
    after = up.service("gateway")
    assert after["pid"] != before
    assert "SIGKILL" in after["reason"]
    home = state_file.read(up.folder / "home" / "helios" / str(up.port))
    assert home is not None  # found without knowing --state
    up.process.terminate()
    assert "gateway ended (ended by SIGKILL" in up.process.communicate()[0]


def test_a_killed_router_is_restarted_and_services_reconnect(up: Up) -> None:
    up.wait_ready()
    os.kill(up.service("router")["pid"], signal.SIGKILL)
    wait_until(lambda: up.service("router")["restarts"] == 1, 60, "the router was restarted")
    # A restarted service can report to the supervisor only over the new router.
    os.kill(up.service("map2d")["pid"], signal.SIGKILL)
    wait_until(lambda: up.service("map2d")["restarts"] == 1, 60, "the service was restarted")
    wait_until(lambda: up.service("map2d")["state"] == "ready", 60, "it is ready again")


def test_services_end_when_the_supervisor_is_killed(up: Up) -> None:
    up.wait_ready()
    up.process.kill()
    up.process.wait()
    wait_until(up.nothing_left, 60, "the services have ended by themselves")


def test_flags_that_a_service_refuses_end_the_stack_with_its_error(tmp_path: Path) -> None:
    up = Up(tmp_path, preset="wrong")
    _, error = up.process.communicate(timeout=30)
    assert up.process.returncode == 1
    assert "no-such-flag" in error
    assert up.nothing_left()


def test_a_degraded_service_is_reported_at_once_and_only_once(tmp_path: Path) -> None:
    up = Up(tmp_path, preset="detector")
    try:
        wait_until(
            lambda: any(s["state"] == "degraded" for s in up.status()["services"]),
            60,
            "it is degraded",
        )
        up.process.terminate()
        out, _ = up.process.communicate(timeout=60)
    finally:
        up.close()
    said = "detector is degraded: the detector mine gave in detect() a mask uint8 (4, 4)"
    assert out.count(said) == 1


def test_a_second_supervisor_on_the_same_state_directory_is_refused(up: Up) -> None:
    up.wait_ready()
    second = Up(up.folder)
    _, error = second.process.communicate(timeout=20)
    assert second.process.returncode == 1
    assert "--state" in error
    assert up.status()["ready"]


def test_the_stack_keeps_running_when_its_output_pipe_is_closed(up: Up) -> None:
    """As after `helios up | tee log` when tee ends."""
    up.wait_ready()
    assert up.process.stdout is not None
    up.process.stdout.close()
    os.kill(up.service("gateway")["pid"], signal.SIGKILL)  # reported to a closed pipe
    wait_until(lambda: up.service("gateway")["restarts"] == 1, 60, "the restart is counted")
    up.wait_ready()
    up.process.terminate()
    _, error = up.process.communicate(timeout=60)
    assert (up.process.returncode, error) == (0, "")
    assert up.nothing_left()


def test_a_path_that_the_terminal_cannot_encode_does_not_end_the_stack(tmp_path: Path) -> None:
    up = Up(tmp_path / "Küche", PYTHONIOENCODING="ascii")
    try:
        up.wait_ready()
        up.process.terminate()
        out, error = up.process.communicate(timeout=60)
        assert (up.process.returncode, error) == (0, "")
        assert "K?che" in out
    finally:
        up.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has 127.0.0.2")
def test_the_routers_port_is_tested_at_the_address_that_it_listens_on(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.2", 0))
        other.listen()
        port = other.getsockname()[1]
        check_port(port, "--router-port")  # free at 127.0.0.1
        stack = StackOptions("sim", port, tmp_path, port=free_port(), router_host="0.0.0.0")
        with pytest.raises(Conflict, match=rf"port {port} at 0\.0\.0\.0 is in use.*--router-port"):
            run_up(stack, Screen())
    check_port(port, "--router-port", "0.0.0.0")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this machine has no IPv6")
def test_a_port_in_use_is_found_at_all_addresses_of_ipv6() -> None:
    with socket.socket(socket.AF_INET6) as other:
        other.bind(("::1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(Conflict, match=f"port {port} at :: is in use"):
            check_port(port, "--router-port", "::")


def test_an_address_that_this_machine_lacks_is_reported_as_such() -> None:
    with pytest.raises(Conflict, match=r"has no address 192\.0\.2\.1 .*with --router-host"):
        check_port(0, "--router-port", "192.0.2.1")  # an address for documents, RFC 5737


def test_the_gateways_port_is_tested_also_if_all_services_share_a_process(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        stack = StackOptions("sim", free_port(), tmp_path, port=port, compact=True)
        with pytest.raises(Conflict, match=rf"port {port} is in use; .* with --port"):
            run_up(stack, Screen())


@pytest.fixture
def starts_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helios_client.supervision.up._Run", Mock())
    monkeypatch.setattr("helios_client.supervision.up.on_signals", Mock())


@pytest.mark.usefixtures("starts_nothing")
def test_one_port_for_gateway_and_router_is_refused(tmp_path: Path) -> None:
    port = free_port()
    with pytest.raises(UsageError, match=f"--port and --router-port are both {port}"):
        run_up(StackOptions("sim", port, tmp_path / "state", port=port), Screen())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("starts_nothing")
def test_a_file_in_place_of_the_log_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "logs").touch()
    stack = StackOptions("sim", free_port(), tmp_path, port=free_port())
    with pytest.raises(InvalidInput, match=r"state folder .*/logs: File exists.*with --state"):
        run_up(stack, Screen())


@pytest.mark.usefixtures("starts_nothing")
def test_a_file_in_place_of_the_folder_of_recordings_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    stack = StackOptions("sim", free_port(), tmp_path / "state", port=free_port(), record=file)
    with pytest.raises(UsageError, match=f"the folder {file} cannot be made: File exists"):
        run_up(stack, Screen())


def test_a_forbidden_port_is_reported_differently_from_a_port_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    with pytest.raises(Conflict, match=r"port 80: Permission denied .*1024.* with --port"):
        run_up(StackOptions("sim", 7447, tmp_path, port=80), Screen())
