"""The 2D map service: it fuses keyframes and observations, and publishes versions of the map.

It acknowledges every keyframe with an Ack of part "occupancy" and every observation with one of
part "value"; a refusal gives the reason. Keyframes wait for the robot's description (its size and
its camera's range), observations for their search context.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial

from helios_core import proto as pb
from helios_core import tracing
from helios_core.bus import Bus
from helios_core.codec import (
    context_from_proto,
    description_from_proto,
    frame_from_proto,
    frame_id_from_proto,
    observation_from_proto,
)
from helios_core.errors import Conflict, HeliosError, Internal, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.image_messages import FrameMessage, ObservationMessage, kept
from helios_core.keyframe_acks import MapPart
from helios_core.topics import (
    CONTEXT,
    FRAME,
    KEYFRAME,
    LOAD_MAP2D,
    MAP2D_ACK,
    MAP_CHANGES,
    OBSERVATION,
    PATH_COST,
    PICTURE,
    RECALL,
    RESET_MAP2D,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SAVE_MAP2D,
    SIGHT,
    SNAPSHOT,
)
from helios_core.types import WorldId

from helios_map2d.epochs import EpochMaps, Sought
from helios_map2d.files.persistence import MapFiles
from helios_map2d.map_queries import MapQueries
from helios_map2d.place_search import PlaceSearch
from helios_map2d.settings import Settings
from helios_map2d.snapshots.messages import Pose, reported_pose
from helios_map2d.view_search import ViewMemoryService

log = logging.getLogger(__name__)

MOST_WAITING = 32


class Map2DService:
    """Bus interface of the maps. `_lock` guards them; published versions are read without it."""

    def __init__(self, bus: Bus, settings: Settings, health: Health) -> None:
        self._bus, self._settings, self._health = bus, settings, health
        self._lock = threading.RLock()
        self._maps: EpochMaps | None = None
        self._contexts: list[str] = []  # ids in order of arrival
        self._context: pb.SearchContext | None = None
        self._robot: tuple[WorldId, str, Pose | None] | None = None  # reported world, boot id, pose
        self._frames_waiting: deque[FrameMessage] = deque()
        self._observations_waiting: deque[ObservationMessage] = deque()
        self._holding = False
        self._refused = ""  # why the robot's last description was refused
        self._listens = False
        self._answers = MapQueries(lambda: self._maps)
        self._keeping = MapFiles(settings, self._lock, lambda: self._maps, self._say)
        self._places = PlaceSearch(
            bus, self._lock, lambda: self._maps, self._keeping.taken_over, self._say
        )
        self._recollection = ViewMemoryService(
            bus, self._lock, lambda: self._maps, lambda: self._context
        )
        bus.subscribe(CONTEXT, self.on_context)
        bus.subscribe(ROBOT_DESCRIPTION, self.on_description)
        bus.subscribe(ROBOT_STATE, self.on_robot_state)
        bus.subscribe_in_place(KEYFRAME, self.on_keyframe)
        bus.subscribe_in_place(OBSERVATION, self.on_observation)
        if settings.integrate_stream:
            bus.subscribe_in_place(FRAME, self.on_stream_frame)
        bus.serve(SNAPSHOT, self._answers.snapshot)
        bus.serve(MAP_CHANGES, self._answers.changes)
        bus.serve(PICTURE, self._answers.picture)
        bus.serve(SIGHT, self._answers.sight)
        bus.serve(PATH_COST, self._answers.path_cost)
        bus.serve(RECALL, self._recollection.recall)
        bus.serve(SAVE_MAP2D, self._keeping.save)
        bus.serve(LOAD_MAP2D, self.load)
        bus.serve(RESET_MAP2D, self.reset)
        # Last, because a client may send keyframes as soon as the service is ready.
        self._listens = True
        self._say()

    def close(self) -> None:
        """Save the map a last time; the bus ends the calls."""
        self._places.close()
        self._keeping.close()

    # --- subscriptions ------------------------------------------------------------------------
    def on_description(self, message: pb.RobotDescription) -> None:
        """Apply the robot's description; start empty maps if its size or range differs."""
        try:
            robot = description_from_proto(message)
        except InvalidInput as error:
            log.warning("the robot's description is refused: %s", error.message)
            self._refused = error.message
            self._say()
            return
        self._refused = ""
        # A hand-held camera has no body that frees the ground under it.
        has_body = robot.can_move or robot.recorded
        radius_m = robot.inner_radius_m if has_body else 0.0
        rules = self._settings.rules(robot.max_depth_m, robot.inner_radius_m)
        with self._lock:
            same = self._maps is not None and (
                self._maps.rules == rules and self._maps.footprint_radius_m == radius_m
            )
            first, taken_up = self._maps is None, False
            if not same:
                self._maps = self._fresh(EpochMaps(rules, radius_m, first_version=self._version()))
                if first:
                    self._keeping.recover(self._maps)
                    taken_up = self._seek_stored()
            frames, observations = [*self._frames_waiting], [*self._observations_waiting]
            self._frames_waiting.clear()
            self._observations_waiting.clear()
        if taken_up:
            self._keep_taken_up()
        self._say()
        for frame in frames:
            self.on_keyframe(frame)
        for observation in observations:
            self.on_observation(observation)

    def on_context(self, message: pb.SearchContext) -> None:
        """Begin the search of a new search context."""
        try:
            context = context_from_proto(message)
        except InvalidInput as error:
            self._health.count("contexts_refused")
            log.warning("search context %.100s refused: %s", message.id, error.message)
            return
        with self._lock:
            self._context = message
            if context.id not in self._contexts:
                self._contexts.append(context.id)
                del self._contexts[:-256]
            begins = self._maps is not None and self._maps.reset_search(context)
            waiting = list(self._observations_waiting)
            self._observations_waiting.clear()
        for observation in waiting:
            self.on_observation(observation)
        if begins:
            self._recollection.fill(context)

    def on_robot_state(self, message: pb.RobotState) -> None:
        """Record the robot's world and pose, and whether it holds an object."""
        if not message.robot_boot_id:
            return
        boot_id = message.robot_boot_id
        world = WorldId.of(boot_id, message.world_epoch, message.origin_id)
        pose = reported_pose(message)
        with self._lock:
            another = self._robot is None or self._robot[:2] != (world, boot_id)
            self._robot = world, boot_id, pose
            self._holding = bool(message.held)
            before = self._maps.current if self._maps is not None else None
            if self._maps is not None:
                self._maps.set_robot_world(*self._robot)
            taken_up = another and self._seek_stored()
            goes_on = self._maps is not None and self._maps.current is not before
        if taken_up:
            self._keep_taken_up()
        if another:
            self._places.announce()
            self._say()
        if goes_on:
            self._catch_up()

    def on_keyframe(self, message: FrameMessage) -> None:
        late: FrameMessage | None = None
        with self._lock:
            wait = self._maps is None
            if wait:
                self._frames_waiting.append(kept(message))
                if len(self._frames_waiting) > MOST_WAITING:
                    late = self._frames_waiting.popleft()
        if late is not None:
            self._answer(MapPart.OCCUPANCY, late.id, "", self._undescribed(), 0.0)
        if not wait:
            fold = partial(self._fold_frame, message, keyframe=True)
            self._integrate(MapPart.OCCUPANCY, message.id, "", fold)

    def on_stream_frame(self, message: FrameMessage) -> None:
        """Fuse a stream frame if the maps are ready; it gets no acknowledgement."""
        if self._maps is None:
            return
        try:
            self._fold_frame(message, keyframe=False)
            self._health.count("stream_frames")
        except HeliosError as error:
            self._health.count("stream_frames_refused")
            log.info("stream frame %d refused: %s", message.id.seq, error.message)

    def on_observation(self, message: ObservationMessage) -> None:
        with self._lock:
            unheard = message.context_id not in self._contexts
            wait = self._maps is None or unheard
            late: ObservationMessage | None = None
            if wait:
                self._observations_waiting.append(kept(message))
                if len(self._observations_waiting) > MOST_WAITING:
                    late = self._observations_waiting.popleft()
            heard = late is not None and late.context_id in self._contexts
        if late is not None:
            said = f"search context {late.context_id!r} was never announced here"
            error = self._undescribed() if heard else Conflict(said)
            self._answer(MapPart.VALUE, late.frame.id, late.context_id, error, 0.0)
        if not wait:
            self._integrate(
                MapPart.VALUE,
                message.frame.id,
                message.context_id,
                lambda: self._fold_values(message),
            )

    # --- methods ------------------------------------------------------------------------------
    def load(self, request: pb.LoadMap2DRequest) -> pb.LoadMap2DReply:
        """Load a map (see `MapFiles.load`), then fill the search's layers from its stored views."""
        reply = self._keeping.load(request, self._places.seek)
        self._places.announce()
        self._say()
        self._catch_up()
        return reply

    def reset(self, _: pb.Empty) -> pb.Empty:
        """Discard all maps, also the parked and the saved ones; the current search continues."""
        with self._lock:
            if self._maps is not None:
                old = self._maps
                self._maps = self._fresh(
                    EpochMaps(old.rules, old.footprint_radius_m, first_version=self._version() + 1)
                )
            self._places.seek(None)
        self._keeping.forget()
        self._places.announce()
        self._say()
        return pb.Empty()

    def places_settled(self, within_s: float) -> bool:
        """Wait until no attempt to relocalise is due. Returns False after the time limit."""
        return self._places.settled(within_s)

    # --- internals ----------------------------------------------------------------------------
    def _undescribed(self) -> Unavailable:
        """Why there are no maps yet."""
        return Unavailable(self._refused or "the robot has not described itself; start its bridge")

    def _fold_frame(self, message: FrameMessage, keyframe: bool) -> None:
        """keyframe: False for a stream frame, which starts no attempt to relocalise."""
        frame = frame_from_proto(message)
        if frame.shown is not None:
            return
        with self._lock:
            if self._maps is not None:
                holding = self._holding if frame.held is None else bool(frame.held)
                self._maps.map_for(frame).integrate_frame(frame, holding=holding)
                if keyframe:
                    self._places.note_keyframe()

    def _fold_values(self, message: ObservationMessage) -> None:
        observation = observation_from_proto(message, with_others=False)
        if observation.frame.shown is not None:
            return
        with self._lock:
            if self._maps is not None:
                state = self._maps.map_for(observation.frame, observation)
                state.integrate_values(observation)

    def _integrate(
        self, part: MapPart, id: pb.FrameId, context_id: str, fold: Callable[[], None]
    ) -> None:
        """Fuse and acknowledge; the acknowledgement is sent without the lock."""
        keyframe = str(frame_id_from_proto(id))
        with tracing.span(f"update of {part}", keyframe=keyframe, task=context_id):
            self._fuse(part, id, context_id, fold)

    def _fuse(
        self, part: MapPart, id: pb.FrameId, context_id: str, fold: Callable[[], None]
    ) -> None:
        began = time.perf_counter()
        error: HeliosError | None = None
        try:
            fold()
        except HeliosError as refusal:
            error = refusal
        except Exception as fault:  # the sender must get an acknowledgement also after a fault
            log.exception("part %s of frame %d failed", part, id.seq)
            error = Internal(f"map2d failed ({type(fault).__name__}: {fault}); see its log")
        if error is None and self._keeping.note_map_change(searching=part is MapPart.VALUE):
            self._say()
        self._answer(part, id, context_id, error, (time.perf_counter() - began) * 1e3)

    def _answer(
        self,
        part: MapPart,
        id: pb.FrameId,
        context_id: str,
        error: HeliosError | None,
        update_ms: float,
    ) -> None:
        if error is None:
            self._health.count(f"{part}_accepted")
            self._health.sample(f"{part}_ms", update_ms)
        else:
            self._health.count(f"{part}_refused")
            log.warning("%s of frame %d refused: %s", part, id.seq, error.message)
        self._bus.publish(
            MAP2D_ACK,
            pb.Ack(
                service="map2d",
                part=part,
                id=id,
                accepted=error is None,
                reason="" if error is None else error.message,
                version=self._version(),
                update_ms=update_ms,
                context_id=context_id,
            ),
        )

    def _fresh(self, maps: EpochMaps) -> EpochMaps:
        if self._robot is not None:
            maps.set_robot_world(*self._robot)
        if self._context is not None:
            maps.reset_search(context_from_proto(self._context))
        return maps

    def _seek_stored(self) -> bool:
        """Seek the place of the map of an earlier process, if any; if the robot is in its world,
        go on with it. The lock is held. Returns True if a map goes on: then call
        `_keep_taken_up` without the lock."""
        if self._maps is None:
            return False
        sought = self._places.sought
        if sought is not None and sought.world == self._maps.robot_world:
            self._places.seek(None)
        if self._keeping.take_up_stored():
            return True
        stored = self._keeping.left_behind()
        if stored is None and self._places.sought is None:
            stored = self._keeping.stored(self._maps)
        if stored is not None and stored[1] != self._maps.robot_world:
            self._places.seek(Sought(*stored))
        return False

    def _keep_taken_up(self) -> None:
        """Save a stored map that goes on as the present one, then seek one that it replaced."""
        with self._lock:
            present = self._maps is not None and self._maps.world == self._maps.robot_world
        if present:
            self._keeping.taken_over()
            with self._lock:
                self._seek_stored()

    def _catch_up(self) -> None:
        """Fill the search's layers from the stored views of a new present map without values."""
        with self._lock:
            state = self._maps.current if self._maps is not None else None
            message = self._context
        if state is not None and message is not None and not any(state.published.layers.values()):
            self._recollection.fill(context_from_proto(message))

    def _say(self) -> None:
        """Update the health: problems with the robot's description or with saving the map, or the
        note on a restored map. Does nothing until all subscriptions exist."""
        if not self._listens:
            return
        if self._refused:
            self._health.degraded(self._refused)
        else:
            waits = self._maps is None
            notes = (self._keeping.health_note(), self._places.note())
            self._health.ready(
                "waits for the robot's description" if waits else "; ".join(filter(None, notes))
            )

    def _version(self) -> int:
        with self._lock:
            return 0 if self._maps is None else self._maps.version
