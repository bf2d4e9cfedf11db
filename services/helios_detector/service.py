"""The detector's bus interface for one robot: frames in, detections and scores out.

The service answers each keyframe with an Observation or counts the failure. It then acknowledges
the keyframe (`DETECTOR_ACK`), with the reason of a failure. Stream frames become previews; one that
arrives while another frame is in work is skipped. Before the first search context the service holds
the newest keyframe and answers it when the context arrives. It keeps a context that the back end
cannot take and retries it (`retry_context`); the old context stays active meanwhile. No lock is
held while a back end works or the bus is used.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
from helios_core import proto as pb
from helios_core import tracing
from helios_core.bus import Bus
from helios_core.codec import (
    context_from_proto,
    frame_from_proto,
    frame_id_from_proto,
    observation_message,
)
from helios_core.codec.frames import detection_to_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.image_messages import FrameMessage, ImageMessage, apart, kept
from helios_core.log_rate_limit import LogRateLimit
from helios_core.name_rules import plain
from helios_core.topics import CONTEXT, DETECTOR_ACK, FRAME, KEYFRAME, OBSERVATION, PREVIEW
from helios_core.types import Detection, Frame, Observation, SearchContext

from helios_detector.backend import DepthBackend, DetectorBackend, Findings, ScorerBackend
from helios_detector.exception_guard import typed
from helios_detector.frame_analysis import FrameAnalyzer
from helios_detector.memory_usage import resident_mb
from helios_detector.model_set import Models
from helios_detector.model_usage import ModelUsage
from helios_detector.query_methods import QueryMethods

log = logging.getLogger(__name__)

PREVIEW_QUALITY = 80  # JPEG, percent
CONTEXT_RETRY_S = 2.0  # pause before a context that the back end could not take is retried


def by_class(
    detections: Sequence[Detection], context: SearchContext | None
) -> tuple[tuple[Detection, ...], tuple[Detection, ...]]:
    """(detections of the context's classes, those under its other names)."""
    asked = {c.name for c in context.classes} if context is not None else set[str]()
    mine = tuple(d for d in detections if d.class_name in asked)
    return mine, tuple(d for d in detections if d.class_name not in asked)


class DetectorService:
    """One detector and one scorer on the bus. The back ends must be warm."""

    def __init__(
        self,
        bus: Bus,
        detector: DetectorBackend,
        scorer: ScorerBackend,
        health: Health,
        depth: DepthBackend | None = None,
        *,
        usage: ModelUsage | None = None,  # usage of the models if other services share them
        listen: bool = True,  # False: the caller calls `on_…` and opens the methods
        previews: bool = True,  # False: publish no image with boxes of keyframes
    ) -> None:
        self._bus, self._health = bus, health
        self._models = Models(detector, scorer, depth)
        self._analyzer = FrameAnalyzer(self._models, health)
        self._usage = usage or ModelUsage()
        self._previews, self._seldom = previews, LogRateLimit(log)
        self.methods = QueryMethods(bus, self._analyzer, self._usage, health)
        self._lock = threading.Lock()  # guards the next six attributes
        self._context: SearchContext | None = None
        self._refused: dict[str, str] = {}
        self._asked: SearchContext | None = None  # newer context that is not active yet
        self._again_s = 0.0  # monotonic time from which `_asked` is retried
        self._held: FrameMessage | None = None
        # Step (keyframe, found, scored, context, models) -> reason of its failure; "" on success.
        self._troubles: dict[str, str] = {}
        if listen:
            bus.subscribe_in_place(KEYFRAME, self.on_keyframe)
            bus.subscribe_in_place(FRAME, self.on_frame)
            self.methods.open()
            bus.subscribe(CONTEXT, self.on_context)
        self._tell_health()

    @property
    def knows_context(self) -> bool:
        """True once a search context is active, so that keyframes are answered."""
        with self._lock:
            return self._context is not None

    def close(self) -> None:
        self._models.close()

    def unload_if_idle(self, after_s: float) -> None:
        """Free the models' memory after `after_s` seconds without work."""
        if not self._usage.claim_idle(after_s):
            return
        try:
            self._models.unload()
        except Exception as error:
            self._say_trouble("models", f"the models cannot be unloaded: {typed(error).message}")
            return
        self._say_trouble("models", "")
        self._health.count("unloads")
        self._health.set("memory_mb", resident_mb())
        log.info("models unloaded after %g s without work; the next frame loads them", after_s)

    # --- input --------------------------------------------------------------------------------
    def on_context(self, message: pb.SearchContext) -> None:
        """Activate the search context. Reports classes that the detector cannot find and seeks the
        others."""
        try:
            context = context_from_proto(message)
        except Exception as error:
            self._health.count("contexts_refused")
            log.warning("search context %.100s refused: %s", message.id, typed(error).message)
            return
        with self._lock:
            self._asked, self._again_s = context, math.inf  # no retry during this attempt
        if not self._seek(context):
            self._health.count("contexts_refused")

    def retry_context(self) -> None:
        """Retry the context that the back end could not take, at most once per
        `CONTEXT_RETRY_S`."""
        with self._lock:
            asked = self._asked if time.monotonic() >= self._again_s else None
        if asked is not None:
            self._health.count("context_retries")
            self._seek(asked)

    def _seek(self, context: SearchContext) -> bool:
        """True if the back end takes the context; else report the reason and keep the old one."""
        try:
            refused = self._analyzer.refused(context) if context.classes else {}
        except Exception as error:
            fault = typed(error)
            why = f"search context {context.id} is not sought: {fault.message}"
            log.warning("%s", why)
            with self._lock:
                if self._asked is context:  # otherwise a newer one arrived meanwhile
                    self._again_s = time.monotonic() + CONTEXT_RETRY_S
                    self._troubles["context"] = why
                    if isinstance(fault, InvalidInput):  # a retry cannot help
                        self._asked = None
            self._tell_health()
            return False
        lost = {plain(name) for name in refused}  # `refused` names one spelling of each class
        findable = tuple(c for c in context.classes if plain(c.name) not in lost)
        prompts = {n: p for n, p in context.class_prompts.items() if plain(n) not in lost}
        with self._lock:
            if self._asked is not context:  # a newer one arrived, or this one is already active
                return True
            self._context = replace(context, classes=findable, class_prompts=prompts)
            self._refused = refused
            self._asked, self._troubles["context"] = None, ""
            self._troubles["found"] = ""  # it belonged to the previous search
            held, self._held = self._held, None
        self._health.set("classes_refused", len(refused))
        self._health.count("contexts_sought" if findable else "contexts_unknown")
        for reason in refused.values():
            log.warning("search context %s: %s", context.id, reason)
        self._tell_health()
        if held is not None:
            self.on_keyframe(held)
        return True

    def on_keyframe(self, message: FrameMessage, sent: Callable[[], None] = lambda: None) -> None:
        """Answer with an Observation; hold the frame while no context is active.

        Calls `sent` directly after publishing the Observation.
        """
        with self._lock:
            context, replaced = self._context, None
            if context is None:
                replaced, self._held = self._held, kept(message)
        if replaced is not None:
            self._health.count("keyframes_replaced")
            self.acknowledge_dropped(
                replaced, "a newer keyframe came before anything was looked for"
            )
        if context is not None:
            keyframe = str(frame_id_from_proto(message.id))
            with tracing.span("detection", keyframe=keyframe, task=context.id):
                why_not = self._answered(message, context, sent)
                self._acknowledge(message.id, context.id, why_not)

    def acknowledge_dropped(self, message: FrameMessage, why: str) -> None:
        """Acknowledge a keyframe that is dropped, with the reason."""
        with self._lock:
            context = self._context
        self._acknowledge(message.id, context.id if context is not None else "", why)

    def _answered(
        self, message: FrameMessage, context: SearchContext, sent: Callable[[], None]
    ) -> str:
        """Publish the Observation of a keyframe; return "" or the reason of the failure."""
        trouble, frame = "", None
        try:
            frame = frame_from_proto(message)
            with self._usage.work():
                self._answer(apart(message), frame, context, sent)
            return ""
        except Exception as error:
            fault = typed(error)
            wrong_frame = isinstance(fault, InvalidInput)
            self._refuse("keyframes_refused" if wrong_frame else "keyframes_failed", message, fault)
            if frame is not None or not wrong_frame:
                trouble = f"the last keyframe could not be answered: {fault.message}"
            return fault.message
        finally:
            self._say_trouble("keyframe", trouble)

    def _acknowledge(self, id: pb.FrameId, context_id: str, why_not: str) -> None:
        """Publish that the detector is done with a keyframe; empty `why_not`: accepted."""
        ack = pb.Ack(
            service="detector",
            part="observation",
            id=id,
            accepted=not why_not,
            reason=why_not,
            context_id=context_id,
        )
        try:
            self._bus.publish(DETECTOR_ACK, ack)
        except HeliosError as error:
            log.warning("keyframe %d was not acknowledged: %s", id.seq, error.message)

    def on_frame(self, message: FrameMessage) -> None:
        """Publish a preview, unless another frame is in work."""
        with self._lock:
            context = self._context
        with self._usage.work_if_free() as free:
            if not free:
                self._health.count("previews_skipped")
                return
            began = time.perf_counter()
            try:
                frame = frame_from_proto(message)
                findings = Findings((), ())
                if context is not None:
                    findings, _ = self._analyzer.detect(frame, context)
                self._publish_preview(message, frame, findings, context)
                self._analyzer.timed("preview", began)
            except Exception as error:
                self._refuse("previews_refused", message, typed(error))

    # --- output -------------------------------------------------------------------------------
    def _answer(
        self,
        message: ImageMessage[pb.Frame],
        frame: Frame,
        context: SearchContext,
        sent: Callable[[], None],
    ) -> None:
        began = time.perf_counter()
        with tracing.span("detect", detector=self._models.detector.name):
            findings, wrong = self._analyzer.detect(frame, context)
        if wrong or findings.detections or findings.seen:  # empty findings do not clear a fault
            self._say_trouble("found", wrong)
        detect_ms = self._analyzer.timed("detect", began)
        began = time.perf_counter()
        with tracing.span("score", scorer=self._models.scorer.name):
            rated, wrong = self._analyzer.judge(frame, findings, context)
        self._say_trouble("scored", wrong)
        models = self._models
        mine, others = by_class(findings.detections, context)
        out = observation_message(
            Observation(
                frame,
                context.id,
                mine,
                rated.layer_scores,
                models.detector.name,
                models.scorer.name,
                rated.image,
                others,
                rated.class_scores,
            ),
            message,
        )
        out.head.detect_ms = detect_ms
        self._analyzer.timed("score", began)
        self._analyzer.measure()
        self._bus.publish(OBSERVATION, out)
        self._health.count("keyframes_answered")
        sent()
        if not self._previews:
            return
        try:
            self._publish_preview(message, frame, findings, context)
        except Exception as error:  # the keyframe is already answered
            self._refuse("previews_refused", message, typed(error))

    def _publish_preview(
        self,
        message: FrameMessage,
        frame: Frame,
        findings: Findings,
        context: SearchContext | None,
    ) -> None:
        """Publish the image with the boxes of the context's classes."""
        bgr = cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR)
        quality = [cv2.IMWRITE_JPEG_QUALITY, PREVIEW_QUALITY]
        good, jpeg = cv2.imencode(".jpg", bgr, quality)
        if not good:
            raise InvalidInput(f"the colour image of frame {frame.id} cannot be made a JPEG")
        mine, _ = by_class(findings.detections, context)
        boxes = [detection_to_proto(d, with_mask=False) for d in mine]
        self._bus.publish(PREVIEW, pb.Preview(id=message.id, jpeg=jpeg.tobytes(), detections=boxes))
        self._health.count("previews")

    def _refuse(self, counter: str, message: FrameMessage, error: HeliosError) -> None:
        self._health.count(counter)
        said = f"{counter}: frame {message.id.seq}: {error.message}"
        self._seldom.warn((counter, type(error)), said)

    def _say_trouble(self, what: str, why: str) -> None:
        """Record the reason of a step's last failure; "" after success."""
        with self._lock:
            self._troubles[what] = why
        self._tell_health()

    def _tell_health(self) -> None:
        with self._lock:
            problems = [*filter(None, self._troubles.values()), *self._refused.values()]
            known = self._context is not None
        if problems:
            self._health.degraded("; ".join(problems))
        else:
            note = "" if known else "waits for a search context; the newest keyframe is held"
            self._health.ready(note)
