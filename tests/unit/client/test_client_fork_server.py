"""Services forked by the fork server of `helios up`, as small real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from helios_client.supervision import forked_process
from helios_client.supervision.child_process import ProcessSpec
from helios_client.supervision.forked_process import ForkServer, is_wanted
from helios_client.supervision.supervisor import Supervisor

from tests.support import wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a fork server")

STAY = "import sys, time; print('up', *sys.argv[1:], flush=True); time.sleep(60)"
SAID = "up --flag a value"
MARK = "HELIOS_TEST_MARK"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    """A fork server whose services are modules of a folder of their own."""
    folder, before = tmp_path_factory.mktemp("modules"), Path.cwd()
    (folder / "stay.py").write_text(STAY)
    (folder / "fails.py").write_text(
        "import sys; print('helios-fails: no x', file=sys.stderr); sys.exit(2)"
    )
    (folder / "dice.py").write_text(
        "import random, uuid, numpy; print(random.random(), numpy.random.random(), uuid.uuid4())"
    )
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", paths)
        patched.setenv(MARK, "of the fork server")
        patched.chdir(folder)
        server = ForkServer()
        yield server
        server.close()
    assert Path.cwd() == before


@pytest.fixture
def start(server: ForkServer, tmp_path: Path) -> Iterator:
    """Start modules as services; ends them after the test."""
    made: list[Supervisor] = []

    def start(*modules: str) -> Supervisor:
        specs = [ProcessSpec(m, (sys.executable, "-m", m, "--flag", "a value")) for m in modules]
        made.append(Supervisor(specs, tmp_path, fork_server=server))
        made[-1].start()
        return made[-1]

    yield start
    for supervisor in made:
        supervisor.stop()


def test_a_forked_service_looks_like_one_with_an_interpreter_of_its_own(
    start, tmp_path: Path
) -> None:
    pid = start("stay").table()[0].pid
    wait_until(lambda: (tmp_path / "stay.log").read_text() == f"{SAID}\n", 60, "it runs")
    process = psutil.Process(pid)
    assert process.ppid() == os.getpid()
    assert os.getsid(pid) == pid
    assert " ".join(process.cmdline()).rstrip() == f"{sys.executable} -m stay --flag a value"
    assert process.environ()[MARK] == "of the fork server"
    assert process.num_threads() == 1
    assert {Path(file.path).name for file in process.open_files()} <= {"stay.log"}


def test_the_ending_of_a_forked_service_is_reported(start) -> None:
    supervisor = start("stay", "fails")
    endings: dict[str, str] = {}

    def both() -> bool:
        endings.update((name, ending.reason) for name, ending in supervisor.check())
        return len(endings) == 2

    os.kill(supervisor.table()[0].pid, signal.SIGKILL)
    wait_until(both, 60, "both ended")
    assert endings == {"stay": endings["stay"], "fails": "helios-fails: no x"}
    assert endings["stay"].startswith("ended by SIGKILL")
    assert [row.restarts for row in supervisor.table()] == [1, 0]


def test_services_outlive_the_fork_server_and_restart_after_it(
    start, server: ForkServer, tmp_path: Path
) -> None:
    supervisor = start("stay")
    wait_until(lambda: SAID in (tmp_path / "stay.log").read_text(), 60, "it runs")
    first = supervisor.table()[0].pid
    server._process.kill()
    server._process.wait()
    assert supervisor.check() == ()
    assert psutil.Process(first).ppid() == os.getpid()
    os.kill(first, signal.SIGKILL)
    wait_until(supervisor.check, 60, "it ended")
    again = supervisor.table()[0]
    assert (again.restarts, again.reason) == (1, f"ended by SIGKILL; last log line: {SAID}")
    assert psutil.Process(again.pid).ppid() == os.getpid()


def test_forked_services_draw_different_random_numbers(start, tmp_path: Path) -> None:
    for _ in range(2):
        supervisor = start("dice")
        wait_until(supervisor.check, 60, "it ended")
        supervisor.stop()
    drawn = (tmp_path / "dice.log").read_text().split()
    assert len(set(drawn)) == len(drawn) >= 6


def test_a_fork_server_with_a_thread_forks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "setproctitle.py").write_text(
        "import threading, time\n"
        "threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\n"
        "def setproctitle(title): pass"
    )
    (tmp_path / "stay.py").write_text(STAY)
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path if path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path), paths)))
    server = ForkServer()
    supervisor = Supervisor(
        [ProcessSpec("stay", (sys.executable, "-m", "stay"))], tmp_path, fork_server=server
    )
    try:
        supervisor.start()
        wait_until(lambda: (tmp_path / "stay.log").read_text() == "up\n", 60, "it runs")
        assert psutil.Process(supervisor.table()[0].pid).cmdline()[1:] == ["-m", "stay"]
    finally:
        supervisor.stop()
        server.close()


def test_a_forked_service_ends_when_its_supervisor_is_killed(tmp_path: Path) -> None:
    program = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from helios_client.supervision.forked_process import ForkServer\n"
        "pid = ForkServer().fork('http.server', ['0'], Path(sys.argv[1])).pid\n"
        "print(pid, flush=True)\n"
        "os.kill(os.getpid(), 9)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "p.log")],
        capture_output=True,
        text=True,
        check=False,
    )
    pid = int(done.stdout)
    wait_until(lambda: not psutil.pid_exists(pid), 60, "the service has ended too")


@pytest.mark.parametrize(("value", "wanted"), [(None, True), ("1", True), ("0", False)])
def test_a_variable_turns_the_fork_server_off(value: str | None, wanted: bool) -> None:
    environment = {} if value is None else {forked_process.SWITCH: value}
    assert is_wanted(environment) is wanted
