"""One detector process for several robots; several processes share them (`robot_assignment`).

The process loads the models once. It opens one bus per robot and reports the health there.
"""

from __future__ import annotations

import logging
import os
import threading
import time
import uuid

from helios_core import proto as pb
from helios_core import span_recording, tracing
from helios_core.bus import Bus
from helios_core.bus_access import FLEET_TOKEN
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.image_messages import FrameMessage, kept
from helios_core.name_rules import robot_names
from helios_core.service_process import publish_status
from helios_core.topics import CLAIM, CONTEXT, FRAME, KEYFRAME

from helios_detector.exception_guard import ended_well
from helios_detector.model_set import Models, load_models
from helios_detector.model_usage import ModelUsage
from helios_detector.query_methods import LoadingQueryMethods
from helios_detector.robot_assignment import MOST_HELD, AssignmentTable, Members
from helios_detector.service import DetectorService
from helios_detector.settings import Settings

log = logging.getLogger(__name__)

TICK_S = 0.1
REPORT_S = 1.0
FINISH_WITHIN_S = 1.5  # time at shutdown for frames in work


class RobotSlot:
    """The part of the process that serves one robot: bus, keyframe table and keeper thread."""

    def __init__(
        self, robot: str, bus: Bus, members: Members, lock: threading.Lock, loading: Health
    ) -> None:
        """`loading` holds the state of model loading; the slot publishes it until `begin`."""
        self.robot, self.bus = robot, bus
        self._loading, self._health = loading, Health()
        self._members, self._lock = members, lock  # `lock` guards `_members` and `_ledger`
        self._ledger = AssignmentTable()
        self._answer_lock = threading.Lock()  # its holder answers keyframes
        self._service: DetectorService | None = None
        self._not_yet = LoadingQueryMethods(bus, loading)
        self._reported, self._reported_s = ("", ""), 0.0
        self._fault = ""  # unexpected exception in the keeper's last cycle, as text
        self._closed = False
        self._model_keeper = threading.Thread(target=self._keep, name=f"keep {robot}", daemon=True)
        span_recording.serve(bus, "detector")
        bus.announce("detector", members.me)
        self._model_keeper.start()

    def begin(self, models: Models, usage: ModelUsage) -> DetectorService:
        """Create the robot's service and subscribe to its topics; the models must be warm."""
        service = self._service = DetectorService(
            self.bus,
            models.detector,
            models.scorer,
            self._health,
            models.depth,
            usage=usage,
            listen=False,
        )
        self.bus.subscribe(CLAIM, self._on_claim)
        self.bus.subscribe(CONTEXT, self._on_context)
        self.bus.subscribe_in_place(KEYFRAME, self._on_keyframe)
        self.bus.subscribe_in_place(FRAME, self._on_frame)
        return service

    def give_up(self) -> None:
        """Drop the service after a failed start; `loading` holds the reason."""
        self._service = None

    def stop(self) -> None:
        """Accept no more keyframes."""
        self._closed = True

    def finish(self, within_s: float) -> None:
        """Wait up to `within_s` for the keyframe in work, then close the bus."""
        if self._answer_lock.acquire(timeout=max(0.0, within_s)):
            self._answer_lock.release()
        self.bus.close()

    def _keep(self) -> None:
        """Until stopped: take unanswered keyframes, serve methods while this process owns the robot
        and publish its health."""
        while not self._closed:
            with self._lock:
                owner, strangers = self._members.owner(self.robot), self._members.has_other_lists
            self._fault = self._turned(owner)
            if owner in (self._members.me, None):
                try:
                    self._report(strangers)
                except Exception:  # the next report may succeed
                    log.exception("%s: how it goes could not be told", self.robot)
            time.sleep(TICK_S)

    def _turned(self, owner: str | None) -> str:
        """Run one cycle of the keeper; return its unexpected exception as text, else ""."""
        fault, service = "", self._service
        try:
            self._serve(owner)
            if service is not None:
                service.retry_context()
            self._work()
        except HeliosError as error:
            log.warning("%s: %s", self.robot, error.message)
        except Exception as error:  # the next cycle may succeed
            fault = f"{type(error).__name__}: {error}; see the detector's log"
            if fault != self._fault:
                log.exception("%s: unforeseen", self.robot)
        return fault

    def _serve(self, owner: str | None) -> None:
        """Serve the query methods if this process owns the robot; refuse them while the robot has
        no owner and the models are not loaded."""
        service = self._service
        if service is None and owner is None:
            self._not_yet.open()
            return
        self._not_yet.close()
        if service is not None and owner == self._members.me:
            service.methods.open()
        elif service is not None:
            service.methods.close()

    def _on_keyframe(self, message: FrameMessage) -> None:
        with self._lock:
            given_up = self._ledger.add(kept(message))
            ours = self._members.owner(self.robot) == self._members.me
        if given_up:
            self._health.count("keyframes_given_up", len(given_up))
        service = self._service
        if ours and service is not None:
            for old in given_up:
                service.acknowledge_dropped(
                    old, f"{MOST_HELD} newer keyframes came before it was worked on"
                )
        self._work()

    def _on_frame(self, message: FrameMessage) -> None:
        with self._lock:
            ours = self._members.takes(self.robot, time.monotonic())
        service = self._service
        if ours and service is not None:
            service.on_frame(message)

    def _on_context(self, message: pb.SearchContext) -> None:
        service = self._service
        if service is not None:
            service.on_context(message)
        self._work()

    def _on_claim(self, claim: pb.Claim) -> None:
        with self._lock:
            self._ledger.note(claim)

    def _work(self) -> None:
        """Answer this process's keyframes, oldest first; return at once if another thread does."""
        while self._answer_lock.acquire(blocking=False):
            try:
                message = self._take()
                if message is None:
                    return
                self._answer(message)
            finally:
                self._answer_lock.release()

    def _take(self) -> FrameMessage | None:
        if self._closed or self._service is None or not self._service.knows_context:
            return None
        with self._lock:
            if not self._members.takes(self.robot, time.monotonic()):
                return None
            message = self._ledger.next(self._members.live)
            if message is not None:
                self._ledger.note(self._claim(message, answered=False))
        return message

    def _answer(self, message: FrameMessage) -> None:
        assert self._service is not None
        self._tell(self._claim(message, answered=False))
        done = self._claim(message, answered=True)
        with self._lock:
            sender = self._ledger.traceparent(message.id)
        try:
            with tracing.continuing(sender):
                self._service.on_keyframe(message, sent=lambda: self._tell(done))
        except Exception:  # only this keyframe is lost; the slot goes on
            log.exception("%s: keyframe %d failed", self.robot, message.id.seq)
        with self._lock:
            self._ledger.note(done)
        self._tell(done)  # again: `sent` is not called for a refused frame

    def _claim(self, message: FrameMessage, answered: bool) -> pb.Claim:
        return pb.Claim(id=message.id, instance=self._members.me, answered=answered)

    def _tell(self, claim: pb.Claim) -> None:
        try:
            self.bus.publish(CLAIM, claim)
        except HeliosError as error:
            log.warning("%s: a claim was not told: %s", self.robot, error.message)

    def _report(self, strangers: bool) -> None:
        now_s = time.monotonic()
        state, reason = report = (
            ("degraded", self._fault)
            if self._fault
            else (self._loading if self._service is None else self._health).state
        )
        if report == self._reported and now_s - self._reported_s < REPORT_S:
            return
        self._reported, self._reported_s = report, now_s
        if strangers and state == "ready":
            state, reason = (
                "degraded",
                "another detector is given another list of robots and both may answer; give all of "
                "them the same --robots",
            )
        publish_status(
            self.bus, "detector", self._members.me, (state, reason), self._health.metrics()
        )


class Fleet:
    """Detector process for several robots (see the module). `bus` is the bus of `FLEET_BUS`."""

    def __init__(self, bus: Bus, health: Health, settings: Settings) -> None:
        """Raises InvalidInput for a simulator detector, which knows only one world."""
        if settings.detector in ("simulated", "ground-truth"):
            raise InvalidInput(
                f"detector {settings.detector} knows one simulated world; start one for each "
                "robot, without --robots"
            )
        self._bus, self._health, self._settings = bus, health, settings
        me = f"{os.getpid()}-{uuid.uuid4().hex[:6]}"
        self._members = Members(me, robot_names(settings.robots))
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._slots: list[RobotSlot] = []
        self._models: Models | None = None
        self._service: DetectorService | None = None  # any slot's: all share the models
        self._threads = [
            threading.Thread(target=job, name=name, daemon=True)
            for name, job in (("load", self._load), ("watch", self._watch))
        ]
        bus.watch(self._on_alive)
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._ending.set()
        deadline = time.monotonic() + FINISH_WITHIN_S
        for slot in self._slots:
            slot.stop()
        for slot in self._slots:
            slot.finish(deadline - time.monotonic())
        if self._models is not None:
            self._models.close()

    def _on_alive(self, service: str, instance: str, alive: bool) -> None:
        if service == FLEET_TOKEN:
            with self._lock:
                self._members.change(instance, alive, time.monotonic())
            log.info("detector %s %s", instance, "is there" if alive else "is gone")

    def _load(self) -> None:
        if not ended_well("the detector cannot be started", self._health, self._start):
            for slot in self._slots:
                slot.give_up()

    def _start(self) -> None:
        for robot in self._members.robots:
            bus = self._connect(robot)
            if bus is None:
                return
            self._slots.append(RobotSlot(robot, bus, self._members, self._lock, self._health))
        s = self._settings
        models = self._models = load_models(s, None, self._health, self._ending)
        if models is None:
            return
        usage = ModelUsage()
        for slot in self._slots:
            self._service = slot.begin(models, usage)
        self._bus.announce(
            FLEET_TOKEN, self._members.me
        )  # from here on this process may own robots
        self._on_alive(FLEET_TOKEN, self._members.me, True)
        self._health.ready(f"shares {', '.join(self._members.robots)}")

    def _connect(self, robot: str) -> Bus | None:
        from helios_core.zenoh_bus import ZenohBus

        while not self._ending.is_set():
            try:
                return ZenohBus(self._settings.router_link("detector"), robot)
            except Unavailable as error:
                self._health.waiting(error.message)
                self._ending.wait(self._settings.retry_s)
        return None

    def _watch(self) -> None:
        ended_well("idle models are not unloaded any more", self._health, self._unload)

    def _unload(self) -> None:
        """Unload the models whenever they are idle."""
        unload_s = self._settings.unload_after_s
        while not self._ending.wait(TICK_S):
            if self._service is not None and unload_s > 0:
                self._service.unload_if_idle(unload_s)
