"""The supervisor with small real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_client.supervision import child_process
from helios_client.supervision.child_process import ProcessSpec
from helios_client.supervision.supervisor import STEADY_S, ProcessState, Supervisor, restart_delay_s

from tests.support import wait_until

STAY = "import time; time.sleep(60)"
STUBBORN = (
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
    "print('deaf', flush=True); time.sleep(60)"
)


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Bench:
    """Creates supervisors and stops those that still run."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.clock = folder, Clock()
        self._made: list[Supervisor] = []

    def __call__(self, *programs: str, restart: bool = True) -> Supervisor:
        specs = [
            ProcessSpec(f"p{i}", (sys.executable, "-c", code)) for i, code in enumerate(programs)
        ]
        self._made.append(Supervisor(specs, self.folder, restart, self.clock))
        return self._made[-1]

    def close(self) -> None:
        for supervisor in self._made:
            supervisor.stop()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    bench.close()


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] != "Z"


def wait_for_ending(supervisor: Supervisor) -> None:
    wait_until(supervisor.check, 60, "a process ended")


def test_a_killed_process_is_restarted_at_once(bench: Bench) -> None:
    supervisor = bench(STAY)
    supervisor.start()
    first = supervisor.table()[0]
    os.kill(first.pid, signal.SIGKILL)
    wait_for_ending(supervisor)
    again = supervisor.table()[0]
    assert (again.state, again.restarts, again.reason) == (
        ProcessState.RUNNING,
        1,
        "ended by SIGKILL",
    )
    assert again.pid != first.pid
    assert is_alive(again.pid)


def test_the_first_restart_is_immediate_and_later_ones_wait_up_to_5_s() -> None:
    delays = [restart_delay_s(n) for n in range(1, 20)]
    assert delays[0] == 0
    assert delays == sorted(delays)
    assert delays[-1] == 5


def test_a_process_that_keeps_failing_is_restarted_with_growing_delays(bench: Bench) -> None:
    supervisor = bench("import sys; print('no model at x'); sys.exit(1)")
    supervisor.start()
    wait_for_ending(supervisor)  # the same check makes the first restart
    assert supervisor.table()[0].state is ProcessState.RUNNING
    for failures in (2, 3, 4):
        wait_for_ending(supervisor)
        row = supervisor.table()[0]
        assert (row.state, row.pid, row.reason) == (
            ProcessState.RESTARTING,
            0,
            "exit status 1; last log line: no model at x",
        )
        bench.clock.now_s += restart_delay_s(failures) - 0.01
        supervisor.check()
        assert supervisor.table()[0].state is ProcessState.RESTARTING
        bench.clock.now_s += 0.02
        supervisor.check()
        assert supervisor.table()[0].restarts == failures


def test_a_steady_run_resets_the_restart_delay(bench: Bench) -> None:
    supervisor = bench(STAY)
    supervisor.start()
    for restarts in range(1, 5):
        bench.clock.now_s += STEADY_S + 1
        os.kill(supervisor.table()[0].pid, signal.SIGKILL)
        wait_for_ending(supervisor)
        assert supervisor.table()[0].restarts == restarts
        assert supervisor.table()[0].state is ProcessState.RUNNING


def test_a_process_with_a_usage_error_is_not_restarted(bench: Bench) -> None:
    supervisor = bench("import sys; print('wrong setting: seed', file=sys.stderr); sys.exit(2)")
    supervisor.start()
    wait_for_ending(supervisor)
    bench.clock.now_s += 60
    assert supervisor.check() == ()
    row = supervisor.table()[0]
    assert (row.state, row.restarts, row.reason) == (ProcessState.STOPPED, 0, "wrong setting: seed")


def test_a_process_whose_settings_break_after_a_steady_run_is_retried_every_5_s(
    bench: Bench,
) -> None:
    good = bench.folder / "good"
    good.touch()
    supervisor = bench(
        f"import pathlib, sys, time\nif pathlib.Path({str(good)!r}).exists(): time.sleep(60)\n"
        "print('keys.toml is no TOML'); sys.exit(2)"
    )
    supervisor.start()
    bench.clock.now_s += STEADY_S + 1
    good.unlink()
    os.kill(supervisor.table()[0].pid, signal.SIGKILL)
    wait_for_ending(supervisor)  # the immediate restart fails
    for restarts in (1, 2):
        wait_for_ending(supervisor)
        row = supervisor.table()[0]
        assert (row.state, row.reason) == (ProcessState.RESTARTING, "keys.toml is no TOML")
        bench.clock.now_s += 4.9
        supervisor.check()
        assert supervisor.table()[0].restarts == restarts
        bench.clock.now_s += 0.2
        supervisor.check()
        assert supervisor.table()[0].restarts == restarts + 1
    wait_for_ending(supervisor)
    good.touch()
    bench.clock.now_s += 5.1
    supervisor.check()
    assert supervisor.table()[0].state is ProcessState.RUNNING


def test_without_restart_an_ended_process_stays_down(bench: Bench) -> None:
    supervisor = bench("print('done')", restart=False)
    supervisor.start()
    wait_for_ending(supervisor)
    assert supervisor.table()[0].state is ProcessState.STOPPED


def test_the_reason_ignores_log_lines_of_an_earlier_start(bench: Bench) -> None:
    (bench.folder / "p0.log").write_text("an old complaint\n")
    supervisor = bench("import sys; sys.exit(3)", restart=False)
    supervisor.start()
    wait_for_ending(supervisor)
    assert supervisor.table()[0].reason == "exit status 3"


def test_the_log_of_a_running_process_stays_small_and_its_last_lines_are_kept(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_process, "KEEP_LOG_BYTES", 1000)
    log, older, go = (bench.folder / name for name in ("p0.log", "p0.log.1", "go"))
    chatty = (
        "import pathlib, sys, time\n"
        "print(*(f'line {n}' for n in range(200)), sep=chr(10), flush=True)\n"
        f"while not pathlib.Path({str(go)!r}).exists(): time.sleep(0.01)\n"
        "print('the end', flush=True); sys.exit(3)"
    )
    supervisor = bench(chatty, restart=False)
    supervisor.start()

    def emptied() -> bool:
        supervisor.check()
        return older.exists() and older.read_text().endswith("line 199\n")

    wait_until(emptied, 60, "the full log has become the older one")
    go.touch()
    wait_for_ending(supervisor)
    assert supervisor.table()[0].reason == "exit status 3; last log line: the end"
    assert log.read_text() == "the end\n"  # the process goes on at the new end


@pytest.mark.parametrize(
    ("end", "reported"),
    [
        ("os._exit(7)", "exit status 7; last log line: INFO ready"),
        ("os.kill(os.getpid(), 11)", "ended by SIGSEGV; last log line: INFO ready"),
        ("os._exit(2)", "INFO ready"),  # usage error: the log line is the reason
    ],
)
def test_the_reason_names_the_exit_status_or_signal_and_the_last_log_line(
    bench: Bench, end: str, reported: str
) -> None:
    supervisor = bench(f"import os; print('INFO ready', flush=True); {end}", restart=False)
    supervisor.start()
    wait_for_ending(supervisor)
    assert supervisor.table()[0].reason == reported


def test_stop_ends_processes_that_ignore_sigterm_and_their_children(bench: Bench) -> None:
    parent = (
        "import subprocess, sys; p = subprocess.Popen([sys.executable, '-c', "
        f"{STUBBORN!r}]); print(p.pid, flush=True); p.wait()"
    )
    supervisor = bench(STAY, STUBBORN, parent)
    supervisor.start()
    logs = [bench.folder / "p1.log", bench.folder / "p2.log"]
    wait_until(
        lambda: all("deaf" in log.read_text() for log in logs if log.exists()), 60, "they started"
    )
    pids = [row.pid for row in supervisor.table()]
    pids.append(int(logs[1].read_text().split()[0]))
    supervisor.stop()
    wait_until(lambda: not any(map(is_alive, pids)), 60, "all are gone")
    assert {row.state for row in supervisor.table()} == {ProcessState.STOPPED}
    assert supervisor.check() == ()


def test_a_process_marked_ends_last_ends_after_the_others(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("TERMINATE_WITHIN_S", "LAST_WITHIN_S"):
        monkeypatch.setattr(f"helios_client.supervision.supervisor.{name}", 30.0)
    tell = (
        "import signal, sys, time\n"
        "def end(*_):\n"
        "    time.sleep(float(sys.argv[2]))\n"
        "    open(sys.argv[1], 'a').write(sys.argv[3]); sys.exit()\n"
        "signal.signal(signal.SIGTERM, end); print('up', flush=True); time.sleep(60)"
    )
    order = bench.folder / "order"
    supervisor = Supervisor(
        [
            ProcessSpec(name, (sys.executable, "-c", tell, str(order), pause, name), ends_last=last)
            for name, pause, last in (("router", "0", True), ("service", "0.3", False))
        ],
        bench.folder,
    )
    supervisor.start()
    logs = [bench.folder / "router.log", bench.folder / "service.log"]
    wait_until(lambda: all(log.read_text() for log in logs), 60, "both listen for signals")
    supervisor.stop()
    assert order.read_text() == "servicerouter"


def test_services_of_one_process_share_its_id_and_its_restarts(bench: Bench) -> None:
    spec = ProcessSpec("services", (sys.executable, "-c", STAY), hosts=("map2d", "planner"))
    supervisor = Supervisor([spec], bench.folder)
    supervisor.start()
    try:
        first = supervisor.table()
        assert [row.name for row in first] == ["map2d", "planner"]
        assert len({row.pid for row in first}) == 1
        os.kill(first[0].pid, signal.SIGKILL)
        wait_for_ending(supervisor)
        again = supervisor.table()
        assert [row.restarts for row in again] == [1, 1]
        assert {row.pid for row in again}.isdisjoint({first[0].pid})
    finally:
        supervisor.stop()


def test_a_missing_program_leaves_no_process_running(bench: Bench) -> None:
    specs = [
        ProcessSpec("good", (sys.executable, "-c", STAY)),
        ProcessSpec("bad", ("/no/such/program",)),
    ]
    supervisor = Supervisor(specs, bench.folder)
    with pytest.raises(FileNotFoundError):
        supervisor.start()
    assert all(row.pid == 0 for row in supervisor.table())


def test_a_process_ends_when_its_supervisor_is_killed_right_after_the_start(bench: Bench) -> None:
    program = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from helios_client.supervision.child_process import ChildProcess, ProcessSpec\n"
        f"spec = ProcessSpec('p', (sys.executable, '-c', {STAY!r}))\n"
        "print(ChildProcess(spec, Path(sys.argv[1])).pid, flush=True)\n"
        "os.kill(os.getpid(), 9)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(bench.folder / "p.log")],
        capture_output=True,
        text=True,
        check=False,
    )
    wait_until(lambda: not is_alive(int(done.stdout)), 60, "the child has ended too")


def test_a_process_that_is_replaced_starts_again_with_the_given_reason(bench: Bench) -> None:
    supervisor = bench(STUBBORN, STAY)
    supervisor.start()
    first, other = supervisor.table()
    ((name, ending),) = supervisor.replace("p0", "it did not work")
    assert (name, ending.reason) == ("p0", "it did not work")
    assert not Path(f"/proc/{first.pid}").exists()
    assert supervisor.replace("p0", "again") == ()  # it does not run at this moment
    assert supervisor.check() == ()
    again, same = supervisor.table()
    assert (again.state, again.restarts, again.reason) == (
        ProcessState.RUNNING,
        1,
        "it did not work",
    )
    assert again.pid != first.pid
    assert same == other
