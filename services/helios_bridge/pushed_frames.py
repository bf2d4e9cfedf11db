"""Pushed frames: images of an external camera, one per request, each acknowledged by the maps."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NoReturn

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import context_to_proto, frame_from_proto, frame_id_to_proto
from helios_core.codec.images import MAX_PIXELS
from helios_core.errors import Conflict, DeadlineExceeded, InvalidInput, Unavailable
from helios_core.geometry import Pinhole, base_below_camera, se2_to_se3
from helios_core.keyframe_acks import KeyframeAcks, MapPart, full_names
from helios_core.robot import Action, ActionResult, Capture, Observe, RobotDriver
from helios_core.topics import CONTEXT
from helios_core.types import RobotDescription, RobotState, Role, SearchClass, SearchContext

from helios_bridge.frame_publisher import FramePublisher
from helios_bridge.pose_checks import check_poses

DETECTOR_THRESHOLD = 0.25  # confidence from which a class that was asked for counts
LONGEST_WAIT_S = 60.0
LONGEST_TURN_S = 10.0  # longest wait of a frame for those before it
MOST_CLASSES, LONGEST_NAME = 64, 64
NOMINAL_CAMERA = Pinhole(525.0, 525.0, 319.5, 239.5, 640, 480)  # each frame brings its own


class PushDriver(RobotDriver):
    """Driver of an external camera: each frame is offered once and captured once."""

    def __init__(self, max_depth_m: float = 5.0) -> None:
        """max_depth_m: the maps use no depth beyond it."""
        self._max_depth_m = max_depth_m
        self._offered: Capture | None = None
        self._state = RobotState(se2_to_se3(0.0, 0.0, 0.0))
        self._stopped = ""

    def offer(
        self, capture: Capture, robot_boot_id: str, world_epoch: int, origin_id: str = ""
    ) -> None:
        """Set the next frame; the other arguments name the world of its poses."""
        self._offered = capture
        self._state = RobotState(
            capture.T_world_base,
            robot_boot_id=robot_boot_id,
            world_epoch=world_epoch,
            origin_id=origin_id,
        )

    def describe(self) -> RobotDescription:
        return RobotDescription(
            name="pushed frames",
            footprint_radius_m=0.3,
            height_m=1.0,
            camera=NOMINAL_CAMERA,
            camera_height_m=1.0,
            reach_m=0.0,
            max_depth_m=self._max_depth_m,
            can_move=False,
            can_pick=False,
            can_place=False,
        )

    def state(self) -> RobotState:
        return replace(self._state, stopped=bool(self._stopped), message=self._stopped)

    def capture(self) -> Capture:
        capture, self._offered = self._offered, None
        if capture is None:
            raise Unavailable("no frame has come since the last one; send one to POST /v1/frames")
        return capture

    def act(self, action: Action, action_id: str) -> ActionResult:
        if self._stopped:
            return ActionResult(False, f"stopped ({self._stopped}); clear the stop first")
        if not isinstance(action, Observe):
            what = type(action).__name__.lower()
            return ActionResult(False, f"frames come from outside, so nothing here can {what}")
        return ActionResult(True)

    def stop(self, reason: str) -> None:
        self._stopped = reason or "stop-now"

    def clear_stop(self) -> None:
        self._stopped = ""


class PushedFrameQueue:
    """Handler of `bridge/push`. It takes frames one at a time, in the order of arrival."""

    def __init__(
        self,
        bus: Bus,
        driver: PushDriver,
        publisher: FramePublisher,
        acks: KeyframeAcks,
        turn: threading.Lock,
        estimated_depth: bool,
        threshold: float = DETECTOR_THRESHOLD,
    ) -> None:
        """turn: lock on the driver. threshold: detector score from which a class counts."""
        self._bus, self._driver, self._publisher, self._acks = bus, driver, publisher, acks
        self._turn = turn
        self._estimated_depth, self._threshold = estimated_depth, threshold
        self._classes: tuple[str, ...] = ()  # of the present search, if a push began it
        self._searches, self._id_stem = 0, f"push-{uuid.uuid4().hex[:8]}-"
        self._world = ("", 0, "")
        self._sought = threading.Event()  # set once there is a search context
        bus.subscribe(CONTEXT, self._on_context)

    def push(self, request: pb.PushRequest, publish_state: Callable[[], None]) -> pb.PushReply:
        """Publish the frame as a keyframe and wait for the maps' acknowledgements.

        publish_state: called after each change of the state. Raises InvalidInput for an
        inconsistent frame, and DeadlineExceeded if the frames before it take too long.
        """
        if not 0 <= request.wait_s <= LONGEST_WAIT_S:  # NaN too
            raise InvalidInput(f"wait_s is {request.wait_s}; send 0 to {LONGEST_WAIT_S:g} seconds")
        classes = _names(request.classes)
        capture = capture_of(request.frame, self._estimated_depth)
        deadline_s = time.monotonic() + request.wait_s
        if not self._turn.acquire(timeout=LONGEST_TURN_S):
            raise DeadlineExceeded(
                f"the frames before this one took more than {LONGEST_TURN_S:g} s; send slower"
            )
        try:
            self._look_for(classes)
            id = request.frame.id
            world = (id.robot_boot_id, id.world_epoch, request.frame.origin_id)
            self._driver.offer(capture, *world)
            if world != self._world:  # the robot state tells the maps to change worlds
                self._world = world
                publish_state()
            taken = self._publisher.capture_and_publish(keyframe=True)
        finally:
            self._turn.release()
        publish_state()
        wanted = full_names(MapPart if self._sought.is_set() else {MapPart.OCCUPANCY})
        left_s = max(0.0, deadline_s - time.monotonic())
        missing = self._acks.wait(taken, wanted, left_s)
        return pb.PushReply(
            id=frame_id_to_proto(taken),
            acks={a.service + a.part: a for a in self._acks.answers(taken).values()}.values(),
            unanswered=sorted(missing),
        )

    def _look_for(self, classes: tuple[str, ...]) -> None:
        """Begin a search for these classes, unless it is the present one; none: as before."""
        if not classes or classes == self._classes:
            return
        self._searches += 1
        context = SearchContext(
            id=f"{self._id_stem}{self._searches}",
            classes=tuple(SearchClass(name, Role.WATCH, self._threshold) for name in classes),
        )
        self._classes = classes  # before it is published: another search may follow at once
        try:
            self._bus.publish(CONTEXT, context_to_proto(context))
        except BaseException:
            self._classes = ()
            raise
        self._sought.set()

    def _on_context(self, context: pb.SearchContext) -> None:
        """Note a search; one of another client replaces that of the last push."""
        self._sought.set()
        if not context.id.startswith(self._id_stem):
            self._classes = ()


def refuse_push(robot: str) -> NoReturn:
    """Refuse a pushed frame, because the robot has its own camera. Raises Conflict."""
    raise Conflict(
        f"the robot {robot!r} has a camera of its own; frames from outside are taken by "
        "`helios up --robot push`"
    )


def capture_of(frame: pb.Frame, estimated_depth: bool) -> Capture:
    """Capture from a pushed frame. `estimated_depth`: the frame needs no depth of its own.

    Raises InvalidInput for an inconsistent frame.
    """
    names = {"robot_boot_id": frame.id.robot_boot_id, "origin_id": frame.origin_id}
    for name, given in names.items():
        if len(given) > LONGEST_NAME:
            raise InvalidInput(f"{name} is longer than {LONGEST_NAME} letters; send a shorter one")
    whole = pb.Frame()
    whole.CopyFrom(frame)
    if estimated_depth and frame.WhichOneof("depth") is None:
        whole.raw_depth.CopyFrom(_no_depth(frame))
    below = not frame.HasField("T_world_base")
    if below:
        whole.T_world_base.CopyFrom(frame.T_world_cam)  # until that one is checked
    f = frame_from_proto(whole)
    T_world_base = base_below_camera(f.T_world_cam) if below else f.T_world_base
    check_poses(f.T_world_cam, T_world_base, "the frame's")
    return Capture(f.stamp_ns, f.color, f.depth_m, f.camera, f.T_world_cam, T_world_base)


def _no_depth(frame: pb.Frame) -> RawImage:
    """Depth image without valid depth, in the calibrated size."""
    width, height = frame.calibration.width, frame.calibration.height
    if width * height > MAX_PIXELS:
        raise InvalidInput(f"the calibration is of {width}x{height} pixels; send a smaller image")
    data = bytes(2 * width * height)
    return RawImage(width=width, height=height, encoding="16UC1", step=2 * width, data=data)


def _names(classes: Sequence[str]) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(" ".join(name.split()) for name in classes))
    if len(names) > MOST_CLASSES:
        raise InvalidInput(f"{len(names)} classes came; send at most {MOST_CLASSES}")
    for name in names:
        if not 0 < len(name) <= LONGEST_NAME:
            shown = f"{name[:LONGEST_NAME]}…" if name else name
            raise InvalidInput(
                f"one of the classes is called {shown!r}, which has {len(name)} letters; send "
                f"names of 1 to {LONGEST_NAME}"
            )
    return names
