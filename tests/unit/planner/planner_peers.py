"""Fakes of the other services: one FakeWorld behind a MemoryBus."""

from __future__ import annotations

import threading
import zlib

import numpy as np
from helios_core import proto as pb
from helios_core.codec import (
    action_from_proto,
    description_to_proto,
    frame_id_to_proto,
    object_to_proto,
    observation_to_proto,
    result_to_proto,
    state_to_proto,
    transform_from_proto,
    transform_to_proto,
)
from helios_core.errors import Conflict
from helios_core.geometry import Pinhole
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import (
    ACT,
    CONTEXT,
    GET_STATE,
    HELD_OBJECT,
    LEASE,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBJECTS,
    OBSERVATION,
    RETIRE,
    ROBOT_DESCRIPTION,
    SNAPSHOT,
    VOCABULARY,
    WHAT_IF,
)
from helios_core.types import Detection, Frame, FrameId, Observation, RobotState
from helios_planner.robot.detections import Sighting
from planner_world import FakeWorld

SIZE = (400, 480)  # of the images, [h, w]
CAMERA = Pinhole(fx=200.0, fy=200.0, cx=240.0, cy=200.0, width=480, height=400)
BELOW_M = 4.0  # a camera under the floor that looks up sees the whole flat, 2 cm per pixel


def observation(id: FrameId, context_id: str, sightings: list[Sighting]) -> Observation:
    """Make an observation whose masks, lifted with its depth, are these sightings."""
    T_world_cam = np.eye(4)
    T_world_cam[:3, 3] = [4.5, 3.5, -BELOW_M]
    depth_m = np.zeros(SIZE, np.float32)
    detections = []
    for s in sightings:
        x, y, z = s.center_m - T_world_cam[:3, 3]
        u, v = round(x / z * CAMERA.fx + CAMERA.cx), round(y / z * CAMERA.fy + CAMERA.cy)
        mask = np.zeros(SIZE, bool)
        half = np.maximum(np.rint(s.size_m[:2] / 2 * CAMERA.fx / z).astype(int), 3)
        box = (u - half[0], v - half[1], u + half[0] + 1, v + half[1] + 1)
        mask[box[1] : box[3], box[0] : box[2]] = True
        depth_m[mask] = z
        detections.append(Detection(s.class_name, s.confidence, box, mask))
    frame = Frame(
        id, 1, True, np.zeros((*SIZE, 3), np.uint8), depth_m, CAMERA, T_world_cam, np.eye(4)
    )
    return Observation(frame, context_id, tuple(detections), {}, "fake")


class Peers:
    """Fake bridge, detector, objectmap and map2d. `gate`: an event that every action waits for;
    `silent`: parts of a keyframe that are not acknowledged; `refusing`: reasons of refusals, by
    part."""

    def __init__(
        self, hub: MemoryHub, world: FakeWorld, names: tuple[str, ...] = (), robot: str = "robot"
    ) -> None:
        self.world, self.bus = world, MemoryBus(hub, robot)
        self.boot, self.contexts = "boot", list[str]()  # context ids, without repeats in a row
        self.world_epoch = 1  # changes after a jump of the localisation
        self.names = names
        self.context = pb.SearchContext()
        self.token, self.seq, self.stopped = 0, 0, False
        self.released = 0  # the newest lease that was released
        self.done: dict[str, pb.ActionResult] = {}
        self.silent: set[str] = set()
        self.refusing: dict[str, str] = {}
        self._reported = 0
        self.blank_maps = 0  # number of snapshots without a map that still come
        self.gate: threading.Event | None = None
        self.acting = threading.Event()
        bus = self.bus
        bus.subscribe(CONTEXT, self._on_context)
        bus.serve(LEASE, self._lease)
        bus.serve(ACT, self._act)
        bus.serve(GET_STATE, lambda _: state_to_proto(self._state()))
        bus.serve(SNAPSHOT, self._snapshot)
        bus.serve(OBJECTS, self._objects)
        bus.serve(WHAT_IF, self._what_if)
        bus.serve(RETIRE, self._retire)
        bus.serve(HELD_OBJECT, self._held_object)
        bus.serve(
            VOCABULARY,
            lambda _: pb.VocabularyReply(open=not self.names, names=self.names, detector="fake"),
        )
        bus.publish(ROBOT_DESCRIPTION, description_to_proto(world.description))

    def _on_context(self, context: pb.SearchContext) -> None:
        self.context = context
        if self.contexts[-1:] != [context.id]:
            self.contexts.append(context.id)

    def _lease(self, request: pb.LeaseRequest) -> pb.LeaseReply:
        if request.release_token:
            self.released = request.release_token
            return pb.LeaseReply()
        self.token += 1
        return pb.LeaseReply(token=self.token, duration_s=30)

    def _state(self) -> RobotState:
        w = self.world
        return RobotState(
            w.pose().T_world_base,
            w.tilt_rad(),
            w.held(),
            stopped=self.stopped,
            robot_boot_id=self.boot,
            world_epoch=self.world_epoch,
            message="a person" if self.stopped else "",
            last_action_id=next(reversed(self.done), ""),
        )

    def _act(self, request: pb.ActionRequest) -> pb.ActionResult:
        if request.action_id in self.done:
            return self.done[request.action_id]
        if request.lease_token != self.token:
            raise Conflict("an older lease")
        if self.stopped:
            raise Conflict("the robot is stopped; clear the stop first")
        self.acting.set()
        if self.gate is not None:
            self.gate.wait(5)
        out = result_to_proto(self.world.act(action_from_proto(request.action)), request.action_id)
        self.seq += 1
        id = FrameId(self.boot, self.world_epoch, self.seq)
        out.keyframe.CopyFrom(frame_id_to_proto(id))
        out.T_world_base.CopyFrom(transform_to_proto(self.world.pose().T_world_base))
        self.done[request.action_id] = out
        if "detections" not in self.silent:
            self._observe()
        for part, topic in (
            ("occupancy", MAP2D_ACK),
            ("value", MAP2D_ACK),
            ("objects", OBJECTMAP_ACK),
        ):
            if part not in self.silent:
                reason = self.refusing.get(part, "")
                ack = pb.Ack(
                    part=part,
                    id=out.keyframe,
                    accepted=not reason,
                    reason=reason,
                    context_id=self.context.id,
                )
                self.bus.publish(topic, ack)
        return out

    def _observe(self) -> None:
        seen = self.world.sightings()
        news, self._reported = seen[self._reported :], len(seen)
        id = FrameId(self.boot, self.world_epoch, self.seq)
        reported = observation(id, self.context.id, news)
        self.bus.publish(OBSERVATION, observation_to_proto(reported))

    def _snapshot(self, request: pb.SnapshotRequest) -> pb.MapSnapshot:
        if self.blank_maps:
            self.blank_maps -= 1
            return pb.MapSnapshot()
        ground = self.world.ground()
        top = np.rint(ground.top_m * 1000).astype("<u2")
        rows, columns = ground.occupancy.shape
        return pb.MapSnapshot(
            version=ground.version, cell_m=ground.cell_m, width=columns, height=rows,
            occupancy=zlib.compress(ground.occupancy.tobytes(), 1),
            top_mm=zlib.compress(top.tobytes(), 1),
            frontiers=[pb.Frontier(id=f.id, x_m=f.xy_m[0], y_m=f.xy_m[1], size_m=f.size_m,
                                   values=f.values, reachable=True)
                       for f in self.world.frontiers()],
            trajectory_m=self.world.start() or (),
        )  # fmt: skip

    def _objects(self, request: pb.ObjectsRequest) -> pb.ObjectsReply:
        asked = {c.name for c in self.context.classes} & set(request.class_names)
        found = [o for name in sorted(asked) for o in self.world.objects(name)]
        return pb.ObjectsReply(objects=[object_to_proto(o) for o in found])

    def _what_if(self, request: pb.WhatIfRequest) -> pb.WhatIfReply:
        poses = [transform_from_proto(T, "T_world_cam") for T in request.T_world_cam]
        other = request.other_share if request.HasField("other_share") else None
        out = self.world.what_if(request.object_id, request.class_name, poses, request.joint, other)
        return pb.WhatIfReply(
            score=out.scores,
            information_gain=out.gains_nats,
            pixels=out.pixels,
            area_m2=out.area_m2,
        )

    def _held_object(self, request: pb.HeldObjectRequest) -> pb.HeldObjectReply:
        held = self.world.held_object(request.class_name)
        names = [pb.NameShare(name=name, share=share) for name, share in held.names]
        return pb.HeldObjectReply(probability=held.probability, sides=held.sides, names=names)

    def _retire(self, request: pb.RetireRequest) -> pb.RetireReply:
        self.world.retire(request.object_id, np.zeros(3), request.reason)
        return pb.RetireReply(retired_gaussians=1)
