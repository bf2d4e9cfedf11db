"""The detector's shell: frame in, detections and scores out.

Every keyframe is answered with an Observation, or counted with the reason why it cannot be.
Stream frames become previews; one that comes while another frame is worked on is skipped.
A keyframe that comes before the search context is held (the newest one) and answered when it is
known. No lock is held while a back end works or the bus is used.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import cv2
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import (
    context_from_proto,
    embedding_to_proto,
    frame_from_proto,
    observation_to_proto,
)
from helios_core.codec.frames import detection_to_proto
from helios_core.codec.images import color_array
from helios_core.errors import (
    DeadlineExceeded,
    HeliosError,
    Internal,
    InvalidInput,
    Unavailable,
)
from helios_core.health import Health
from helios_core.topics import (
    CONTEXT,
    EMBED_TEXT,
    ESTIMATE_DEPTH,
    FRAME,
    KEYFRAME,
    OBSERVATION,
    PREVIEW,
    VOCABULARY,
)
from helios_core.types import Frame, Observation, SearchContext

from helios_detector.backend import (
    DepthBackend,
    DetectorBackend,
    Findings,
    Judgement,
    ScorerBackend,
)
from helios_detector.depth_wire import depth_to_proto, focal_of
from helios_detector.memory import resident_mb

log = logging.getLogger(__name__)

MOST_PROMPTS = 64
ATTEMPTS = 3  # at a keyframe when what the back end needs does not answer


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
    ) -> None:
        self._bus, self._health = bus, health
        self._detector, self._scorer, self._depth = detector, scorer, depth
        self._preview_quality = preview_quality
        self._lock = threading.Lock()  # guards the seven below
        self._used_s, self._unloaded = time.monotonic(), False
        self._context: SearchContext | None = None
        self._refused: dict[str, str] = {}
        self._held: pb.Frame | None = None
        self._trouble = ""  # why the last keyframe could not be answered
        self._working = 0
        self._tell_health()
        bus.subscribe(CONTEXT, self.on_context)
        bus.serve(VOCABULARY, self.vocabulary)
        bus.serve(EMBED_TEXT, self.embed_text)
        bus.serve(ESTIMATE_DEPTH, self.estimate_depth)
        bus.subscribe(KEYFRAME, self.on_keyframe)
        bus.subscribe(FRAME, self.on_frame)

    def close(self) -> None:
        for model in self._models:
            model.close()

    @property
    def _models(self) -> list[DetectorBackend | ScorerBackend | DepthBackend]:
        return [m for m in (self._detector, self._scorer, self._depth) if m is not None]

    def unload_if_idle(self, after_s: float) -> None:
        """Free the models' memory when nothing was asked of them for that long."""
        with self._lock:
            idle = self._working == 0 and time.monotonic() - self._used_s > after_s
            if not idle or self._unloaded:
                return
            self._unloaded = True
        for model in self._models:
            model.unload()
        self._health.count("unloads")
        self._health.set("memory_mb", resident_mb())
        log.info("models unloaded after %g s without work; the next frame loads them", after_s)

    # --- what comes in ------------------------------------------------------------------------
    def vocabulary(self, _: pb.Empty) -> pb.VocabularyReply:
        names = self._detector.vocabulary()
        return pb.VocabularyReply(
            open=names is None,
            names=names or (),
            detector=self._detector.name,
            scorer=self._scorer.name,
        )

    def embed_text(self, request: pb.EmbedTextRequest) -> pb.EmbedTextReply:
        """Prompts as the scorer sees them, for images that came with earlier observations."""
        if not 0 < len(request.prompts) <= MOST_PROMPTS:
            raise InvalidInput(
                f"{len(request.prompts)} prompts came; send 1 to {MOST_PROMPTS} in one call"
            )
        made = self._scorer.embed_text(list(request.prompts))
        return pb.EmbedTextReply(
            embeddings=[embedding_to_proto(e) for e in made.texts],
            scale=made.scale,
            offset=made.offset,
        )

    def on_context(self, message: pb.SearchContext) -> None:
        """What is sought from now on. Classes that cannot be found are said, the others sought."""
        try:
            context = context_from_proto(message)
        except InvalidInput as error:
            self._health.count("contexts_refused")
            log.warning("search context %.100s refused: %s", message.id, error.message)
            return
        refused = dict(self._detector.refused(context))
        findable = tuple(c for c in context.classes if c.name not in refused)
        with self._lock:
            self._context, self._refused = replace(context, classes=findable), refused
            held, self._held = self._held, None
        for reason in refused.values():
            log.warning("search context %s: %s", context.id, reason)
        self._tell_health()
        if held is not None:
            self.on_keyframe(held)

    def on_keyframe(self, message: pb.Frame) -> None:
        """Answer with an Observation; hold the frame while no context is known."""
        with self._lock:
            if self._context is None:
                if self._held is not None:
                    self._health.count("keyframes_replaced")
                self._held = message
                return
            context = self._context
            self._working += 1
        began = time.perf_counter()
        trouble = ""
        try:
            frame = frame_from_proto(message)
            findings = self._detect(frame, context)
            detected = time.perf_counter()
            judged = self._judge(frame, findings, context)
            out = observation_to_proto(
                Observation(
                    frame, context.id, findings.detections, judged.scores,
                    self._detector.name, self._scorer.name, judged.image,
                ),
                message,
            )  # fmt: skip
            out.detect_ms = (detected - began) * 1e3
            self._health.sample("detect_ms", out.detect_ms)
            self._health.sample("score_ms", (time.perf_counter() - detected) * 1e3)
            self._measure()
            self._health.count("keyframes_answered")
            self._bus.publish(OBSERVATION, out)
            self._publish_preview(message, frame, findings)
        except InvalidInput as error:
            self._refuse("keyframes_refused", message, error)
        except HeliosError as error:
            self._refuse("keyframes_failed", message, error)
            trouble = f"the last keyframe could not be answered: {error.message}"
        finally:
            self._done()
            with self._lock:
                self._trouble = trouble
            self._tell_health()

    def on_frame(self, message: pb.Frame) -> None:
        """Publish a preview, unless another frame is being worked on."""
        with self._lock:
            busy, context = self._working > 0, self._context
            if not busy:
                self._working += 1
        if busy:
            self._health.count("previews_skipped")
            return
        try:
            frame = frame_from_proto(message)
            findings = self._detect(frame, context) if context else Findings((), ())
            self._publish_preview(message, frame, findings)
        except HeliosError as error:
            self._refuse("previews_refused", message, error)
        finally:
            self._done()

    def estimate_depth(self, request: pb.DepthRequest) -> pb.DepthReply:
        """Depth of a colour image, for robots that have none (the bridge asks)."""
        if self._depth is None:
            raise InvalidInput(
                "this detector makes no depth; set its depth to transformers:ID, or the bridge's "
                "depth to sensor"
            )
        began = time.perf_counter()
        color = color_array(
            request.raw_color if request.HasField("raw_color") else None,
            request.compressed_color if request.HasField("compressed_color") else None,
        )
        focal_px = focal_of(request, color.shape[1])
        with self._work():
            made = self._depth.estimate(color, focal_px)
        self._measure()
        out = depth_to_proto(made, self._depth.name)
        out.estimate_ms = (time.perf_counter() - began) * 1e3
        self._health.sample("depth_ms", out.estimate_ms)
        self._health.count("depths_estimated")
        return out

    # --- what goes out ------------------------------------------------------------------------
    def _detect(self, frame: Frame, context: SearchContext) -> Findings:
        """Asks again where what the back end needs did not answer; any fault becomes typed."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                return self._detector.detect(frame, context)
            except (Unavailable, DeadlineExceeded) as error:
                self._health.count("detect_retries")
                if attempt == ATTEMPTS:
                    raise
                log.warning("frame %s: %s; asking again", frame.id, error.message)
            except HeliosError:
                raise
            except Exception as error:  # a back end's own fault must not lose the frame silently
                log.exception("%s failed at frame %s", self._detector.name, frame.id)
                raise Internal(
                    f"{self._detector.name} failed ({type(error).__name__}: {error}); see its log"
                ) from error
        raise AssertionError("not reached")

    @contextlib.contextmanager
    def _work(self) -> Iterator[None]:
        """Counts as work, so that no model is unloaded meanwhile."""
        with self._lock:
            self._working += 1
        try:
            yield
        finally:
            self._done()

    def _done(self) -> None:
        with self._lock:
            self._working -= 1
            self._used_s, self._unloaded = time.monotonic(), False

    def _measure(self) -> None:
        self._health.set("memory_mb", resident_mb())
        peak = max(model.accelerator_mb() for model in self._models)
        if peak > 0:
            self._health.sample("accelerator_mb", peak)

    def _judge(self, frame: Frame, findings: Findings, context: SearchContext) -> Judgement:
        try:
            return self._scorer.judge(frame, findings.seen, context.prompts)
        except HeliosError:
            raise
        except Exception as error:
            log.exception("%s failed at frame %s", self._scorer.name, frame.id)
            raise Internal(
                f"{self._scorer.name} failed ({type(error).__name__}: {error}); see its log"
            ) from error

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
