"""Two detector processes share four robots: every keyframe is answered once, even if one dies."""

import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import outside_package
import pytest
from detector_scene import SceneTruth, context_of, frame_of
from helios_core import proto as pb
from helios_core.bus_access import FLEET_BUS
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.name_rules import robot_names
from helios_core.topics import (
    CONTEXT,
    FRAME,
    KEYFRAME,
    OBSERVATION,
    PREVIEW,
    VOCABULARY,
    status_topic,
)
from helios_core.zenoh_bus import ZenohBus
from helios_detector.detector_fleet import Fleet, RobotSlot
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.model_set import Models
from helios_detector.model_usage import ModelUsage
from helios_detector.robot_assignment import Members
from helios_detector.settings import Settings
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector

from tests.support import free_port, wait_until

ROBOTS = ("ada", "bob", "cleo", "dan")


class Robot:
    """A robot that sends frames and counts answers."""

    def __init__(self, endpoint: str, name: str) -> None:
        self.name, self.bus = name, ZenohBus(endpoint, name)
        self.answers: Counter[int] = Counter()
        self.previews: Counter[int] = Counter()
        self.statuses: list[pb.ServiceStatus] = []
        self.seq = 0
        self.bus.subscribe(OBSERVATION, lambda o: self.answers.update([o.frame.id.seq]))
        self.bus.subscribe(PREVIEW, lambda p: self.previews.update([p.id.seq]))
        self.bus.subscribe(status_topic("detector"), self.statuses.append)
        self.bus.publish(CONTEXT, context_to_proto(context_of("mug", id=name)))

    def send(self, keyframe: bool = True) -> int:
        self.seq += 1
        message = frame_to_proto(frame_of(seq=self.seq))
        self.bus.publish(KEYFRAME if keyframe else FRAME, message)
        return self.seq

    def meet(self) -> None:
        """Sends keyframes until one is answered: those before a detector subscribes are lost."""

        def answered() -> bool:
            return bool(self.answers) or not self.send()

        wait_until(answered, 60, f"{self.name} is answered")
        wait_until(lambda: self.answers[self.seq] == 1, 60, "the last one, too")


class Fleets:
    """A router, and detectors that can be started and killed."""

    def __init__(self, folder: Path) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        outside = str(outside_package.write(folder / "outside"))
        self._env = os.environ | {"PYTHONPATH": outside}
        self._running = [self._run("helios_core.router", "--listen", self.endpoint)]

    def detector(self, model: str = "patient:0.05") -> subprocess.Popen[bytes]:
        return self._run(
            "helios_detector",
            "--router",
            self.endpoint,
            "--robots",
            ",".join(ROBOTS),
            "--detector",
            model,
            "--scorer",
            "half:0.5",
        )

    def robots(self) -> list[Robot]:
        def is_up() -> bool:
            try:
                ZenohBus(self.endpoint, "probe").close()
            except Unavailable:
                return False
            return True

        wait_until(is_up, 60, "the router answers")
        return [Robot(self.endpoint, name) for name in ROBOTS]

    def close(self) -> None:
        for process in reversed(self._running):
            process.kill()
            process.wait()

    def _run(self, module: str, *argv: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen([sys.executable, "-m", module, *argv], env=self._env)
        if hasattr(self, "_running"):
            self._running.append(process)
        return process


@pytest.fixture
def fleets(tmp_path: Path) -> Iterator[Fleets]:
    out = Fleets(tmp_path)
    yield out
    out.close()


def shares(robots: list[Robot]) -> list[int]:
    """Numbers of robots per detector, from their status; empty until all robots are served."""
    if not all(r.statuses and r.statuses[-1].state == "ready" for r in robots):
        return []
    return sorted(Counter(r.statuses[-1].instance for r in robots).values())


@pytest.mark.timeout(240)
def test_two_detectors_share_four_robots_and_answer_every_keyframe_once(fleets: Fleets):
    first, second = fleets.detector(), fleets.detector()
    robots = fleets.robots()
    try:
        wait_until(lambda: shares(robots) == [2, 2], 60, "both have half of the robots")
        for robot in robots:
            robot.meet()
        for _ in range(5):
            for robot in robots:
                robot.send()
                robot.send(keyframe=False)
        wait_until(
            lambda: all(set(range(r.seq - 9, r.seq, 2)) <= r.answers.keys() for r in robots),
            60,
            "every keyframe is answered",
        )

        # One dies while it works: the other takes over the unanswered keyframes.
        for robot in robots:
            robot.send()
        first.send_signal(signal.SIGKILL)
        later = [robot.send() for robot in robots]
        wait_until(
            lambda: all(r.answers[n] for r, n in zip(robots, later, strict=True)),
            60,
            "the one that is left answers for all robots",
        )
        wait_until(lambda: shares(robots) == [4], 60, "it says so")
        for robot in robots:
            assert all(robot.answers[n] == 1 for n in robot.answers), robot.answers
            reply = robot.bus.call(VOCABULARY, pb.Empty(), 5.0)
            assert (reply.open, reply.detector, reply.scorer) == (True, "patient:0.05", "half")

        # A new detector takes its share.
        fleets.detector()
        wait_until(lambda: shares(robots) == [2, 2], 60, "two are at work again")
        last = [robot.send() for robot in robots]
        wait_until(
            lambda: all(r.answers[n] for r, n in zip(robots, last, strict=True)), 60, "answered"
        )
        assert all(r.answers[n] == 1 for r, n in zip(robots, last, strict=True))
        second.send_signal(signal.SIGTERM)
        assert second.wait(30) == 0
    finally:
        for robot in robots:
            robot.bus.close()


@pytest.mark.timeout(240)
def test_a_frozen_detector_loses_its_robots_and_takes_its_share_when_it_resumes(fleets: Fleets):
    first, _ = fleets.detector(), fleets.detector()
    robots = fleets.robots()
    try:
        wait_until(lambda: shares(robots) == [2, 2], 60, "both have half of the robots")
        for robot in robots:
            robot.meet()
        first.send_signal(signal.SIGSTOP)
        meanwhile = [robot.send() for robot in robots]
        wait_until(
            lambda: all(r.answers[n] for r, n in zip(robots, meanwhile, strict=True)),
            60,
            "the other answers for all robots",
        )
        first.send_signal(signal.SIGCONT)
        wait_until(lambda: shares(robots) == [2, 2], 60, "it is back")
        last = [robot.send() for robot in robots]
        wait_until(
            lambda: all(r.answers[n] for r, n in zip(robots, last, strict=True)), 60, "answered"
        )
        assert all(r.answers[n] == 1 for r, n in zip(robots, last, strict=True))
    finally:
        first.send_signal(signal.SIGCONT)
        for robot in robots:
            robot.bus.close()


@pytest.mark.timeout(120)
def test_a_model_that_cannot_be_loaded_is_reported_to_every_robot(fleets: Fleets):
    fleets.detector("patient:-1")
    robots = fleets.robots()
    try:
        wait_until(
            lambda: all(r.statuses and r.statuses[-1].state == "degraded" for r in robots),
            60,
            "every robot is told",
        )
        assert "cannot be loaded (ValueError: time runs forward)" in robots[0].statuses[-1].reason
    finally:
        for robot in robots:
            robot.bus.close()


def test_a_robot_gets_the_loading_state_until_the_models_work_and_never_after():
    hub, loading, members = MemoryHub(), Health(), Members("me", ["ada"])
    reported: list[str] = []
    MemoryBus(hub, "ada").subscribe(status_topic("detector"), lambda s: reported.append(s.state))
    loading.waiting("loading the models")
    slot = RobotSlot("ada", MemoryBus(hub, "ada"), members, threading.Lock(), loading)
    try:
        wait_until(lambda: reported[-1:] == ["waiting"], 60, "it is told to wait")
        models = Models(GroundTruthDetector(SceneTruth()), LexicalScorer())
        slot.begin(models, ModelUsage())
        members.change(members.me, True, 0.0)
        wait_until(lambda: reported[-1:] == ["ready"], 60, "it is told that they work")
        del reported[:]
        loading.waiting("said late")
        wait_until(lambda: len(reported) >= 2, 60, "it is told again")
        assert set(reported) == {"ready"}
    finally:
        slot.stop()
        slot.finish(1.0)


def test_a_robot_cannot_have_the_name_of_the_fleet_bus():
    with pytest.raises(InvalidInput, match="no robot can be called"):
        robot_names(FLEET_BUS)


def test_a_simulated_detector_is_refused_for_several_robots():
    settings = Settings(robots="ada,bob", detector="simulated")
    with pytest.raises(InvalidInput, match="knows one simulated world; start one for each robot"):
        Fleet(MemoryBus(MemoryHub(), "_detectors"), Health(), settings)
