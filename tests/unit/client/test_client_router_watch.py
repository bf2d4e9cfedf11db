"""The supervisor replaces a router that runs but passes nothing on."""

from __future__ import annotations

from helios_client.supervision.router_watch import SILENT_S, RouterWatch
from helios_client.supervision.service_table import ServiceTable
from helios_client.supervision.supervisor import ProcessInfo, ProcessState
from helios_core import proto as pb


class Bench:
    """A router and some services that report at chosen times."""

    def __init__(self, pids: dict[str, int]) -> None:
        self.now_s = 100.0
        self.pids = {"router": 1} | pids
        self.service_table = ServiceTable(lambda: self.now_s)
        self.watch = RouterWatch(self.service_table, lambda: self.now_s)

    def is_stuck(self) -> bool:
        table = [
            ProcessInfo(name, pid, 0, ProcessState.RUNNING, "") for name, pid in self.pids.items()
        ]
        return self.watch.is_stuck(table)

    def go_on(self, seconds: float, *reporting: str) -> list[bool]:
        """Look every second, with reports of these services before each look."""
        said = []
        for _ in range(round(seconds)):
            self.now_s += 1.0
            for name in reporting:
                self.service_table.on_status(pb.ServiceStatus(service=name, pid=self.pids[name]))
            said.append(self.is_stuck())
        return said


TWO = {"map2d": 2, "planner": 3}


def test_a_router_over_which_nobody_is_heard_is_stuck() -> None:
    bench = Bench(TWO)
    assert not any(bench.go_on(5, "map2d", "planner"))
    said = bench.go_on(SILENT_S + 2)
    assert said.index(True) == SILENT_S  # the first look after SILENT_S seconds


def test_one_service_that_is_still_heard_shows_that_the_router_works() -> None:
    bench = Bench(TWO)
    bench.go_on(5, "map2d", "planner")
    assert not any(bench.go_on(60, "planner"))


def test_a_new_router_is_left_alone_until_a_service_was_heard_over_it() -> None:
    bench = Bench(TWO)
    bench.go_on(5, "map2d", "planner")
    bench.go_on(SILENT_S + 1)
    bench.pids["router"] = 9
    assert not any(bench.go_on(60))
    bench.go_on(1, "map2d", "planner")
    assert any(bench.go_on(SILENT_S + 1))


def test_a_single_process_that_falls_silent_says_nothing_about_the_router() -> None:
    for pids in ({"map2d": 2}, {"map2d": 2, "planner": 2}):
        bench = Bench(pids)
        bench.go_on(5, *pids)
        assert not any(bench.go_on(60))


def test_silence_while_the_machine_stood_still_does_not_count() -> None:
    bench = Bench(TWO)
    bench.go_on(5, "map2d", "planner")
    bench.now_s += 3600.0
    assert not bench.is_stuck()
    assert not any(bench.go_on(SILENT_S - 1))
    assert any(bench.go_on(2))


def test_without_a_router_here_or_while_it_restarts_nothing_is_stuck() -> None:
    bench = Bench(TWO)
    bench.go_on(5, "map2d", "planner")
    bench.now_s += 1.0
    services = [ProcessInfo(n, p, 0, ProcessState.RUNNING, "") for n, p in TWO.items()]
    router = ProcessInfo("router", 0, 1, ProcessState.RESTARTING, "ended by SIGKILL")
    for _ in range(60):
        bench.now_s += 1.0
        assert not bench.watch.is_stuck(services)
        assert not bench.watch.is_stuck([router, *services])
