"""Acknowledgements of the services for each frame of a replay."""

from __future__ import annotations

import itertools
import statistics
import threading
import time
from collections import Counter
from collections.abc import Iterable

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.keyframe_acks import FROM_DETECTIONS, MapPart
from helios_core.topics import DETECTOR_ACK, MAP2D_ACK, OBJECTMAP_ACK, ROBOT_STATE


class FrameAcks:
    """Acknowledgements per frame, received from the bus, and their statistics. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._state_came = threading.Condition(self._lock)
        self._parts: dict[tuple[str, int, int], set[str]] = {}
        self._update_ms: dict[str, list[float]] = {part: [] for part in MapPart}
        self._done_s: list[float] = []
        self._refusals: Counter[str] = Counter()
        self._finished = False

    def listen(self, bus: Bus) -> None:
        """Subscribe to the detector, the maps and the bridge."""
        bus.subscribe(DETECTOR_ACK, self.note_detector)
        bus.subscribe(MAP2D_ACK, self.note_ack)
        bus.subscribe(OBJECTMAP_ACK, self.note_ack)
        bus.subscribe(ROBOT_STATE, self.note_state)

    def note_ack(self, ack: pb.Ack) -> None:
        """Note the acknowledgement of a map."""
        with self._lock:
            if ack.accepted:
                self._update_ms.setdefault(ack.part, []).append(ack.update_ms)
            self._note(ack, [ack.part])

    def note_detector(self, ack: pb.Ack) -> None:
        """Note the detector's acknowledgement. If it sends no observation, the maps that need one
        cannot answer, and the frame counts as answered for them."""
        with self._lock:
            if not ack.accepted:
                self._note(ack, FROM_DETECTIONS)

    def _note(self, ack: pb.Ack, answered: Iterable[str]) -> None:
        """The caller holds the lock."""
        frame = (ack.id.robot_boot_id, ack.id.world_epoch, ack.id.seq)
        parts = self._parts.setdefault(frame, set())
        whole_before = len(parts) == len(MapPart)
        parts.update(answered)
        if not ack.accepted:
            self._refusals[f"{ack.service}: {ack.reason}"] += 1
        if len(parts) == len(MapPart) and not whole_before:
            self._done_s.append(time.monotonic())

    def note_state(self, state: pb.RobotState) -> None:
        """Note the robot state from the bridge."""
        with self._lock:
            self._finished = state.finished
            self._state_came.notify_all()

    @property
    def finished(self) -> bool:
        """True once the recording has ended."""
        with self._lock:
            return self._finished

    def wait_finished(self, timeout_s: float) -> bool:
        """Wait for the end of the recording; True if it came within the timeout."""
        with self._state_came:
            return self._state_came.wait_for(lambda: self._finished, timeout_s)

    @property
    def frames(self) -> int:
        """Number of frames that all maps have answered."""
        with self._lock:
            return len(self._done_s)

    @property
    def occupancy_frames(self) -> int:
        """Number of frames that the occupancy map has answered: at the end, all frames played."""
        with self._lock:
            return sum(MapPart.OCCUPANCY in parts for parts in self._parts.values())

    @property
    def finished_frames(self) -> int:
        """Number of frames that are finished: all maps have answered, or a later frame has
        begun."""
        with self._lock:
            *earlier, last = self._parts.values() or [set()]
            return len(earlier) + (len(last) == len(MapPart))

    @property
    def pace_ms(self) -> float:
        """Median time (ms) from one finished frame to the next."""
        with self._lock:
            times_s = list(self._done_s)
        steps_ms = [(b - a) * 1e3 for a, b in itertools.pairwise(times_s)]
        return statistics.median(steps_ms) if steps_ms else 0.0

    @property
    def refusals(self) -> dict[str, int]:
        """Reason for refusing a frame -> number of times."""
        with self._lock:
            return dict(self._refusals)

    def median_ms(self) -> dict[str, float]:
        """Map part -> median time (ms) of its update."""
        with self._lock:
            return {part: statistics.median(ms) for part, ms in self._update_ms.items() if ms}
