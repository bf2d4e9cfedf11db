"""Services of the fake Spot for the right to move: lease, e-stop, power."""

from __future__ import annotations

import math
import time
from typing import Any

from tests.fake_spot import pb
from tests.fake_spot.world import World


class Leases(pb.servicer("LeaseService")):
    """Leases of one resource, the body. The lease with the newest root sequence drives."""

    def __init__(self, world: World) -> None:
        self._w = world
        self._number = 0
        self._boots = 1
        self._newest: Any = None

    def use(self, lease: Any, result: Any) -> bool:
        """Whether a request may act; fills the LeaseUseResult as the robot does."""
        with self._w.lock:
            result.attempted_lease.CopyFrom(lease)
            result.owner.client_name = self._w.lease_owner
            if self._newest is None or not lease.resource or not self._w.lease_owner:
                result.status = result.STATUS_INVALID_LEASE
                return False
            result.latest_known_lease.CopyFrom(self._newest)
            # Keep-alive and commands may overtake each other, so only the root counts.
            good = list(lease.sequence[:1]) == list(self._newest.sequence[:1])
            result.status = result.STATUS_OK if good else result.STATUS_OLDER
            return good

    def AcquireLease(self, request: Any, _: Any) -> Any:
        reply = pb.lease.AcquireLeaseResponse()
        with self._w.lock:
            if self._w.lease_owner and not self._w.lease_is_stale:
                reply.status = reply.STATUS_RESOURCE_ALREADY_CLAIMED
                reply.lease_owner.client_name = self._w.lease_owner
            else:
                self._grant(reply, request.header.client_name)
        return pb.answer(reply, request, self._w.robot_ns)

    def TakeLease(self, request: Any, _: Any) -> Any:
        reply = pb.lease.TakeLeaseResponse()
        with self._w.lock:
            self._w.halt("the lease was taken")
            self._grant(reply, request.header.client_name)
        return pb.answer(reply, request, self._w.robot_ns)

    def RetainLease(self, request: Any, _: Any) -> Any:
        reply = pb.lease.RetainLeaseResponse()
        if self.use(request.lease, reply.lease_use_result):
            self._w.retained_s = time.monotonic()
        return pb.answer(reply, request, self._w.robot_ns)

    def ReturnLease(self, request: Any, _: Any) -> Any:
        reply = pb.lease.ReturnLeaseResponse()
        with self._w.lock:
            good = self.use(request.lease, pb.lease.LeaseUseResult())
            reply.status = reply.STATUS_OK if good else reply.STATUS_NOT_ACTIVE_LEASE
            if good:
                self._w.halt("the lease was returned")
                self._w.lease_owner = ""
        return pb.answer(reply, request, self._w.robot_ns)

    def ListLeases(self, request: Any, _: Any) -> Any:
        reply = pb.lease.ListLeasesResponse()
        entry = reply.resources.add(resource="body")
        entry.lease.resource, entry.lease.epoch = "body", self._epoch
        entry.lease_owner.client_name = self._w.lease_owner
        return pb.answer(reply, request, self._w.robot_ns)

    def give_to(self, owner: str) -> None:
        """Another client takes the lease, as the tablet does."""
        with self._w.lock:
            self._w.halt("the lease was taken")
            self._grant(pb.lease.TakeLeaseResponse(), owner)
            self._w.retained_s = math.inf  # a tablet keeps the lease

    def free(self) -> None:
        """The other client releases the lease."""
        with self._w.lock:
            self._w.lease_owner = ""

    def reboot(self) -> None:
        """The robot restarts: it sits, nobody holds a lease, and new leases have a new epoch."""
        with self._w.lock:
            self._w.halt("a reboot")
            self._w.motors = self._w.standing = False
            self._w.lease_owner, self._newest = "", None
            self._boots += 1

    @property
    def _epoch(self) -> str:
        return f"fake-boot-{self._boots}"

    def _grant(self, reply: Any, owner: str) -> None:
        self._number += 1
        self._newest = pb.lease.Lease(
            resource="body", epoch=self._epoch, sequence=[self._number], client_names=["root"]
        )
        self._w.lease_owner, self._w.retained_s = owner, time.monotonic()
        reply.status = reply.STATUS_OK
        reply.lease.CopyFrom(self._newest)
        reply.lease_owner.client_name = owner


class Estop(pb.servicer("EstopService")):
    """An endpoint that checks in releases the e-stop "software"; silence presses it again. Other
    e-stops are pressed by hand."""

    def __init__(self, world: World) -> None:
        self._w = world
        self._config = pb.estop.EstopConfig(unique_id="config-0")
        self._challenge = 7

    def GetEstopConfig(self, request: Any, _: Any) -> Any:
        reply = pb.estop.GetEstopConfigResponse()
        reply.active_config.CopyFrom(self._config)
        return pb.answer(reply, request, self._w.robot_ns)

    def SetEstopConfig(self, request: Any, _: Any) -> Any:
        reply = pb.estop.SetEstopConfigResponse()
        if self._w.motors:
            reply.status = reply.STATUS_MOTORS_ON
            reply.active_config.CopyFrom(self._config)
            return pb.answer(reply, request, self._w.robot_ns)
        self._config.CopyFrom(request.config)
        self._config.unique_id = "config-1"
        for i, endpoint in enumerate(self._config.endpoints):
            endpoint.unique_id = str(i)
        reply.active_config.CopyFrom(self._config)
        reply.status = reply.STATUS_SUCCESS
        with self._w.lock:
            self._w.estops.add("software")  # until the endpoint checks in
            self._w.estop_due_s = math.inf
        return pb.answer(reply, request, self._w.robot_ns)

    def RegisterEstopEndpoint(self, request: Any, _: Any) -> Any:
        reply = pb.estop.RegisterEstopEndpointResponse()
        reply.new_endpoint.CopyFrom(request.new_endpoint)
        reply.new_endpoint.unique_id = "0"
        reply.status = reply.STATUS_SUCCESS
        return pb.answer(reply, request, self._w.robot_ns)

    def DeregisterEstopEndpoint(self, request: Any, _: Any) -> Any:
        reply = pb.estop.DeregisterEstopEndpointResponse()
        reply.status = reply.STATUS_SUCCESS
        return pb.answer(reply, request, self._w.robot_ns)

    def EstopCheckIn(self, request: Any, _: Any) -> Any:
        reply = pb.estop.EstopCheckInResponse()
        inverted = ~request.challenge & 0xFFFFFFFFFFFFFFFF
        good = request.challenge == self._challenge and request.response == inverted
        reply.status = reply.STATUS_OK if good else reply.STATUS_INCORRECT_CHALLENGE_RESPONSE
        known = [e for e in self._config.endpoints if e.name == request.endpoint.name]
        if not known:
            good, reply.status = False, reply.STATUS_ENDPOINT_UNKNOWN
        self._challenge += 13
        reply.challenge = self._challenge
        with self._w.lock:
            if good:
                self._w.estop_due_s = time.monotonic() + known[0].timeout.ToNanoseconds() / 1e9
            if good and request.stop_level == pb.estop.ESTOP_LEVEL_NONE:
                self._w.estops.discard("software")
            elif good:
                self._w.estops.add("software")
                self._w.motors = False
                self._w.halt("e-stop")
        return pb.answer(reply, request, self._w.robot_ns)

    def replace(self, name: str) -> None:
        """Another client sets up its own e-stop and holds it released."""
        with self._w.lock:
            del self._config.endpoints[:]
            self._config.endpoints.add(name=name, unique_id="0")
            self._w.estop_due_s = math.inf

    def GetEstopSystemStatus(self, request: Any, _: Any) -> Any:
        reply = pb.estop.GetEstopSystemStatusResponse()
        pressed = bool(self._w.estops)
        reply.status.stop_level = pb.estop.ESTOP_LEVEL_CUT if pressed else pb.estop.ESTOP_LEVEL_NONE
        return pb.answer(reply, request, self._w.robot_ns)


class Power(pb.servicer("PowerService")):
    def __init__(self, world: World, leases: Leases) -> None:
        self._w, self._leases = world, leases

    def PowerCommand(self, request: Any, _: Any) -> Any:
        reply = pb.power.PowerCommandResponse(
            license_status=pb.license.LicenseInfo.STATUS_VALID, power_command_id=1
        )
        w = self._w
        with w.lock:
            if self._leases.use(request.lease, reply.lease_use_result):
                on = request.request == pb.power.PowerCommandRequest.REQUEST_ON_MOTORS
                if on and w.power_refusal:
                    reply.status = pb.power.PowerCommandStatus.Value(w.power_refusal)
                elif on and w.estops:
                    reply.status = pb.power.STATUS_ESTOPPED
                else:
                    w.motors, reply.status = on, pb.power.STATUS_SUCCESS
        return pb.answer(reply, request, w.robot_ns)

    def PowerCommandFeedback(self, request: Any, _: Any) -> Any:
        reply = pb.power.PowerCommandFeedbackResponse(status=pb.power.STATUS_SUCCESS)
        return pb.answer(reply, request, self._w.robot_ns)
