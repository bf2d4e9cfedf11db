"""Bridge service: one driver on the bus.

One thread at a time uses the driver (`_turn`), except for stop. Actions come by `bridge/act`. After
each action the bridge captures a keyframe and publishes it (`frame_publisher`). Separate threads
(`driver_executor`) stream frames while the robot stands, play a recording (`recording_player`), and
stop an action that exceeds its time (`robot_stop`). With the driver `push`, frames come by
`bridge/push` (`pushed_frames`).
"""

from __future__ import annotations

import logging
import threading
import time

from helios_core import proto as pb
from helios_core import tracing
from helios_core.bus import Bus, arrival_s
from helios_core.codec import (
    action_from_proto,
    description_from_proto,
    description_to_proto,
    frame_id_to_proto,
    result_to_proto,
    state_to_proto,
    transform_to_proto,
)
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.heartbeat import HeartbeatMonitor
from helios_core.keyframe_acks import FROM_DETECTIONS, KeyframeAcks, full_name_of, full_names
from helios_core.log_rate_limit import LogRateLimit
from helios_core.robot import (
    Action,
    ActionResult,
    EndOfRecording,
    Observe,
    RobotDriver,
    Show,
    Tilt,
    Turn,
)
from helios_core.topics import (
    ACT,
    CONTEXT,
    DETECTOR_ACK,
    GET_STATE,
    LEASE,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    PLANNER_HEARTBEAT,
    PUSH,
    ROBOT_CHECKS,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
)
from helios_core.types import FrameId, RobotState

from helios_bridge.action_limits import check_limits
from helios_bridge.action_log import ActionLog
from helios_bridge.driver_executor import DriverExecutor
from helios_bridge.driver_guard import DriverFault
from helios_bridge.frame_publisher import FramePublisher
from helios_bridge.lease import Lease
from helios_bridge.pushed_frames import PushDriver, PushedFrameQueue, refuse_push
from helios_bridge.recording_player import RecordingPlayer
from helios_bridge.robot_stop import UNCONFIRMED
from helios_bridge.settings import Settings
from helios_bridge.setup_monitor import SetupMonitor
from helios_bridge.stop_service import StopService

log = logging.getLogger(__name__)

LONGEST_ACTION_S = 600.0
LONGEST_ID = 200
END_WITHIN_S = 0.3  # wait for running jobs when the bridge ends
CLOSE_WITHIN_S = 1.2  # wait for the driver's close after that; a process has 2 s in all
STOP_AGAIN_S = 0.5  # period at which the stop of a robot that has not confirmed it is repeated
CANNOT_SHOW = "this robot cannot show a held object: its description has no show_base_m"
LOOK_WITHIN_S = 2.0  # wait of a check for the robot
NOT_CHECKED = (
    "the bridge does not check the set-up of this robot: it plays a recording, its depth is "
    "estimated, or the setting checks is off"
)


def close_driver(driver: RobotDriver, executor: DriverExecutor) -> list[str]:
    """Close a driver in a thread of its own. Returns the names of the executor's threads that hang
    after CLOSE_WITHIN_S."""
    letting_go = executor.begin("close", driver.close)
    hanging = executor.wait(CLOSE_WITHIN_S)
    if letting_go.done() and (error := letting_go.exception()) is not None:
        log.error("the driver could not let go of the robot: %s", error)
    return hanging


class BridgeService:
    """Bus interface to one driver: see the module."""

    def __init__(
        self,
        bus: Bus,
        driver: RobotDriver,
        settings: Settings,
        health: Health,
        first_number: int | None = None,
        stops: StopService | None = None,
    ) -> None:
        """first_number: start of the frame and lease numbers; default: the clock, in ms.

        The numbers must rise from one start of the bridge to the next while the robot stays up.
        stops: stop of this driver, if it is served already. Raises InvalidInput for an impossible
        robot description.
        """
        first = time.time_ns() // 1_000_000 if first_number is None else first_number
        self._bus, self._settings = bus, settings
        stops = stops or StopService(bus, driver, settings, health, DriverExecutor())
        self._health, self._driver, self._executor = stops.health, stops.driver, stops.executor
        self._stopping = stops.robot_stop
        self._turn = threading.Lock()  # lock on the driver
        self._busy_until_s: float | None = None  # deadline of the running action
        self._state_lock = threading.RLock()
        self._states_begun = self._state_out = 0  # number of the newest state; of the last one out
        self._ending = threading.Event()
        self._acks, self._actions = KeyframeAcks(full_name_of), ActionLog()
        self._seldom = LogRateLimit(log)
        self._lease = Lease(settings.lease_s, first)
        description = description_to_proto(self._driver.describe())
        self._description = description_from_proto(description)  # validated like in every service
        self._heartbeats = HeartbeatMonitor(
            bus, PLANNER_HEARTBEAT, settings.heartbeat_s, self._stopping.halt
        )
        self._publisher = FramePublisher(
            bus, self._driver, settings, self._health, self._acks, first
        )
        self._publisher.show_base_m = self._description.show_base_m
        self._setup = self._new_setup_monitor()
        self._push_queue = self._new_push_queue(driver)
        self._player = self._new_player()
        bus.publish(ROBOT_DESCRIPTION, description)
        self._stopping.on_change = self._publish_state
        self._serve()

    def _serve(self) -> None:
        """Subscribe to acknowledgements and serve the methods."""
        bus = self._bus
        bus.subscribe(DETECTOR_ACK, self._on_detector_ack)
        bus.subscribe(MAP2D_ACK, self._acks.add)
        bus.subscribe(OBJECTMAP_ACK, self._acks.add)
        bus.serve(ACT, self.act)
        bus.serve(LEASE, self.lease)
        bus.serve(PUSH, self.push)
        bus.serve(ROBOT_CHECKS, self.checks)
        bus.serve(GET_STATE, lambda _: state_to_proto(self.state()))

    def start(self) -> None:
        """Start the threads: watchdog, and stream or playback. Without them, only requests act."""
        self._executor.start("watchdog", self._watchdog)
        player = self._player
        if player is not None:
            self._executor.start("play", lambda: player.run(self._ending, self._publish_state))
        elif self._push_queue is None and self._settings.stream_hz > 0:
            self._executor.start("stream", self._stream)
        if (setup := self._setup) is not None:
            self._executor.start("checks of the set-up", lambda: setup.run(self._ending))
        if self._stopping.why:
            log.warning("stopped since before the start: %s", self._stopping.why)
            self._stopping.repeat()
        else:
            self._executor.begin(
                "clear an old halt", lambda: self._stopping.clear_old_halt(self._ending)
            )
        self._publish_state()
        self._health.ready("waits for frames: POST /v1/frames" if self._push_queue else "")

    # --- methods ------------------------------------------------------------------------------
    def lease(self, request: pb.LeaseRequest) -> pb.LeaseReply:
        if request.release_token:
            self._lease.release(request.release_token)
            return pb.LeaseReply()
        if not request.holder:
            raise InvalidInput("the lease has no holder; name who drives")
        token = self._lease.grant(request.holder, request.take)
        return pb.LeaseReply(token=token, duration_s=self._lease.duration_s)

    def act(self, request: pb.ActionRequest) -> pb.ActionResult:
        if not request.action_id:
            raise InvalidInput("the action has no id; give every action one of its own")
        if len(request.action_id) > LONGEST_ID:  # the log keeps many ids
            raise InvalidInput(
                f"the action's id has {len(request.action_id)} letters; send at most {LONGEST_ID}"
            )
        if not request.time_remaining_s <= LONGEST_ACTION_S:  # NaN too
            raise InvalidInput(
                f"time_remaining_s is {request.time_remaining_s}; send at most "
                f"{LONGEST_ACTION_S:g} s, after which the robot is stopped"
            )
        action = action_from_proto(request.action)
        check_limits(action, self._description)
        deadline_s = arrival_s() + request.time_remaining_s
        return self._actions.once(request.action_id, lambda: self._act(request, action, deadline_s))

    def push(self, request: pb.PushRequest) -> pb.PushReply:
        if self._push_queue is None:
            refuse_push(self._description.name)
        reply = self._push_queue.push(request, self._publish_state)
        self._health.ready()
        return reply

    def checks(self, request: pb.RobotChecksRequest) -> pb.RobotChecksReply:
        """Results of the checks of the set-up. A restart takes one image where the robot stands.

        Raises Conflict if the checks are off, and the errors of a capture.
        """
        setup = self._setup
        if setup is None:
            raise Conflict(NOT_CHECKED)
        if request.restart:
            setup.restart()
            if self._description.can_move:
                self._look_now()
        return setup.results()

    def state(self) -> RobotState:
        """Robot state from the driver, completed by the bridge.

        `stopped` is true only if the robot has confirmed its stop.
        """
        s = self._driver.state()
        why = self._stopping.why
        stopped = s.stopped or bool(why and self._stopping.confirmed)
        return RobotState(
            T_world_base=s.T_world_base,
            tilt_rad=s.tilt_rad,
            held=s.held,
            moving=self._busy_until_s is not None,
            stopped=stopped,
            world_epoch=s.world_epoch,
            robot_boot_id=self._publisher.boot_id(s),
            message=f"{why}; {UNCONFIRMED}" if why and not stopped else why or s.message,
            finished=self._publisher.finished,
            last_seq=self._publisher.last_keyframe,
            last_action_id=self._actions.last_id,
            origin_id=s.origin_id,
            battery=s.battery,
        )

    def close(self) -> list[str]:
        """End the running jobs and close the driver. Returns the names of hanging threads."""
        self._ending.set()
        self._acks.end()
        self._executor.wait(END_WITHIN_S)
        return close_driver(self._driver, self._executor)

    def _new_push_queue(self, driver: RobotDriver) -> PushedFrameQueue | None:
        """Queue of pushed frames; None for a driver with its own camera."""
        if not isinstance(driver, PushDriver):
            return None
        estimated = self._settings.depth == "estimated"
        return PushedFrameQueue(
            self._bus, driver, self._publisher, self._acks, self._turn, estimated
        )

    def _new_player(self) -> RecordingPlayer | None:
        """Player of a recording; None for a robot that moves, or that gets its frames pushed."""
        s = self._settings
        if self._push_queue is not None or self._description.can_move or not s.autoplay:
            return None
        return RecordingPlayer(
            self._bus,
            self._driver,
            self._publisher,
            self._turn,
            self._health,
            s.contexts,
            s.strict,
        )

    def _new_setup_monitor(self) -> SetupMonitor | None:
        """Monitor of the robot's set-up; None if there is nothing to check."""
        s = self._settings
        if not s.checks or s.depth != "sensor" or self._description.recorded:
            return None
        setup = SetupMonitor(self._description, self._health)
        self._publisher.on_keyframe = setup.add
        self._bus.subscribe(CONTEXT, lambda context: setup.search(context.id))
        return setup

    def _look_now(self) -> None:
        """Take a keyframe, unless an action runs."""
        if self._turn.acquire(timeout=LOOK_WITHIN_S):
            try:
                self._publisher.capture_and_publish(keyframe=True)
            except EndOfRecording:
                pass
            finally:
                self._turn.release()

    def _on_detector_ack(self, ack: pb.Ack) -> None:
        """Count a refusal by the detector also for the map parts that need detections."""
        if not ack.accepted:
            self._acks.add_for(ack, full_names(FROM_DETECTIONS))

    # --- one action ---------------------------------------------------------------------------
    def _act(self, request: pb.ActionRequest, action: Action, deadline_s: float) -> pb.ActionResult:
        stops = self._stopping.stops
        self._lease.check(request.lease_token)
        self._stopping.check()
        left_s = deadline_s - time.monotonic()
        if left_s <= 0 or not self._turn.acquire(timeout=left_s):
            raise DeadlineExceeded("the action's time was over before it began; send it again")
        try:
            self._lease.check(request.lease_token)  # it may have changed meanwhile
            began = time.monotonic()
            with self._stopping.acting(stops):
                self._busy_until_s = deadline_s
                try:
                    with self._heartbeats.watching(request.action_id, request.beats):
                        done = self._robot_acts(action, request.action_id)
                finally:
                    self._busy_until_s = None
            self._health.count("actions")
            self._health.sample("act_ms", (time.monotonic() - began) * 1e3)
            self._publish_state()  # publish the held object before the image that shows it
            out = result_to_proto(done, request.action_id)
            id = self._look_after(request)
        finally:
            self._turn.release()
        self._lease.renew(request.lease_token)
        if id is not None:
            out.keyframe.CopyFrom(frame_id_to_proto(id))
        if id is not None or request.no_keyframe:
            out.T_world_base.CopyFrom(transform_to_proto(self._driver.state().T_world_base))
        self._publish_state()
        return out

    def _robot_acts(self, action: Action, action_id: str) -> ActionResult:
        with tracing.span("robot acts", action=type(action).__name__.lower()):
            return self._actions.robot_result(
                action_id, lambda: self._driver_act(action, action_id)
            )

    def _driver_act(self, action: Action, action_id: str) -> ActionResult:
        """Result of the driver's action. Notes whether the robot shows a held object."""
        publisher = self._publisher
        if isinstance(action, Show) and publisher.show_base_m is None:
            return ActionResult(False, CANNOT_SHOW, steps=0)
        if not isinstance(action, Show | Tilt | Observe):
            publisher.shown_turn_rad = None
        result = self._watched_act(action, action_id)
        if isinstance(action, Show) and result.succeeded:
            publisher.shown_turn_rad = action.angle_rad
        return result

    def _watched_act(self, action: Action, action_id: str) -> ActionResult:
        """Result of the driver's action; the checks of `helios doctor` get images of a turn."""
        setup = self._setup
        hz = setup.watch_hz() if setup is not None and isinstance(action, Turn) else 0.0
        if setup is None or hz == 0.0:
            return self._driver.act(action, action_id)
        result, seen = self._driver.act_and_watch(action, action_id, hz)
        setup.add_watched(seen)
        return result

    def _look_after(self, request: pb.ActionRequest) -> FrameId | None:
        """Capture after an action. Returns the id of the keyframe; None without one.

        Without a keyframe, the frame stream continues at its rate.
        """
        try:
            if not request.no_keyframe:
                return self._publisher.capture_and_wait(keyframe=True)
            rate = self._settings.stream_hz
            if rate > 0 and time.monotonic() - self._publisher.last_capture_s >= 1.0 / rate:
                self._publisher.capture_and_wait(keyframe=False)
        except EndOfRecording:
            pass
        return None

    # --- threads ------------------------------------------------------------------------------
    def _stream(self) -> None:
        period_s = 1.0 / self._settings.stream_hz
        while not self._ending.wait(period_s):
            if time.monotonic() - self._publisher.last_capture_s < period_s:
                continue
            if not self._turn.acquire(blocking=False):
                continue  # an action runs; its keyframe follows
            try:
                self._publisher.capture_and_wait(keyframe=self._publisher.last_keyframe == 0)
            except EndOfRecording:
                return
            except HeliosError as error:
                self._health.no_image("waiting", f"the robot gives no image: {error.message}")
            except Exception as error:  # an internal error: the next frame may succeed
                self._seldom.warn("frame", "a frame could not be made", error)
                said = f"the bridge failed ({type(error).__name__}: {error})"
                self._health.no_image("degraded", said)
            finally:
                self._turn.release()
            self._publish_state()

    def _watchdog(self) -> None:
        """Stop the robot if an action still runs at its deadline, and repeat a stop until the robot
        confirms it."""
        again_s = time.monotonic() + STOP_AGAIN_S
        while not self._ending.wait(0.05):
            if time.monotonic() >= again_s:
                again_s = time.monotonic() + STOP_AGAIN_S
                self._stopping.repeat()
            until = self._busy_until_s
            if until is not None and time.monotonic() > until and not self._stopping.why:
                try:
                    self._stopping.stop("an action outlived its time")
                except Exception:  # the bridge is stopped; only the robot did not answer
                    log.exception("the robot did not take the stop")

    def _publish_state(self) -> None:
        """Publish the state, unless one that was asked for later is out already."""
        with self._state_lock:
            self._states_begun += 1
            number = self._states_begun
        try:
            state = state_to_proto(self.state())
            with self._state_lock:
                if number > self._state_out:
                    self._state_out = number
                    self._bus.publish(ROBOT_STATE, state)
        except DriverFault:
            pass  # reported in the health until the driver's state works again
        except HeliosError as error:
            said = f"the robot's state could not be told: {error.message}"
            self._seldom.warn(type(error), said)
