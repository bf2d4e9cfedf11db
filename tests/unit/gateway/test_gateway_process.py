"""The gateway as a process: ports, start, clean stop."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import httpx
import pytest
import uvicorn
from helios_core.errors import Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.api_keys import ApiKeys
from helios_gateway.service import Gateway, bind
from helios_gateway.settings import Settings

from tests.gateway_backend import Backend
from tests.gateway_process import served
from tests.support import free_port, read_to_the_end, wait_until


def test_a_port_in_use_prints_one_sentence_and_exits_with_status_1() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "helios_gateway", "--port", str(port)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert done.stderr == (
        f"helios-gateway: port {port} on 127.0.0.1 is in use; choose another with --port\n"
    )


def test_missing_keys_are_told_before_a_router_is_found() -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "helios_gateway", "--host", "0.0.0.0", "--port", "0"]
    done = subprocess.run(
        [*command, "--router", router], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert "API keys are needed: make one with helios key" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_host_address_of_another_machine_is_refused() -> None:
    with pytest.raises(Unavailable, match="--host"):
        bind("192.0.2.1", 0)


def test_the_gateway_streams_events_and_closes_with_open_streams(
    hub: MemoryHub, backend: Backend
) -> None:
    health = Health()
    listener = bind("127.0.0.1", 0)
    port = listener.getsockname()[1]
    settings = Settings.load(["--tick-s", "0.05"])
    gateway = Gateway(
        MemoryBus(hub), health, settings, listener, ApiKeys(None), lambda name: MemoryBus(hub, name)
    )
    assert health.state == ("ready", f"http://127.0.0.1:{port}/")
    with (
        httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=20) as client,
        client.stream("GET", "/v1/events") as stream,
    ):
        assert stream.headers["content-type"].startswith("text/event-stream")
        lines = stream.iter_lines()
        assert next(line for line in lines if line == "event: ready")
        client.post("/v1/tasks", json={"instruction": "move the mug"})
        assert next(line for line in lines if line == "event: task")
        rest = read_to_the_end(lines)
        gateway.close()
        assert rest.wait(20), "the stream has not ended"


def test_a_gateway_alone_reports_missing_services_and_stops_on_sigterm() -> None:
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    gateway = subprocess.Popen(
        [sys.executable, "-m", "helios_gateway", "--port", str(port), "--router", endpoint]
    )
    router = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", endpoint])
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=20) as client:

            def up() -> bool:
                try:
                    return client.get("/healthz").status_code == 200
                except httpx.TransportError:
                    return False

            wait_until(up, 60, "the gateway answers")
            ready = client.get("/readyz")
            assert ready.status_code == 503
            assert "planner is down: it has not been seen; start it" in ready.json()["reasons"]
            assert client.post("/v1/robot/stop").status_code == 503
            with client.stream("GET", "/v1/events") as stream:
                next(stream.iter_lines())
                gateway.send_signal(signal.SIGTERM)
                assert gateway.wait(20) == 0  # after 2 s it would exit with status 1
    finally:
        for process in (gateway, router):
            process.kill()
            process.wait()


@pytest.mark.parametrize("fault", [None, RuntimeError("the loop broke"), SystemExit(3)])
def test_a_web_server_that_ends_by_itself_ends_the_process(
    hub: MemoryHub, backend: Backend, monkeypatch: pytest.MonkeyPatch, fault: BaseException | None
) -> None:
    ended: list[int] = []

    def run(server: uvicorn.Server, sockets: list[socket.socket]) -> None:
        if fault is not None:
            raise fault

    monkeypatch.setattr("helios_gateway.service.os._exit", ended.append)
    monkeypatch.setattr(uvicorn.Server, "run", run)
    listener = bind("127.0.0.1", 0)
    gateway = Gateway(
        MemoryBus(hub),
        Health(),
        Settings.load([]),
        listener,
        ApiKeys(None),
        lambda name: MemoryBus(hub, name),
    )
    wait_until(lambda: ended, 60, "the process is told to end")
    gateway.close()
    listener.close()
    assert ended == [1]


@pytest.mark.parametrize(
    ("proxies", "host"), [("", "127.0.0.1"), ("10.0.0.1", "127.0.0.1"), ("127.0.0.1", "10.1.2.3")]
)
def test_only_a_listed_proxy_says_who_asks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, proxies: str, host: str
) -> None:
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "*")
    file = tmp_path / "audit.jsonl"
    with served("--audit", str(file), "--proxies", proxies) as gateway:
        headers = {"x-forwarded-for": "10.1.2.3"}
        answer = httpx.post(f"{gateway.url}/v1/robot/stop", headers=headers, timeout=20)
        assert answer.status_code == 200
    assert json.loads(file.read_text())["host"] == host


def test_a_proxy_that_is_no_address_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        Settings.load(["--proxies", "127.0.0.1, my-proxy"])
    assert "'my-proxy' is no IP address" in capsys.readouterr().err
