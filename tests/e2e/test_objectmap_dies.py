"""SIGKILL of the object map in mid-task: it is back with its map, or says why it is not."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import OBJECTMAP_ACK, OBJECTS, TRUTH_EPISODE
from helios_core.zenoh_bus import ZenohBus

from tests.house import House
from tests.support import wait_until

pytestmark = pytest.mark.timeout(420)

OLD_S = 5.0  # what is older than this when the service dies, it still knows afterwards
KEPT = Path("objectmap") / "objects.npz"  # below the state folder


class Watched:
    """A house at work, and when the object map took up which frame."""

    def __init__(self, house: House, bus: Bus) -> None:
        self.house, self.bus = house, bus
        self.taken: list[tuple[float, int]] = []  # instant, number of the frame
        bus.subscribe(OBJECTMAP_ACK, self._on_ack)
        self.instruction = bus.call(TRUTH_EPISODE, pb.Empty(), 10).instruction
        self.task = ""
        self.works_on()

    def works_on(self) -> None:
        """Give the task (again) unless it is being worked on."""
        if not self.task or self.house.task(self.task)["state"] != "running":
            self.task = self.house.post("/v1/tasks", {"instruction": self.instruction})["id"]

    def objects(self) -> pb.ObjectsReply:
        return self.bus.call(OBJECTS, pb.ObjectsRequest(), 10)

    def kept(self) -> Path:
        return self.house.state / KEPT

    def kill(self) -> None:
        os.kill(self.house.pid("objectmap"), signal.SIGKILL)

    def back(self, before: dict) -> str:
        """Wait until it is ready under another process; what it says of itself."""

        def is_back() -> bool:
            now = self.house.service("objectmap")
            return now["state"] == "ready" and now["pid"] != before["pid"]

        wait_until(is_back, 60, "the object map is back")  # loaded machines are slow
        return self.house.service("objectmap")["reason"]

    def takes_more(self, frames: int) -> None:
        """Wait until it has taken up so many more frames."""
        enough = len(self.taken) + frames
        wait_until(lambda: len(self.taken) >= enough, 120, f"{frames} more frames are taken up")

    def _on_ack(self, ack: pb.Ack) -> None:
        if ack.accepted:
            self.taken.append((time.monotonic(), ack.id.seq))


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    house = House(tmp_path_factory.mktemp("state"))
    bus: ZenohBus | None = None
    try:
        wait_until(house.ready, 180, "all services are ready")
        bus = ZenohBus(f"tcp/127.0.0.1:{house.router_port}")
        yield Watched(house, bus)
    finally:
        if bus is not None:
            bus.close()
        house.close()


def test_a_killed_object_map_is_back_with_what_it_knew_5_s_before_and_says_so(
    watched: Watched,
) -> None:
    def works() -> bool:
        long_ago = bool(watched.taken) and time.monotonic() - watched.taken[0][0] > OLD_S
        return long_ago and any(o.score >= 0.5 for o in watched.objects().objects)

    wait_until(works, 150, "something is believed")
    known, since = watched.objects(), time.monotonic()
    wait_until(lambda: time.monotonic() - since > OLD_S, 60, "that is 5 s old")
    before, killed = watched.house.service("objectmap"), time.monotonic()
    watched.kill()
    said = watched.back(before)

    assert "the map was restored" in said
    newest = re.search(r"frames up to number (\d+)", said)
    assert newest, said
    assert int(newest[1]) >= max(n for at, n in watched.taken if at < killed - OLD_S), said
    now = watched.objects()
    assert now.id.seq >= int(newest[1])
    assert now.gaussians > 0.9 * known.gaussians
    for o in known.objects:
        if o.score >= 0.5:
            near = [p for p in now.objects if p.class_name == o.class_name and is_near(p, o)]
            assert near, f"{o.class_name} {o.id} is forgotten"
    watched.takes_more(3)
    assert watched.house.task(watched.task)["state"] == "running"
    assert said.split("; ")[0] in (watched.house.state / "logs" / "objectmap.log").read_text()


@pytest.mark.parametrize("kind", ["truncated", "foreign"])
def test_a_kept_map_that_cannot_be_used_is_put_aside_and_said(watched: Watched, kind: str) -> None:
    wait_until(watched.kept().is_file, 30, "a map is kept")
    before = watched.house.service("objectmap")
    watched.kill()  # nobody writes the file now; the next process reads it after its imports
    if kind == "truncated":
        watched.kept().write_bytes(watched.kept().read_bytes()[:-1000])
    else:
        np.savez(watched.kept(), header=np.arange(3), means=np.zeros((4, 3)))
    wrong = watched.kept().read_bytes()
    said = watched.back(before)

    assert "refused and put aside" in said, said
    aside = re.search(r"put aside as (\S+):", said)
    assert aside, said
    assert Path(aside[1]).read_bytes() == wrong
    watched.takes_more(3)
    watched.works_on()  # a robot that stands still may see nothing that it seeks
    wait_until(lambda: watched.objects().gaussians > 0, 120, "it maps anew")
    wait_until(watched.kept().is_file, 30, "the new map is kept")


def is_near(a: pb.ObjectInstance, b: pb.ObjectInstance) -> bool:
    p, q = ((o.center_m.x, o.center_m.y, o.center_m.z) for o in (a, b))
    return float(np.linalg.norm(np.subtract(p, q))) < 0.5
