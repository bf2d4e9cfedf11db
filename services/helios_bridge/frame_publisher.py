"""Capture and publication of frames: the driver's image gets a frame id and goes out.

In lockstep a keyframe is complete when the maps have acknowledged it.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterable

import numpy as np
from helios_core import tracing
from helios_core.bus import Bus
from helios_core.codec import frame_id_from_proto, frame_message
from helios_core.geometry import Matrix
from helios_core.keyframe_acks import KeyframeAcks, MapPart, full_names
from helios_core.robot import Capture, EndOfRecording, RobotDriver
from helios_core.topics import FRAME, KEYFRAME
from helios_core.types import Frame, FrameId, RobotState, Shown, WorldId

from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.capture_checks import check_capture
from helios_bridge.depth_estimation import with_estimated_depth
from helios_bridge.settings import Settings

SAY_WAITING_S = 3.0  # a longer wait for the maps is reported


class FramePublisher:
    """Captures, numbers and publishes frames. The caller must hold the lock on the driver."""

    def __init__(
        self,
        bus: Bus,
        driver: RobotDriver,
        settings: Settings,
        health: BridgeHealth,
        acks: KeyframeAcks,
        first_number: int,
    ) -> None:
        """first_number: frame numbers start after it."""
        self._bus, self._driver, self._settings, self._health = bus, driver, settings, health
        self._acks = acks
        self._number = first_number
        self._own_boot_id = uuid.uuid4().hex  # for robots without a boot id
        self._searching = True  # at the last capture
        self.on_keyframe: Callable[[Capture, WorldId], None] | None = None
        # Where the robot shows a held object, base frame, and its turn while it shows one
        self.show_base_m: tuple[float, float, float] | None = None
        self.shown_turn_rad: float | None = None
        self.last_keyframe = 0
        self.last_capture_s = 0.0  # monotonic
        self.finished = False  # the recording has ended

    def boot_id(self, state: RobotState) -> str:
        """Boot id of the robot, or of its bridge if the robot reports none."""
        return state.robot_boot_id or self._own_boot_id

    def capture_and_wait(self, keyframe: bool) -> FrameId:
        """Capture and publish. In lockstep, wait until the maps have acknowledged a keyframe.

        Before a search only the occupancy part acknowledges. Raises EndOfRecording and driver
        errors.
        """
        id = self.capture_and_publish(keyframe)
        if keyframe and self._settings.lockstep:
            self._wait_for_maps(id, MapPart if self._searching else {MapPart.OCCUPANCY})
        return id

    def capture_and_publish(self, keyframe: bool) -> FrameId:
        """Capture and publish. Raises like `capture_and_wait`, and InvalidInput for a bad image or
        pose."""
        if not keyframe:
            return self._capture_and_publish(keyframe)
        with tracing.span("keyframe") as recorded:
            id = self._capture_and_publish(keyframe)
            recorded.set("helios.keyframe", str(id))
            return id

    def _capture_and_publish(self, keyframe: bool) -> FrameId:
        began = time.monotonic()
        try:
            capture = self._driver.capture()
        except EndOfRecording:
            self.finished = True
            raise
        check_capture(capture)
        state = self._driver.state()
        self._number, self._searching = self._number + 1, capture.searching
        if capture.recorded is not None:
            id = frame_id_from_proto(capture.recorded.id)
        else:
            id = FrameId(self.boot_id(state), state.world_epoch, self._number)
        self._publish(capture, id, keyframe, state)
        self._health.image_came()
        self.last_capture_s = time.monotonic()
        self._health.sample("capture_ms", (self.last_capture_s - began) * 1e3)
        if keyframe:
            shows = self._shown(capture.T_world_base, state) is not None
            if self.on_keyframe is not None and capture.recorded is None and not shows:
                world = WorldId.of(id.robot_boot_id, id.world_epoch, state.origin_id)
                self.on_keyframe(capture, world)
            self.last_keyframe = id.seq
            self._health.count("keyframes")
            if not capture.searching:
                self._health.count("keyframes_before_search")
        return id

    def _publish(self, c: Capture, id: FrameId, keyframe: bool, state: RobotState) -> None:
        topic = KEYFRAME if keyframe else FRAME
        if c.recorded is not None:  # republished bit for bit
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
            held=state.held,
            origin_id=state.origin_id,
            shown=self._shown(c.T_world_base, state),
        )
        if self._settings.depth == "estimated":
            frame = with_estimated_depth(frame, self._bus, self._settings.depth_timeout_s)
        self._bus.publish(topic, frame_message(frame))

    def _shown(self, T_world_base: Matrix, state: RobotState) -> Shown | None:
        if self.show_base_m is None or self.shown_turn_rad is None or not state.held:
            return None
        x, y, z = T_world_base[:3, :3] @ np.array(self.show_base_m) + T_world_base[:3, 3]
        return Shown((float(x), float(y), float(z)), self.shown_turn_rad)

    def _wait_for_maps(self, id: FrameId, parts: Iterable[MapPart]) -> None:
        within_s = self._settings.ack_timeout_s
        names = full_names(parts)
        missing = self._acks.wait(id, names, min(within_s, SAY_WAITING_S))
        if missing and not self._acks.ended:
            self._health.ready(f"keyframe {id} waits for {', '.join(sorted(missing))}")
            missing = self._acks.wait(id, names, max(0.0, within_s - SAY_WAITING_S))
        if self._acks.ended:
            return
        if not missing:
            self._health.ready()
            return
        self._health.count("unanswered_keyframes")
        self._health.degraded(
            f"keyframe {id} was not answered by {', '.join(sorted(missing))} "
            f"within {within_s:g} s; look at these services"
        )
