"""Access services of the fake Spot: login, directory, identity, clocks."""

from __future__ import annotations

from typing import Any

from tests.fake_spot import pb
from tests.fake_spot.world import World

TOKEN = "fake-user-token"
# service: (type, authority); the SDK looks for certificates of these authorities
SERVICES = {
    "auth": ("bosdyn.api.AuthService", "auth.spot.robot"),
    "directory": ("bosdyn.api.DirectoryService", "api.spot.robot"),
    "robot-id": ("bosdyn.api.RobotIdService", "id.spot.robot"),
    "time-sync": ("bosdyn.api.TimeSyncService", "timesync.spot.robot"),
    "lease": ("bosdyn.api.LeaseService", "lease.spot.robot"),
    "estop": ("bosdyn.api.EstopService", "estop.spot.robot"),
    "power": ("bosdyn.api.PowerService", "power.spot.robot"),
    "robot-state": ("bosdyn.api.RobotStateService", "state.spot.robot"),
    "image": ("bosdyn.api.ImageService", "api.spot.robot"),
    "robot-command": ("bosdyn.api.RobotCommandService", "command.spot.robot"),
    "manipulation": ("bosdyn.api.ManipulationApiService", "manipulation.spot.robot"),
}


class Auth(pb.servicer("AuthService")):
    def __init__(self, world: World, user: str, password: str) -> None:
        self._w, self._login = world, (user, password)

    def GetAuthToken(self, request: Any, _: Any) -> Any:
        reply = pb.auth.GetAuthTokenResponse()
        good = (request.username, request.password) == self._login or request.token == TOKEN
        reply.status = reply.STATUS_OK if good else reply.STATUS_INVALID_LOGIN
        if good:
            reply.token = TOKEN
        return pb.answer(reply, request, self._w.robot_ns)


class Directory(pb.servicer("DirectoryService")):
    def __init__(self, world: World, without: frozenset[str]) -> None:
        self._w = world
        self._services = {n: s for n, s in SERVICES.items() if n not in without}

    def ListServiceEntries(self, request: Any, _: Any) -> Any:
        entries = [self._entry(name) for name in self._services]
        reply = pb.directory.ListServiceEntriesResponse(service_entries=entries)
        return pb.answer(reply, request, self._w.robot_ns)

    def GetServiceEntry(self, request: Any, _: Any) -> Any:
        reply = pb.directory.GetServiceEntryResponse()
        if request.service_name in self._services:
            reply.status = reply.STATUS_OK
            reply.service_entry.CopyFrom(self._entry(request.service_name))
        else:
            reply.status = reply.STATUS_NONEXISTENT_SERVICE
        return pb.answer(reply, request, self._w.robot_ns)

    def _entry(self, name: str) -> Any:
        kind, authority = self._services[name]
        return pb.directory.ServiceEntry(
            name=name, type=kind, authority=authority, user_token_required=True
        )


class RobotId(pb.servicer("RobotIdService")):
    def __init__(self, world: World) -> None:
        self._w = world

    def GetRobotId(self, request: Any, _: Any) -> Any:
        reply = pb.robot_id.RobotIdResponse()
        id = reply.robot_id
        id.serial_number, id.species, id.version = "fake-BD-00000001", "spot", "V3"
        v = id.software_release.version
        v.major_version, v.minor_version, v.patch_level = 5, 2, 0
        return pb.answer(reply, request, self._w.robot_ns)


class TimeSync(pb.servicer("TimeSyncService")):
    """Uses the robot's clock. `ready` is False while the service is not ready."""

    ready = True

    def __init__(self, world: World) -> None:
        self._w = world

    def TimeSyncUpdate(self, request: Any, _: Any) -> Any:
        received = self._w.robot_ns
        reply = pb.time_sync.TimeSyncUpdateResponse()
        reply.clock_identifier = request.clock_identifier or "clock-1"
        state = reply.state
        state.status = state.STATUS_MORE_SAMPLES_NEEDED
        if not self.ready:
            state.status = state.STATUS_SERVICE_NOT_READY
        elif request.HasField("previous_round_trip"):
            p = request.previous_round_trip
            tx, srx, stx, rx = map(
                pb.util.timestamp_to_nsec, (p.client_tx, p.server_rx, p.server_tx, p.client_rx)
            )
            for estimate in (reply.previous_estimate, state.best_estimate):
                estimate.clock_skew.FromNanoseconds(((srx - tx) + (stx - rx)) // 2)
                estimate.round_trip_time.FromNanoseconds(max((rx - tx) - (stx - srx), 0))
            state.status = state.STATUS_OK
        pb.answer(reply, request, received)
        pb.util.set_timestamp_from_nsec(reply.header.response_timestamp, self._w.robot_ns)
        return reply
