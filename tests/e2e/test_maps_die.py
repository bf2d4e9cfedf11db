"""Tests SIGKILL of a map service during a task: it restores its map, or reports why it cannot."""

from __future__ import annotations

import io
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.map_snapshot import UNKNOWN, MapView, decode_snapshot
from helios_core.topics import MAP2D_ACK, OBJECTMAP_ACK, OBJECTS, SNAPSHOT, TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.stack import Stack
from tests.support import wait_until

pytestmark = pytest.mark.timeout(420)

OLD_S = 5.0  # a service on an idle machine saves its map more often than that
RESTORED = r"the map was restored as it was written .* frames up to number (\d+)"
REFUSED = r"the kept map was refused and put aside as (\S+): "
KEPT = {"objectmap": "objectmap/objects.npz", "map2d": "map2d/map2d.map"}  # in the state folder
MAPS = tuple(KEPT)


class Watched:
    """A running stack, and the time and number of each frame that each map integrated."""

    def __init__(self, stack: Stack, bus: Bus) -> None:
        self.stack, self.bus = stack, bus
        self.taken: dict[str, list[tuple[float, int]]] = {name: [] for name in MAPS}
        bus.subscribe(OBJECTMAP_ACK, self._on_ack)
        bus.subscribe(MAP2D_ACK, self._on_ack)
        self.instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
        self.task = ""
        self._logged = dict.fromkeys(MAPS, 0)  # log sizes in bytes at the last kill
        self.works_on()

    def works_on(self) -> None:
        """Submit the task, or submit it again if it has ended."""
        if not self.task or self.stack.task(self.task)["ended_s"] is not None:
            self.task = self.stack.post("/v1/tasks", {"instruction": self.instruction})["id"]

    def objects(self) -> pb.ObjectsReply:
        return self.bus.call(OBJECTS, pb.ObjectsRequest(), 10)

    def ground(self) -> MapView:
        return decode_snapshot(self.bus.call(SNAPSHOT, pb.SnapshotRequest(), 10))

    def kept(self, name: str) -> Path:
        return self.stack.state / KEPT[name]

    def kill(self, name: str) -> int:
        """Kill a service; the pid of the dead process."""
        pid = self.stack.pid(name)
        self._logged[name] = len(self.log(name))
        os.kill(pid, signal.SIGKILL)
        return pid

    def log(self, name: str) -> bytes:
        return (self.stack.state / "logs" / f"{name}.log").read_bytes()

    def back(self, name: str, killed_pid: int, says: str) -> re.Match[str]:
        """Wait until the service is ready in another process and its status, or its log where a
        frame has arrived since, matches the pattern `says`."""
        found: list[re.Match[str]] = []

        def is_back() -> bool:
            now = self.stack.service(name)
            if now["state"] == "ready" and now["pid"] != killed_pid:
                log = self.log(name)[self._logged[name] :].decode()
                found.extend(re.finditer(says, f"{now['reason']}\n{log}"))
            return bool(found)

        wait_until(is_back, 60, f"{name} is back and says {says!r}")  # loaded machines are slow
        return found[0]

    def works_until(self, condition: Callable[[], object], what: str) -> None:
        """Wait until the condition holds, with a robot at work.

        A task may end at any time (the planner of a slow machine gives up on a map that was away),
        and a robot that stands still takes no keyframes and sees nothing new.
        """

        def holds() -> object:
            self.works_on()
            return condition()

        wait_until(holds, 120, what)

    def takes_more(self, name: str, frames: int) -> None:
        """Wait until the map has integrated `frames` more frames from a robot at work."""
        enough = len(self.taken[name]) + frames
        what = f"{name} takes up {frames} more frames"
        self.works_until(lambda: len(self.taken[name]) >= enough, what)

    def _on_ack(self, ack: pb.Ack) -> None:
        if ack.accepted and ack.part in ("objects", "occupancy"):
            self.taken[ack.service].append((time.monotonic(), ack.id.seq))


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    stack = Stack(tmp_path_factory.mktemp("state"))
    bus: ZenohBus | None = None
    try:
        wait_until(stack.ready, 180, "all services are ready")
        bus = ZenohBus(f"tcp/127.0.0.1:{stack.router_port}")
        yield Watched(stack, bus)
    finally:
        if bus is not None:
            bus.close()
        stack.close()


@pytest.mark.long
@pytest.mark.parametrize("name", MAPS)
def test_a_killed_map_restores_and_reports_its_last_saved_state(
    watched: Watched, name: str
) -> None:
    def works() -> bool:
        long_ago = all(t and time.monotonic() - t[0][0] > OLD_S for t in watched.taken.values())
        return long_ago and any(o.score >= 0.15 for o in watched.objects().objects)

    wait_until(works, 150, "something is believed")
    objects, ground, since = watched.objects(), watched.ground(), time.monotonic()
    writes = {watched.kept(name).stat().st_mtime_ns}

    def is_saved() -> bool:
        """True after two more writes: the first may have begun before `since`."""
        writes.add(watched.kept(name).stat().st_mtime_ns)
        return len(writes) > 2 and time.monotonic() > since + OLD_S

    watched.works_until(is_saved, f"{name} is saved again")
    said = watched.back(name, watched.kill(name), RESTORED)

    newest = int(said[1])
    assert newest >= max(n for at, n in watched.taken[name] if at < since), said[0]
    if name == "objectmap":
        assert_knows_objects(watched.objects(), objects, newest)
    else:
        assert_knows_ground(watched.ground(), ground, newest)
    watched.takes_more(name, 3)
    assert said[0] in watched.log(name).decode()


@pytest.mark.parametrize("kind", ["truncated", "foreign"])
def test_unusable_saved_maps_are_set_aside_and_reported(watched: Watched, kind: str) -> None:
    watched.works_on()
    for name in MAPS:
        wait_until(watched.kept(name).is_file, 60, f"{name} keeps its map")
    killed = {name: watched.kill(name) for name in MAPS}
    wrong: dict[str, bytes] = {}
    for name in MAPS:  # no process writes now; the next one reads the file after its imports
        wrong[name] = (
            foreign_file() if kind == "foreign" else watched.kept(name).read_bytes()[:-1000]
        )
        watched.kept(name).write_bytes(wrong[name])

    for name in MAPS:
        said = watched.back(name, killed[name], REFUSED)
        assert Path(said[1]).read_bytes() == wrong[name]
    for name in MAPS:
        watched.takes_more(name, 3)
    watched.works_until(lambda: watched.objects().gaussians > 0, "objects are mapped anew")
    watched.works_until(lambda: watched.ground().explored_m2 > 1, "ground is mapped anew")
    for name in MAPS:
        wait_until(watched.kept(name).is_file, 60, f"{name} keeps its new map")


def assert_knows_objects(now: pb.ObjectsReply, then: pb.ObjectsReply, newest: int) -> None:
    assert now.id.seq >= newest
    assert now.gaussians > 0.9 * then.gaussians
    for o in then.objects:
        if o.score >= 0.5:
            near = [p for p in now.objects if p.class_name == o.class_name and is_near(p, o)]
            assert near, f"{o.class_name} {o.id} is forgotten"


def is_near(a: pb.ObjectInstance, b: pb.ObjectInstance) -> bool:
    p, q = ((o.center_m.x, o.center_m.y, o.center_m.z) for o in (a, b))
    return float(np.linalg.norm(np.subtract(p, q))) < 0.5


def assert_knows_ground(now: MapView, then: MapView, newest: int) -> None:
    assert now.frame_id.seq >= newest
    assert now.version > then.version
    row, column = (
        round((b - a) / now.cell_m)
        for a, b in zip(now.origin_m[::-1], then.origin_m[::-1], strict=True)
    )
    assert row >= 0 <= column
    rows, columns = then.shape
    same_ground = now.occupancy[row : row + rows, column : column + columns]
    assert same_ground.shape == then.shape
    forgotten = (then.occupancy != UNKNOWN) & (same_ground == UNKNOWN)
    assert not forgotten.any(), f"{forgotten.sum()} cells are forgotten"
    assert np.array_equal(now.trajectory_m[: len(then.trajectory_m)], then.trajectory_m)


def foreign_file() -> bytes:
    """A valid file of another program."""
    stream = io.BytesIO()
    np.savez(stream, header=np.arange(3), means=np.zeros((4, 3)))
    return stream.getvalue()
