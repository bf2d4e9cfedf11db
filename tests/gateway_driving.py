"""A fake bridge: grants the lease, executes moves, and blocks them where a test wants it."""

from __future__ import annotations

import threading

from helios_bridge.lease import Lease
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import transform_to_proto
from helios_core.errors import Conflict
from helios_core.geometry import se2_to_se3
from helios_core.topics import ACT, LEASE


class MadeUpDriving:
    """A fake bridge. `moves`: the requested actions, in order; `blocked`: the reason why forward
    moves fail; `gate`: while it is clear, no move finishes."""

    def __init__(self, bus: Bus) -> None:
        self.moves: list[pb.ActionRequest] = []
        self.blocked, self.stopped_why = "", ""
        self.x_m = self.yaw_rad = 0.0
        self.gate = threading.Event()
        self.gate.set()
        self.lease = Lease(10.0, 0)
        bus.serve(LEASE, self._lease)
        bus.serve(ACT, self._act)

    def kinds(self) -> list[str]:
        return [request.action.WhichOneof("kind") or "" for request in self.moves]

    def _lease(self, request: pb.LeaseRequest) -> pb.LeaseReply:
        if request.release_token:
            self.lease.release(request.release_token)
            return pb.LeaseReply()
        return pb.LeaseReply(token=self.lease.grant(request.holder, request.take))

    def _act(self, request: pb.ActionRequest) -> pb.ActionResult:
        self.lease.check(request.lease_token)
        if self.stopped_why:
            raise Conflict(f"the robot is stopped ({self.stopped_why}); clear the stop first")
        self.moves.append(request)
        self.gate.wait(20)
        action, out = request.action, pb.ActionResult(action_id=request.action_id, succeeded=True)
        if action.HasField("forward") and self.blocked:
            out.succeeded, out.reason = False, self.blocked
        elif action.HasField("forward"):
            self.x_m += action.forward.distance_m
            out.moved_m = abs(action.forward.distance_m)
        elif action.HasField("turn"):
            self.yaw_rad += action.turn.angle_rad
            out.turned_rad = action.turn.angle_rad
        T_world_base = se2_to_se3(self.x_m, 0.0, self.yaw_rad)
        out.T_world_base.CopyFrom(transform_to_proto(T_world_base))
        return out
