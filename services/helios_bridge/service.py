"""The bridge's shell: one driver behind the bus.

The driver is used by one thread at a time (`_turn`), except for stop. Actions come by `bridge/act`;
after each the robot looks, and the frame goes out as a keyframe. Threads of its own stream frames
while the robot stands, play a recording, and stop an action that outlives its time.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import (
    action_from_proto,
    description_to_proto,
    frame_id_from_proto,
    frame_id_to_proto,
    frame_to_proto,
    result_to_proto,
    state_to_proto,
    transform_to_proto,
)
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.robot import Action, Capture, EndOfRecording, Observe, RobotDriver
from helios_core.topics import (
    ACT,
    ANY_STATUS,
    CLEAR_STOP,
    CONTEXT,
    FRAME,
    GET_STATE,
    KEYFRAME,
    LEASE,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    STOP,
)
from helios_core.types import Frame, FrameId, RobotState

from helios_bridge.acks import AckBook
from helios_bridge.actions import ActionLog
from helios_bridge.depth import with_estimated_depth
from helios_bridge.lease import Lease
from helios_bridge.settings import Settings

log = logging.getLogger(__name__)

LONGEST_ACTION_S = 600.0
NEEDED_BY_REPLAY = frozenset({"detector", "objectmap", "map2d"})


class BridgeService:
    """See the module."""

    def __init__(
        self,
        bus: Bus,
        driver: RobotDriver,
        settings: Settings,
        health: Health,
        first_number: int | None = None,
    ) -> None:
        """`first_number`: where frame and lease numbers start; they must rise from one start of the
        bridge to the next while the robot stays up, so by default they start at the clock's."""
        first = time.time_ns() // 1_000_000 if first_number is None else first_number
        self._bus, self._driver, self._settings, self._health = bus, driver, settings, health
        self._turn = threading.Lock()  # whoever holds it uses the driver
        self._number = first
        self._number_lock = threading.Lock()
        self._own_boot_id = uuid.uuid4().hex
        self._stopped_why = ""
        self._finished = False
        self._last_keyframe = 0
        self._last_look_s = 0.0
        self._busy_until_s: float | None = None  # when the running action has outlived its time
        self._ending = threading.Event()
        self._acks, self._actions = AckBook(), ActionLog()
        self._lease = Lease(settings.lease_s, first)
        self._context_known = threading.Event()
        if settings.contexts:  # the recording brings its own
            self._context_known.set()
        self._ready_services: set[str] = set()
        self._description = driver.describe()
        self._recording = not self._description.can_move
        bus.publish(ROBOT_DESCRIPTION, description_to_proto(self._description))
        bus.subscribe(MAP2D_ACK, self._acks.add)
        bus.subscribe(OBJECTMAP_ACK, self._acks.add)
        bus.serve(ACT, self.act)
        bus.serve(LEASE, self.lease)
        bus.serve(STOP, self.stop)
        bus.serve(CLEAR_STOP, self.clear_stop)
        bus.serve(GET_STATE, lambda _: state_to_proto(self.state()))
        if self._recording and settings.autoplay:
            bus.subscribe(CONTEXT, lambda _: self._context_known.set())
            bus.subscribe(ANY_STATUS, self._note_status)
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Start streaming, playing and watching. Without it the bridge acts only when asked."""
        jobs = [("watchdog", self._watchdog)]
        if self._recording and self._settings.autoplay:
            jobs.append(("play", self._play))
        elif self._settings.stream_hz > 0:
            jobs.append(("stream", self._stream))
        for name, job in jobs:
            thread = threading.Thread(target=job, name=name, daemon=True)
            thread.start()
            self._threads.append(thread)
        self._publish_state()
        self._health.ready()

    # --- methods ------------------------------------------------------------------------------
    def lease(self, request: pb.LeaseRequest) -> pb.LeaseReply:
        if not request.holder:
            raise InvalidInput("the lease has no holder; name who drives")
        token = self._lease.grant(request.holder, request.take)
        return pb.LeaseReply(token=token, duration_s=self._lease.duration_s)

    def act(self, request: pb.ActionRequest) -> pb.ActionResult:
        if not request.action_id:
            raise InvalidInput("the action has no id; give every action one of its own")
        if not request.time_remaining_s <= LONGEST_ACTION_S:  # NaN too
            raise InvalidInput(
                f"time_remaining_s is {request.time_remaining_s}; send at most "
                f"{LONGEST_ACTION_S:g} s, after which the robot is stopped"
            )
        action = action_from_proto(request.action)
        deadline_s = time.monotonic() + request.time_remaining_s
        return self._actions.once(request.action_id, lambda: self._act(request, action, deadline_s))

    def stop(self, request: pb.StopRequest) -> pb.Empty:
        self._stopped_why = request.reason or "stop-now"
        self._driver.stop(self._stopped_why)  # not in turn: an action may be running
        log.warning("stopped: %s", self._stopped_why)
        self._health.count("stops")
        self._publish_state()
        return pb.Empty()

    def clear_stop(self, _: pb.Empty) -> pb.Empty:
        self._driver.clear_stop()
        self._stopped_why = ""
        self._publish_state()
        return pb.Empty()

    def state(self) -> RobotState:
        """The robot's state, with what the bridge knows."""
        s = self._driver.state()
        return RobotState(
            T_world_base=s.T_world_base,
            tilt_rad=s.tilt_rad,
            held=s.held,
            moving=self._busy_until_s is not None,
            stopped=s.stopped or bool(self._stopped_why),
            world_epoch=s.world_epoch,
            robot_boot_id=s.robot_boot_id or self._own_boot_id,
            message=self._stopped_why or s.message,
            finished=self._finished,
            last_seq=self._last_keyframe,
        )

    def close(self) -> None:
        self._ending.set()
        for thread in self._threads:
            thread.join(1.0)
        self._driver.close()

    # --- one action ---------------------------------------------------------------------------
    def _act(self, request: pb.ActionRequest, action: Action, deadline_s: float) -> pb.ActionResult:
        self._lease.check(request.lease_token)
        if self._stopped_why:
            raise Conflict(f"the robot is stopped ({self._stopped_why}); clear the stop first")
        with self._turn:
            if time.monotonic() >= deadline_s:
                raise DeadlineExceeded("the action's time was over before it began; send it anew")
            began = time.monotonic()
            self._busy_until_s = deadline_s
            try:
                done = self._actions.deed(
                    request.action_id, lambda: self._driver.act(action, request.action_id)
                )
            finally:
                self._busy_until_s = None
            self._health.sample("act_ms", (time.monotonic() - began) * 1e3)
            out = result_to_proto(done, request.action_id)
            try:
                id = self._look(keyframe=True)
            except EndOfRecording:
                self._finished = True
                id = None
        self._lease.renew(request.lease_token)
        if id is not None:
            out.keyframe.CopyFrom(frame_id_to_proto(id))
            out.T_world_base.CopyFrom(transform_to_proto(self._driver.state().T_world_base))
        self._publish_state()
        return out

    def _look(self, keyframe: bool) -> FrameId:
        """Capture and publish; the caller holds the turn. In lockstep, until the maps answered."""
        began = time.monotonic()
        c = self._driver.capture()
        state = self._driver.state()
        with self._number_lock:
            self._number += 1
            number = self._number
        boot = state.robot_boot_id or self._own_boot_id
        id = FrameId(boot, state.world_epoch, number)
        if c.recorded is not None:
            id = frame_id_from_proto(c.recorded.id)
        self._publish_frame(c, id, keyframe)
        self._last_look_s = time.monotonic()
        self._health.sample("capture_ms", (self._last_look_s - began) * 1e3)
        if keyframe:
            self._last_keyframe = id.seq
            self._health.count("keyframes")
            if self._settings.lockstep:
                missing = self._acks.wait(id, self._settings.ack_timeout_s)
                if missing:
                    self._health.count("unanswered_keyframes")
                    self._health.degraded(
                        f"keyframe {id} was not answered by {', '.join(sorted(missing))} "
                        f"within {self._settings.ack_timeout_s:g} s; look at these services"
                    )
                else:
                    self._health.ready()
        return id

    def _publish_frame(self, c: Capture, id: FrameId, keyframe: bool) -> None:
        topic = KEYFRAME if keyframe else FRAME
        if c.recorded is not None:  # as it was, to the last bit
            self._bus.publish(topic, c.recorded)
            return
        frame = Frame(
            id=id,
            stamp_ns=c.stamp_ns,
            keyframe=keyframe,
            color=c.color,
            depth_m=c.depth_m,
            camera=c.camera,
            T_world_cam=c.T_world_cam,
            T_world_base=c.T_world_base,
        )
        if self._settings.depth == "estimated":
            frame = with_estimated_depth(frame, self._bus, self._settings.depth_timeout_s)
        self._bus.publish(topic, frame_to_proto(frame))

    # --- threads ------------------------------------------------------------------------------
    def _stream(self) -> None:
        period_s = 1.0 / self._settings.stream_hz
        while not self._ending.wait(period_s):
            if time.monotonic() - self._last_look_s < period_s:
                continue
            if not self._turn.acquire(blocking=False):
                continue  # an action runs: its keyframe comes
            try:
                self._look(keyframe=self._last_keyframe == 0)
                self._health.ready()
            except HeliosError as error:
                self._health.waiting(f"the robot gives no image: {error.message}")
            except EndOfRecording:
                self._finished = True
                return
            finally:
                self._turn.release()
            self._publish_state()

    def _play(self) -> None:
        """A recording goes on by itself, frame by frame, once somebody is there to see it."""
        while not (self._context_known.is_set() and self._ready_services >= NEEDED_BY_REPLAY):
            missing = ", ".join(sorted(NEEDED_BY_REPLAY - self._ready_services))
            wanted = missing or "a search context"
            self._health.ready(f"the recording waits for {wanted}")
            if self._ending.wait(0.05):
                return
        self._health.ready()
        while not self._ending.is_set():
            try:
                with self._turn:
                    self._driver.act(Observe(), f"play-{self._number}")
                    self._look(keyframe=True)
            except EndOfRecording:
                break
            except HeliosError as error:
                log.error("the recording cannot go on: %s", error.message)
                self._health.degraded(error.message)
                return
            self._publish_state()
        self._finished = True
        self._publish_state()

    def _watchdog(self) -> None:
        """Commands expire: what is still moving when its time is over is stopped."""
        while not self._ending.wait(0.05):
            until = self._busy_until_s
            if until is not None and time.monotonic() > until and not self._stopped_why:
                try:
                    self.stop(pb.StopRequest(reason="an action outlived its time"))
                except Exception:  # the stop is latched here; the robot itself did not answer
                    log.exception("the robot did not take the stop")

    def _note_status(self, status: pb.ServiceStatus) -> None:
        if status.state == "ready":
            self._ready_services.add(status.service)
        else:
            self._ready_services.discard(status.service)

    def _publish_state(self) -> None:
        try:
            self._bus.publish(ROBOT_STATE, state_to_proto(self.state()))
        except HeliosError as error:
            log.warning("the robot's state could not be told: %s", error.message)
