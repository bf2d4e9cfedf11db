"""Tests a complete task with a fake Spot: driver over real services, detector, maps and planner."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("bosdyn.client", reason="pip install 'helios-ovmm[spot]'")

from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings as BridgeSettings
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CLEAR_STOP, GET_TASK, SUBMIT, TASK
from helios_core.types import Detection, Frame, SearchContext
from helios_detector.backend import DetectorBackend, Findings, Seen
from helios_detector.model_loading import open_scorer
from helios_detector.service import DetectorService
from helios_map2d.service import Map2DService
from helios_map2d.settings import Settings as Map2DSettings
from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.service import PlannerService
from helios_planner.settings import Settings as PlannerSettings
from helios_spot.driver import SpotDriver
from helios_spot.settings import SpotSettings
from pydantic import SecretStr

from tests.fake_spot.rooms import tea_room
from tests.fake_spot.server import PASSWORD, USER, FakeSpot
from tests.fake_spot.world import World
from tests.support import wait_until

TASK_S = 240.0
INSTRUCTION = "Move the mug from the table to the bench"
HUES = {"mug": (0, 8), "bench": (55, 75), "table": (110, 125)}  # in OpenCV's units


class ColourDetector(DetectorBackend):
    """Finds coloured shapes: each connected region of a hue is an object of that class."""

    name = "colours"

    def vocabulary(self) -> tuple[str, ...]:
        return tuple(HUES)

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return {c.name: f"{c.name} has no colour" for c in context.classes if c.name not in HUES}

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        if self.refused(context):
            raise InvalidInput("a class without a colour")
        hsv = cv2.cvtColor(frame.color, cv2.COLOR_RGB2HSV)
        found: list[Detection] = []
        for wanted in context.classes:
            low, high = HUES[wanted.name]
            mask = cv2.inRange(hsv, np.array([low, 150, 60]), np.array([high, 255, 255]))
            mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
            count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
            for k in range(1, count):
                x, y, w, h, area = (int(v) for v in stats[k])
                if area >= 25:
                    found.append(Detection(wanted.name, 0.9, (x, y, x + w, y + h), labels == k))
        seen = tuple(Seen(d.class_name, d.score) for d in found)
        return Findings(tuple(found), seen)

    def warm_up(self) -> None:
        """Nothing to warm up."""

    def close(self) -> None:
        """Nothing to close."""


class Stack:
    """Every service on one memory bus, in lockstep, with Spot behind the bridge."""

    def __init__(self, folder: Path) -> None:
        self.ended = threading.Event()
        with ExitStack() as opened:
            self._open(folder, opened)
            self._opened = opened.pop_all()

    def _open(self, folder: Path, opened: ExitStack) -> None:
        hub = MemoryHub()

        def new_bus() -> MemoryBus:
            return opened.enter_context(closing(MemoryBus(hub)))

        world = World(*tea_room(), hurry=8.0, skew_s=40.0)
        self.fake = opened.enter_context(closing(FakeSpot(folder, world)))
        self._bus = new_bus()
        self._bus.subscribe(TASK, self._on_task)
        opened.enter_context(closing(Map2DService(new_bus(), Map2DSettings.load([]), Health())))
        objects = ObjectMapService(new_bus(), ObjectMapSettings(agent="helios-paper"), Health())
        opened.enter_context(closing(objects)).warm_up()
        scorer = open_scorer("lexical")
        detector = DetectorService(new_bus(), ColourDetector(), scorer, Health())
        opened.enter_context(closing(detector))
        settings = SpotSettings(
            host="127.0.0.1",
            port=self.fake.port,
            ca_file=self.fake.ca_file,
            username=USER,
            password=SecretStr(PASSWORD),
            speed_m_s=0.5,
            rpc_timeout_s=30,
            command_s=3,
        )
        bus, chosen = new_bus(), BridgeSettings(stream_hz=0, lockstep=True)
        driver = SpotDriver(bus, settings=settings)
        opened.enter_context(closing(BridgeService(bus, driver, chosen, Health())))
        kept = PlannerSettings(agent="helios-paper", state_dir=folder / "tasks")
        opened.enter_context(closing(PlannerService(new_bus(), kept, Health())))

    def begin(self, instruction: str) -> str:
        """Submit a task; its id."""
        return self._bus.call(SUBMIT, pb.SubmitRequest(instruction=instruction), 30).id

    def task(self, id: str) -> pb.Task:
        return self._bus.call(GET_TASK, pb.TaskRequest(id=id), 10)

    def end(self, id: str) -> pb.Task:
        """Wait until the task ends; the ended task."""
        assert self.ended.wait(TASK_S), "the task did not end"
        return self.task(id)

    def clear_stop(self) -> None:
        """Raises Conflict."""
        self._bus.call(CLEAR_STOP, pb.Empty(), 10)

    def close(self) -> None:
        self._opened.close()

    def _on_task(self, task: pb.Task) -> None:
        if task.state in ("succeeded", "failed", "cancelled"):
            self.ended.set()


@dataclass(frozen=True)
class Episode:
    """One task from its first step to its end, and its state while the tablet held the lease."""

    world: World
    paused: pb.Task
    moving: bool
    lease_owner: str
    refused: str  # the answer to clearing the stop too early
    ended: pb.Task


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Episode]:
    """An operator takes the lease once the robot moves, clears the stop too early, returns the
    lease, and clears the stop once, without waiting."""
    with closing(Stack(tmp_path_factory.mktemp("spot"))) as stack:
        world = stack.fake.world
        id = stack.begin(INSTRUCTION)
        wait_until(lambda: world.moving, 60, "the robot moves")
        stack.fake.leases.give_to("the tablet")
        wait_until(lambda: stack.task(id).state == "paused", 60, "the task pauses")
        then = stack.task(id), world.moving, world.lease_owner
        with pytest.raises(Conflict) as refused:
            stack.clear_stop()
        stack.fake.leases.free()
        stack.clear_stop()
        yield Episode(world, *then, refused.value.message, stack.end(id))


@pytest.mark.long
def test_a_task_pauses_while_the_tablet_holds_the_lease(episode: Episode) -> None:
    assert episode.paused.state == "paused"
    assert "the tablet has taken the robot's lease" in episode.paused.message
    assert not episode.moving
    assert episode.lease_owner == "the tablet"
    assert "cannot clear the stop: the tablet holds the robot's lease" in episode.refused


def test_the_task_continues_after_the_stop_is_cleared_and_moves_the_mug_to_the_bench(
    episode: Episode,
) -> None:
    assert episode.ended.state == "succeeded", episode.ended.message
    world = episode.world
    low, high = world.fixed["bench"].bounds
    x, y, z = world.things["mug"].center
    assert low[0] <= x <= high[0]
    assert low[1] <= y <= high[1]
    assert abs(z - 0.06 - high[2]) < 0.01  # the mug stands on the bench
    assert world.bumps == 0
    assert world.fastest <= 0.5
    assert not world.moving
