"""Object map service: integrates observations, publishes acknowledgements, serves the map's
requests."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from dataclasses import dataclass

from helios_core import proto as pb
from helios_core import tracing
from helios_core.bus import Bus
from helios_core.codec import (
    context_from_proto,
    frame_id_to_proto,
    observation_from_proto,
    state_from_proto,
)
from helios_core.codec.frames import transform_from_proto
from helios_core.errors import Conflict, HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.image_messages import ObservationMessage, apart
from helios_core.map_autosave import AutosavedFile, WriteOutcome
from helios_core.service_process import until_warm
from helios_core.topics import (
    CONTEXT,
    EXPORT_OBJECTS,
    GAUSSIANS,
    HELD_OBJECT,
    LOAD_OBJECTS,
    NAMES_AT,
    OBJECT_DETAIL,
    OBJECTMAP_ACK,
    OBJECTS,
    OBSERVATION,
    RELOCALISATION,
    RENDER_OBJECTS,
    RESET_OBJECTS,
    RETIRE,
    RETIRED,
    ROBOT_STATE,
    SAVE_OBJECTS,
    STORED_OBJECTS,
    WHAT_IF,
)
from helios_core.types import FrameId, ObjectInstance, Observation, SearchContext, WorldId

from helios_objectmap import export, persistence
from helios_objectmap.camera import View
from helios_objectmap.error_model import ErrorModelInUse
from helios_objectmap.object_map import UpdateReport
from helios_objectmap.object_messages import (
    ack_message,
    boxes_of,
    camera_of,
    detail_message,
    held_message,
    nothing_retired,
    object_message,
    point_of,
    with_own_color,
)
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.stored_objects import StoredObjects
from helios_objectmap.warm_up import warm_up
from helios_objectmap.world_maps import WorldMaps

log = logging.getLogger(__name__)

MOST_WAITING = 4  # observations that wait for their search context
MOST_POSES = 256
REMEMBERED = 256  # newest observations; a repeated one comes soon after
CLOSE_WITHIN_S = 1.0  # longest wait at `close` for a query that compiles kernels
FILE_NAME = "objects.npz"
_FORMATS = {"ply": export.ply, "npz": export.npz}


@dataclass(frozen=True)
class _Published:
    """Cached reply to `objects` for one map version, computed at the first request."""

    version: int
    objects: tuple[ObjectInstance, ...]
    relocalised: frozenset[int]  # ids of those of a stored map


class ObjectMapService:
    """Bus interface to the object map of one robot."""

    def __init__(self, bus: Bus, settings: ObjectMapSettings, health: Health) -> None:
        self._errors = ErrorModelInUse(settings)
        settings = self._errors.settings
        self._bus, self._settings, self._health = bus, settings, health
        # Held while the kernels are compiled, and by contexts, robot states, observations and the
        # taking over of a stored map, which need them. A thread that needs both locks takes this
        # one first.
        self._compiling = threading.Lock()
        # Guards the maps, the context and what waits or was published. Texts for the health are
        # single values that are replaced whole, and need no lock.
        self._lock = threading.Lock()
        stored_file = None if settings.state_dir is None else settings.state_dir / FILE_NAME
        self._stored = StoredObjects(settings, stored_file)
        self._maps = WorldMaps(settings, self._stored)
        self._context: SearchContext | None = None
        self._over: deque[str] = deque(maxlen=256)  # ids of contexts that a later one replaced
        self._waiting: deque[tuple[pb.Observation, Observation]] = deque()
        self._fused: deque[tuple[str, FrameId]] = deque(maxlen=REMEMBERED)  # context and frame
        self._held = ""
        self._version = 0
        self._published: _Published | None = None
        bus.subscribe(CONTEXT, self.on_context)
        bus.subscribe(ROBOT_STATE, self.on_robot_state)
        bus.serve(OBJECTS, self.objects)
        bus.serve(WHAT_IF, self.what_if)
        bus.serve(RETIRE, self.retire)
        bus.serve(HELD_OBJECT, self.held_object)
        bus.serve(NAMES_AT, self.names_at)
        bus.serve(RESET_OBJECTS, self.reset)
        bus.serve(GAUSSIANS, self.gaussians)
        bus.serve(SAVE_OBJECTS, self.save)
        bus.serve(LOAD_OBJECTS, self.load)
        bus.serve(EXPORT_OBJECTS, self.export)
        bus.serve(RENDER_OBJECTS, self.render)
        bus.serve(OBJECT_DETAIL, self.detail)
        self._warm, self._ending = False, threading.Event()
        self._refused = ""  # why this process refused the map file of an earlier one
        self._trouble = ""  # why the current map cannot be saved, "" if it can
        self._kept: AutosavedFile | None = None
        if stored_file is not None:
            self._kept = AutosavedFile(
                stored_file, settings.save_every_s, self._unkept, self._troubled
            )
        self._take_up_kept_map()
        bus.serve(STORED_OBJECTS, self.stored_objects)
        bus.subscribe(RELOCALISATION, self.on_relocalisation)
        bus.subscribe_in_place(OBSERVATION, self.on_observation)

    def warm_up(self) -> None:
        """Compile the kernels, then report ready.

        Messages that change the map wait during the compilation; no observation is lost.
        """

        def compile() -> None:
            with self._compiling:
                warm_up(self._settings)

        if until_warm(self._health, compile, self._ending):
            self._warm = True
            self._say()

    def close(self) -> None:
        """Save the map. The bus closes with the process.

        A query during the compilation can hold the map for long. Then the map is not saved; no
        observation has changed it.
        """
        self._ending.set()
        if self._kept is None:
            return
        if not self._warm:
            if not self._lock.acquire(timeout=CLOSE_WITHIN_S):
                log.warning("the map is not saved, because a query still compiles kernels")
                return
            self._lock.release()
        self._kept.close()
        if self._stored.untidy:
            self._kept.write()  # the map is saved; this removes the files that it contains

    def _say(self) -> None:
        if self._warm:
            self._health.ready(self._said)

    # Messages ---------------------------------------------------------------------------------
    def on_context(self, message: pb.SearchContext) -> None:
        """Switch to a new search context and integrate the observations that waited for it.

        Those of a context that is still unknown wait on.
        """
        try:
            context = context_from_proto(message)
        except InvalidInput as error:
            self._health.count("contexts_refused")
            log.warning("search context %.100s refused: %s", message.id, error.message)
            return
        with self._compiling, self._lock:
            if self._context is not None and self._context.id != context.id:
                self._over.append(self._context.id)
            self._context = context
            self._maps.current.set_context(context)
            self._changed()
            known = [w for w in self._waiting if self._knows(w[1].context_id)]
            self._waiting = deque(w for w in self._waiting if not self._knows(w[1].context_id))
        for raw, observation in known:
            self._integrate(raw, observation)

    def on_robot_state(self, message: pb.RobotState) -> None:
        """Note the held object, which the map leaves out, and the world that the robot is in."""
        try:
            held = state_from_proto(message).held
        except InvalidInput as error:
            self._health.count("states_refused")
            log.warning("robot state refused: %s", error.message)
            return
        with self._compiling, self._lock:
            self._held = held
            parked = replaced = False
            if boot_id := message.robot_boot_id:
                world = WorldId.of(boot_id, message.world_epoch, message.origin_id)
                parked, replaced = self._maps.robot_is_in(world, boot_id)
            if replaced:
                self._replaced()
        if parked:
            log.warning("%s", self._map_said)
            self._say()

    def on_relocalisation(self, message: pb.Relocalisation) -> None:
        """Take over the stored map once its place in the present frame is known."""
        with self._lock:
            self._stored.note_place(message)
        self._take_over_stored()

    def on_observation(self, message: ObservationMessage) -> None:
        """Integrate an observation, or publish a refusal with its reason. Never raises.

        An observation whose search context is unknown waits for that context. At most MOST_WAITING
        wait; one more, and the oldest is refused.
        """
        try:
            observation = observation_from_proto(message)
        except HeliosError as error:
            self._refuse(message, error.message)
            return
        except Exception as error:  # the sender waits for an acknowledgement in any case
            log.exception("observation of frame %d cannot be read", message.frame.id.seq)
            self._refuse(message, f"a fault in the object map: {type(error).__name__}: {error}")
            return
        dropped = None
        with self._compiling, self._lock:
            is_known = self._knows(observation.context_id)
            if not is_known:
                self._waiting.append((apart(message).head, with_own_color(observation)))
                if len(self._waiting) > MOST_WAITING:
                    dropped = self._waiting.popleft()[0]
        if dropped is not None:
            self._refuse(dropped, f"search context {dropped.context_id!r} never came")
        if is_known:
            self._integrate(message, observation)

    # Queries ----------------------------------------------------------------------------------
    def objects(self, request: pb.ObjectsRequest) -> pb.ObjectsReply:
        """All instances, or those of some classes above a class score."""
        wanted = set(request.class_names)
        with self._lock:
            if self._published is None:
                current = self._maps.current
                self._published = _Published(
                    self._version, current.objects(), current.added_objects()
                )
            published, count = self._published, len(self._maps.current)
            newest = self._maps.newest
        reply = pb.ObjectsReply(version=published.version, gaussians=count)
        if newest is not None:
            reply.id.CopyFrom(frame_id_to_proto(newest))
        reply.objects.extend(
            object_message(o, o.id in published.relocalised)
            for o in published.objects
            if (not wanted or o.class_name in wanted) and o.class_score >= request.min_class_score
        )
        return reply

    def stored_objects(self, _: pb.Empty) -> pb.StoredObjectsReply:
        """Objects of a stored map that is not relocalised; `objects` leaves them out."""
        with self._lock:
            return self._stored.described()

    def what_if(self, request: pb.WhatIfRequest) -> pb.WhatIfReply:
        """Score and information gain if views showed an instance as a class (eq. 6, 11, 12)."""
        if len(request.T_world_cam) > MOST_POSES:
            raise InvalidInput(
                f"{len(request.T_world_cam)} poses asked for; at most {MOST_POSES} in one call"
            )
        other = request.other_share if request.HasField("other_share") else None
        if other is not None and not 0 <= other <= 1:
            raise InvalidInput(f"other_share is {other}; wanted a share from 0 to 1")
        c = camera_of(request.camera, self._settings.stride_px)
        intrinsics = (c.fx, c.fy, c.cx, c.cy, c.width, c.height)
        views = [View(*intrinsics, transform_from_proto(T)) for T in request.T_world_cam]
        with self._lock:
            current = self._maps.current
            answer = current.what_if(request.object_id, request.class_name, views, other)
            area_m2 = current.seen_area_m2(request.object_id)
        if answer is None:
            raise InvalidInput(
                f"no object {request.object_id}, or no class {request.class_name!r} in any search "
                "so far: ask for the objects again, they may have changed"
            )
        alone, together = answer
        outcomes = [together] if request.joint else alone
        return pb.WhatIfReply(
            score=[e.psi for e in outcomes],
            information_gain=[e.information_gain for e in outcomes],
            pixels=[e.pixels for e in outcomes],
            area_m2=area_m2,
        )

    def retire(self, request: pb.RetireRequest) -> pb.RetireReply:
        """Remove a picked object: the one with the given id, or else the nearest around a point.

        Without such an object, the map only forgets what earlier views say about the point.
        """
        if not request.object_id and not request.radius_m > 0:
            raise InvalidInput("give an object_id, or point_m with a radius_m above 0")
        with self._lock:
            present = self._maps.current
            label: int | None = request.object_id
            if not present.class_of(request.object_id) and request.radius_m > 0:
                point = point_of(request)
                label = present.nearest_object(point, request.radius_m)
                if label is None:
                    present.forget_place(point)
            class_name = present.class_of(label) if label is not None else ""
            count = present.retire(label) if label is not None else 0
            after = self._maps.newest
            self._changed()
        reply = pb.RetireReply(retired_gaussians=count)
        if count:
            reply.object_id, reply.class_name = label or 0, class_name
            log.info("retired %s %s (%d): %s", class_name, label, count, request.reason)
        else:
            reply.reason = nothing_retired(request)
            log.warning("nothing was retired (%s): %s", request.reason, reply.reason)
        retired = pb.Retired(
            request=request,
            retired_gaussians=count,
            object_id=reply.object_id,
            class_name=reply.class_name,
        )
        if after is not None:
            retired.after.CopyFrom(frame_id_to_proto(after))
        self._bus.publish(RETIRED, retired)
        return reply

    def held_object(self, request: pb.HeldObjectRequest) -> pb.HeldObjectReply:
        """Names of the object that the robot shows to the camera, or showed last."""
        with self._lock:
            seen = self._maps.current.shown_names(request.class_name)
        return held_message(seen)

    def names_at(self, request: pb.NamesAtRequest) -> pb.NamesAtReply:
        """What the detections in some boxes say about a class. Raises InvalidInput."""
        boxes = boxes_of(request)
        with self._lock:
            inside = self._maps.current.probability_in
            return pb.NamesAtReply(probability=[inside(request.class_name, box) for box in boxes])

    def reset(self, _: pb.Empty) -> pb.Empty:
        """Delete every map, the parked and saved ones included; the current search continues."""
        with self._lock:
            self._maps.forget()
            self._replaced()
        if self._kept is not None:
            self._kept.forget()
        self._say()
        return pb.Empty()

    def gaussians(self, request: pb.GaussiansRequest) -> pb.GaussiansReply:
        """Gaussians of one instance, or of all instances."""
        with self._lock:
            g = self._maps.current.gaussians(request.object_id or None)
        return pb.GaussiansReply(
            count=len(g.means),
            means_m=g.means.astype("<f4").tobytes(),
            scales_m=g.radius_m.astype("<f4").tobytes(),
            colors=g.color.tobytes(),
            instances=g.instance.astype("<u4").tobytes(),
            class_names=g.class_names,
            concentration=g.concentration.astype("<f4").tobytes(),
            opacities=g.opacity.astype("<f4").tobytes(),
        )

    # Files, images, one object ----------------------------------------------------------------
    def save(self, _: pb.Empty) -> pb.ObjectMapFile:
        """The current map as a file."""
        with self._lock:
            arrays = self._maps.arrays()
        data = persistence.to_bytes(arrays)
        with self._lock:
            self._maps.note_saved(data)
        return pb.ObjectMapFile(data=data)

    def load(self, request: pb.ObjectMapFile) -> pb.ObjectMapLoaded:
        """Replace the current map with the map of a file, or store it if it is of another world.

        A refused file changes nothing.
        """
        found = persistence.read(request.data, self._maps.current.empty_viewpoints())
        with self._lock:
            loaded = self._maps.load(found, request.data, request.same_frame)
            if not loaded.stored:
                self._replaced()
        try:
            self._stored.write()
        except OSError as error:  # the next save tries again, and the health tells if that fails
            log.error("the stored map cannot be written: %s", error)
        log.info("%d Gaussians read", loaded.gaussians)
        self._say()
        return loaded

    def export(self, request: pb.ExportRequest) -> pb.ExportReply:
        """Gaussians of all instances, or of one, in the format of other programs."""
        if request.format not in _FORMATS:
            raise InvalidInput(f"no format {request.format!r}; wanted {' or '.join(_FORMATS)}")
        with self._lock:
            gaussians = self._maps.current.gaussians(request.object_id or None)
        if request.object_id and not len(gaussians.means):
            raise self._unknown(request.object_id)
        return pb.ExportReply(
            data=_FORMATS[request.format](gaussians), gaussians=len(gaussians.means)
        )

    def render(self, request: pb.RenderRequest) -> pb.RenderReply:
        """Rendered image of the map from an arbitrary camera pose."""
        c = camera_of(request.camera)
        T_world_cam = transform_from_proto(request.T_world_cam)
        view = View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, T_world_cam)
        with self._lock:
            png = self._maps.current.render(view, request.layer or "color", request.class_name)
        return pb.RenderReply(png=png)

    def detail(self, request: pb.ObjectRequest) -> pb.ObjectDetail:
        """One object with its attributes, the history of its score, grasp points and grasp box."""
        with self._lock:
            present = self._maps.current
            found = next((o for o in present.objects() if o.id == request.object_id), None)
            history = present.history(request.object_id)
            grasp = present.grasp(request.object_id)
        if found is None or grasp is None:
            raise self._unknown(request.object_id)
        return detail_message(found, history, grasp)

    # Parts ------------------------------------------------------------------------------------
    def _knows(self, context_id: str) -> bool:
        """True for the present search context and for those before it."""
        present = self._context is not None and self._context.id == context_id
        return present or context_id in self._over

    def _integrate(self, message: ObservationMessage, observation: Observation) -> None:
        keyframe, context_id = str(observation.frame.id), observation.context_id
        with tracing.span("update of objects", keyframe=keyframe, task=context_id):
            self._fuse(message, observation)

    def _fuse(self, message: ObservationMessage, observation: Observation) -> None:
        began = time.perf_counter()
        try:
            with self._compiling, self._lock:
                report = self._update(observation)
                version, noted = self._version, self._maps.drop_restored_note()
        except HeliosError as error:
            self._refuse(message, error.message)
            return
        except Exception as error:  # an internal error is reported; the process continues
            log.exception("observation %s failed", observation.frame.id)
            self._refuse(message, f"a fault in the object map: {type(error).__name__}: {error}")
            return
        update_ms = (time.perf_counter() - began) * 1e3
        if self._errors.hear(observation.detector) or noted:
            self._say()
        self._take_over_stored()
        self._health.count("observations_accepted")
        self._health.sample("update_ms", update_ms)
        self._health.set("gaussians", report.total)
        self._bus.publish(OBJECTMAP_ACK, ack_message(message, version, update_ms=update_ms))

    def _update(self, observation: Observation) -> UpdateReport:
        context = self._context
        if context is None or observation.context_id != context.id:
            raise Conflict(
                f"the observation answers search context {observation.context_id!r}; the present "
                f"one is {context.id if context else None!r}: observe again"
            )
        present = self._maps.map_for(observation.frame)
        key = (observation.context_id, observation.frame.id)
        if key in self._fused:  # it was sent twice
            return UpdateReport(created=0, carved=0, in_view=0, fused=0, total=len(present))
        held = observation.frame.held
        report = present.update(observation, context, self._held if held is None else held)
        self._fused.append(key)
        self._maps.note_update(observation.frame.id)
        self._changed()
        return report

    def _take_over_stored(self) -> None:
        """Add the stored map to the present one if it is relocalised, and save the result.

        If that save fails, the stored file stays until a later save succeeds.
        """
        with self._compiling, self._lock:
            if not self._stored_added():
                return
            self._changed()
        if self._kept is None or self._kept.write() is not WriteOutcome.FAILED:
            with self._lock:
                self._stored.tidy()
        self._say()

    def _stored_added(self) -> bool:
        """Add the stored map if it is relocalised; True if it was. If that fails, the health tells,
        observations go on, and the file stays."""
        try:
            return self._maps.take_over_stored()
        except Exception as error:
            log.exception("the stored objects cannot be used")
            self._refused = f"the stored objects cannot be used, their file stays: {error!r}"
            self._say()
            return False

    def _replaced(self) -> None:
        """Set up the map that has just replaced the current one."""
        self._fused.clear()
        if self._context is not None:
            self._maps.current.set_context(self._context)
        self._changed()

    def _changed(self) -> None:
        self._version += 1
        self._published = None

    def _refuse(self, message: ObservationMessage, reason: str) -> None:
        self._health.count("observations_refused")
        log.warning("observation of frame %d refused: %s", message.frame.id.seq, reason)
        with self._lock:
            version = self._version
        self._bus.publish(OBJECTMAP_ACK, ack_message(message, version, reason=reason))

    # The map kept on disk ---------------------------------------------------------------------
    @property
    def _said(self) -> str:
        """Health detail: what there is to say of the map's file, and the error model in use."""
        return "; ".join(part for part in (self._map_said, self._errors.said) if part)

    @property
    def _map_said(self) -> str:
        """Why the map cannot be saved, and what became of the map of an earlier process."""
        waits = (
            "stored objects are not in use until the robot has found its place"
            if self._stored.waits
            else ""
        )
        parts = (self._trouble, self._refused, self._maps.restored_note(), waits)
        return "; ".join(part for part in parts if part)

    def _take_up_kept_map(self) -> None:
        """Restore the map file of an earlier process, if any, and start the periodic save."""
        if self._kept is None:
            return
        try:
            found = self._kept.found()
            if found is not None:
                with self._lock:
                    self._maps.restore(found)
                    self._replaced()
                    count = len(self._maps.current)
                log.info("%d Gaussians read", count)
        except InvalidInput as error:
            self._health.count("maps_refused")
            self._refused = f"the kept map was refused and {self._kept.put_aside()}: {error}"
        except OSError as error:
            aside = self._kept.put_aside()
            self._refused = f"the kept map cannot be read and was {aside}: {error}"
        if self._map_said:
            log.warning("%s", self._map_said)
        self._kept.start()

    def _unkept(self, kept_version: int) -> tuple[int, bytes] | None:
        with self._lock:
            version = self._version
            if version == kept_version and not self._stored.unwritten:
                if self._stored.untidy:
                    self._stored.tidy()
                return None
            arrays = self._maps.arrays()
        self._stored.write()
        return version, persistence.to_bytes(arrays)

    def _troubled(self, reason: str) -> None:
        if reason:
            self._health.count("saves_failed")
        if reason != self._trouble:
            self._trouble = reason
            self._say()

    @staticmethod
    def _unknown(object_id: int) -> InvalidInput:
        return InvalidInput(f"no object {object_id}: ask for the objects again, they have changed")
