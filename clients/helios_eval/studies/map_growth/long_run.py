"""Hours of frames through the object map's own process, as fast as it accepts them.

The robot walks through a few places in turn. On each return all objects there have moved by up to
half a metre, and every other time the place is furnished as another home, so most of the map is out
of date. Every walk has its own task. The map's file is saved as under `helios up`.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import context_to_proto, observation_to_proto
from helios_core.errors import DeadlineExceeded, Unavailable
from helios_core.topics import CONTEXT, OBJECTMAP_ACK, OBJECTS, OBSERVATION
from helios_core.types import Observation

from helios_eval.service_under_test import ServiceProcess
from helios_eval.studies.map_growth.simulated_walk import Walk, context_of
from helios_eval.studies.map_growth.update_cost import SPACING_M

ANSWER_WITHIN_S = 300.0
PLACES = 4
MOVED_M = 0.5
RECEPTACLES, THINGS = 4, 4  # classes per task
STEADY = 0.05  # growth of memory from the third quarter to the last that counts as none
MB = 1e6


@dataclass(frozen=True)
class Sample:
    """State of the process after a number of frames."""

    frame: int
    rss_mb: float
    gaussians: int
    objects: int


@dataclass(frozen=True)
class LongRunResult:
    """Result of a run."""

    every_s: float  # robot time between frames
    samples: tuple[Sample, ...]

    def growth(self) -> float:
        """Relative growth of the mean memory from the third quarter to the last."""
        rss = np.array([s.rss_mb for s in self.samples])
        quarter = max(1, len(rss) // 4)
        return float(rss[-quarter:].mean() / rss[-2 * quarter : -quarter].mean() - 1)

    @property
    def is_steady(self) -> bool:
        return self.growth() <= STEADY

    def summary(self) -> dict[str, object]:
        """Values for the report."""
        last = self.samples[-1]
        return {
            "frames": last.frame,
            "robot_hours": round(last.frame * self.every_s / 3600, 2),
            "gaussians_at_the_end": last.gaussians,
            "objects_at_the_end": last.objects,
            "rss_mb_at_the_end": round(last.rss_mb, 1),
            "rss_mb_highest": round(max(s.rss_mb for s in self.samples), 1),
            "growth_in_the_last_quarter": round(self.growth(), 4),
            "steady": self.is_steady,
        }


def measure(
    walks: Sequence[Walk],
    frames: int,
    every_s: float,
    max_gaussians: int | None = None,
    say: Callable[[str], object] = print,
) -> LongRunResult:
    """Run the frames through a new process.

    Raises HeliosError if the service refuses a frame or does not reply.
    """
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["--stride-px", "1", "--state-dir", f"{folder}/state"]
        if max_gaussians is not None:
            arguments += ["--max-gaussians", str(max_gaussians)]
        process = ServiceProcess("objectmap", tuple(arguments), Path(folder))
        bus = None
        try:
            bus = process.bus()
            robot = _Robot(bus, psutil.Process(process.ready(bus)))
            return LongRunResult(every_s, robot.live(walks, frames, every_s, say))
        finally:
            if bus is not None:
                bus.close()
            process.close()


class _Robot:
    """Sender of frames that waits for each acknowledgement."""

    def __init__(self, bus: Bus, service: psutil.Process) -> None:
        self._bus, self._service = bus, service
        self._answered, self._ack = threading.Event(), pb.Ack()
        bus.subscribe(OBJECTMAP_ACK, self._on_ack)

    def live(
        self,
        walks: Sequence[Walk],
        frames: int,
        every_s: float,
        say: Callable[[str], object],
    ) -> tuple[Sample, ...]:
        samples: list[Sample] = []
        every, lap, seq = max(1, frames // 200), 0, 0
        while seq < frames:
            walk, rng = walks[lap // PLACES % len(walks)], np.random.default_rng(lap)
            x_m = lap % PLACES * SPACING_M + rng.uniform(-MOVED_M, MOVED_M)
            context = context_of(
                f"task {lap}",
                rng.choice(walk.receptacles, RECEPTACLES, replace=False).tolist(),
                rng.choice(walk.things, THINGS, replace=False).tolist(),
            )
            self._bus.publish(CONTEXT, context_to_proto(context))
            for observation in walk.again(x_m, seq, context.id):
                self._send(observation)
                seq += 1
                if seq % every == 0 or seq == frames:
                    samples.append(self._sample(seq))
                if seq == frames:
                    break
            now = samples[-1] if samples else self._sample(seq)
            hours = seq * every_s / 3600
            say(f"{hours:.2f} h, {seq} frames: {now.gaussians} Gaussians, {now.rss_mb:.0f} MB")
            lap += 1
        return tuple(samples)

    def _send(self, observation: Observation) -> None:
        self._answered.clear()
        self._bus.publish(OBSERVATION, observation_to_proto(observation))
        if not self._answered.wait(ANSWER_WITHIN_S):
            raise DeadlineExceeded(f"frame {observation.frame.id.seq} was not answered")
        if not self._ack.accepted:
            raise Unavailable(f"frame {observation.frame.id.seq} refused: {self._ack.reason}")

    def _sample(self, frame: int) -> Sample:
        reply = self._bus.call(OBJECTS, pb.ObjectsRequest(), ANSWER_WITHIN_S)
        rss_mb = self._service.memory_info().rss / MB
        return Sample(frame, rss_mb, reply.gaussians, len(reply.objects))

    def _on_ack(self, ack: pb.Ack) -> None:
        self._ack = ack
        self._answered.set()
