"""The detector's shell for one robot: frame in, detections and scores out.

Every keyframe is answered with an Observation, or counted with the reason why it cannot be.
Stream frames become previews; one that comes while another frame is worked on is skipped.
A keyframe that comes before the search context is held (the newest one) and answered when it is
known. No lock is held while a back end works or the bus is used.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import cv2
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import context_from_proto, frame_from_proto, observation_to_proto
from helios_core.codec.frames import detection_to_proto
from helios_core.errors import HeliosError, Internal, InvalidInput
from helios_core.health import Health
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, OBSERVATION, PREVIEW
from helios_core.types import Frame, Observation, SearchContext

from helios_detector.analysis import Analyst
from helios_detector.backend import DepthBackend, DetectorBackend, Findings, ScorerBackend
from helios_detector.memory import resident_mb
from helios_detector.methods import Methods
from helios_detector.models import Models
from helios_detector.workload import Workload

log = logging.getLogger(__name__)


def typed(error: Exception) -> HeliosError:
    """The error itself, or what stands for one that nobody foresaw; that one is logged."""
    if isinstance(error, HeliosError):
        return error
    log.error("unforeseen", exc_info=error)
    return Internal(f"{type(error).__name__}: {error}; see the detector's log")


class DetectorService:
    """One detector and one scorer behind the bus. The back ends must be warm."""

    def __init__(
        self,
        bus: Bus,
        detector: DetectorBackend,
        scorer: ScorerBackend,
        health: Health,
        preview_quality: int = 80,
        depth: DepthBackend | None = None,
        *,
        workload: Workload | None = None,  # of models that others use too
        listen: bool = True,  # False: somebody else calls `on_…` and opens the methods
    ) -> None:
        self._bus, self._health = bus, health
        self._models = Models(detector, scorer, depth)
        self._analyst = Analyst(self._models, health)
        self._workload = workload or Workload()
        self.methods = Methods(bus, self._analyst, self._workload, health)
        self._preview_quality = preview_quality
        self._lock = threading.Lock()  # guards the four below
        self._context: SearchContext | None = None
        self._refused: dict[str, str] = {}
        self._held: pb.Frame | None = None
        self._trouble = ""  # why the last keyframe or context came to nothing
        if listen:
            bus.subscribe(KEYFRAME, self.on_keyframe)
            bus.subscribe(FRAME, self.on_frame)
            self.methods.open()
            bus.subscribe(CONTEXT, self.on_context)
        self._tell_health()  # ready: it listens

    @property
    def knows_context(self) -> bool:
        """Whether a keyframe would be answered now."""
        with self._lock:
            return self._context is not None

    def close(self) -> None:
        self._models.close()

    def unload_if_idle(self, after_s: float) -> None:
        """Free the models' memory when nothing was asked of them for that long."""
        if not self._workload.claim_idle(after_s):
            return
        self._models.unload()
        self._health.count("unloads")
        self._health.set("memory_mb", resident_mb())
        log.info("models unloaded after %g s without work; the next frame loads them", after_s)

    # --- what comes in ------------------------------------------------------------------------
    def on_context(self, message: pb.SearchContext) -> None:
        """What is sought from now on. Classes that cannot be found are said, the others sought."""
        try:
            context = context_from_proto(message)
            refused = dict(self._models.detector.refused(context))
        except Exception as error:
            fault = typed(error)
            self._health.count("contexts_refused")
            log.warning("search context %.100s refused: %s", message.id, fault.message)
            if not isinstance(fault, InvalidInput):  # the message is good, the back end is not
                self._say_trouble(f"search context {message.id} is not sought: {fault.message}")
            return
        findable = tuple(c for c in context.classes if c.name not in refused)
        with self._lock:
            self._context, self._refused = replace(context, classes=findable), refused
            held, self._held = self._held, None
        for reason in refused.values():
            log.warning("search context %s: %s", context.id, reason)
        self._tell_health()
        if held is not None:
            self.on_keyframe(held)

    def on_keyframe(self, message: pb.Frame, sent: Callable[[], None] = lambda: None) -> None:
        """Answer with an Observation; hold the frame while no context is known.

        `sent` is called when the Observation is out, before anything else is done.
        """
        with self._lock:
            context = self._context
            if context is None:
                if self._held is not None:
                    self._health.count("keyframes_replaced")
                self._held = message
                return
        trouble = ""
        try:
            with self._workload.work():
                self._answer(message, context, sent)
        except InvalidInput as error:
            self._refuse("keyframes_refused", message, error)
        except Exception as error:
            fault = typed(error)
            self._refuse("keyframes_failed", message, fault)
            trouble = f"the last keyframe could not be answered: {fault.message}"
        finally:
            self._say_trouble(trouble)

    def on_frame(self, message: pb.Frame) -> None:
        """Publish a preview, unless another frame is being worked on."""
        with self._lock:
            context = self._context
        with self._workload.work_if_free() as free:
            if not free:
                self._health.count("previews_skipped")
                return
            began = time.perf_counter()
            try:
                frame = frame_from_proto(message)
                findings = self._analyst.detect(frame, context) if context else Findings((), ())
                self._publish_preview(message, frame, findings)
                self._analyst.timed("preview", began)
            except Exception as error:
                self._refuse("previews_refused", message, typed(error))

    # --- what goes out ------------------------------------------------------------------------
    def _answer(self, message: pb.Frame, context: SearchContext, sent: Callable[[], None]) -> None:
        began = time.perf_counter()
        frame = frame_from_proto(message)
        findings = self._analyst.detect(frame, context)
        detect_ms = self._analyst.timed("detect", began)
        began = time.perf_counter()
        judged = self._analyst.judge(frame, findings, context)
        models = self._models
        out = observation_to_proto(
            Observation(
                frame, context.id, findings.detections, judged.scores,
                models.detector.name, models.scorer.name, judged.image,
            ),
            message,
        )  # fmt: skip
        out.detect_ms = detect_ms
        self._analyst.timed("score", began)
        self._analyst.measure()
        self._health.count("keyframes_answered")
        self._bus.publish(OBSERVATION, out)
        sent()
        self._publish_preview(message, frame, findings)

    def _publish_preview(self, message: pb.Frame, frame: Frame, findings: Findings) -> None:
        bgr = cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR)
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._preview_quality]
        good, jpeg = cv2.imencode(".jpg", bgr, quality)
        if not good:
            raise InvalidInput(f"the colour image of frame {frame.id} cannot be made a JPEG")
        boxes = [detection_to_proto(d, with_mask=False) for d in findings.detections]
        self._health.count("previews")
        self._bus.publish(PREVIEW, pb.Preview(id=message.id, jpeg=jpeg.tobytes(), detections=boxes))

    def _refuse(self, counter: str, message: pb.Frame, error: HeliosError) -> None:
        self._health.count(counter)
        log.warning("%s: frame %d: %s", counter, message.id.seq, error.message)

    def _say_trouble(self, trouble: str) -> None:
        with self._lock:
            self._trouble = trouble
        self._tell_health()

    def _tell_health(self) -> None:
        with self._lock:
            trouble, refused, known = self._trouble, dict(self._refused), self._context is not None
        if trouble:
            self._health.degraded(trouble)
        elif refused:
            self._health.degraded("; ".join(refused.values()))
        else:
            note = "" if known else "waits for a search context; the newest keyframe is held"
            self._health.ready(note)
