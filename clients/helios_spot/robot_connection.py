"""Connection to the robot: login, clock synchronisation, service clients, calls with time-outs."""

from __future__ import annotations

import logging
import threading
import time
from typing import Any

from helios_core.errors import Unavailable

from helios_spot import bosdyn_api
from helios_spot.errors import doing, translate
from helios_spot.robot_state import Reading, reading_of
from helios_spot.settings import SpotSettings

log = logging.getLogger(__name__)

CLIENT_NAME = "helios"
CLOSE_WITHIN_S = 1.5
RECONNECT_MS = 1000  # gRPC's default of up to two minutes delays the reconnection too long
CLOCK_SLACK_S = 2.0  # tolerated change of the clock offset since the last comparison


class RobotConnection:
    """Connection to one robot. Thread-safe once connected. Every call raises HeliosError on failure
    and ends within its time-out."""

    def __init__(self, settings: SpotSettings) -> None:
        self.settings = settings
        self.host = settings.host
        self._login = settings.login()
        self._robot: Any = None
        self.boot_id = ""
        self.epoch = ""  # epoch of its leases, new at every boot; empty if not reported
        self.services: frozenset[str] = frozenset()  # names of the services that it offers

    @property
    def connected(self) -> bool:
        return self._robot is not None

    def connect(self) -> None:
        """Log in and synchronise the clocks. The robot does not move. Callable again on failure."""
        s = self.settings
        # The SDK's default time-out is half a minute, and some calls have none: too long for a
        # walking robot.
        bosdyn_api.channel_common.DEFAULT_RPC_TIMEOUT = s.rpc_timeout_s
        sdk = bosdyn_api.client.create_standard_sdk(
            CLIENT_NAME, cert_resource_glob=str(s.ca_file) if s.ca_file else None
        )
        robot = sdk.create_robot(s.host)
        robot.update_secure_channel_port(s.port)
        _reconnect_soon(robot)
        try:
            with doing("log in", s.host):
                robot.authenticate(*self._login, timeout=s.rpc_timeout_s)
            with doing("read the robot's clock", s.host):
                robot.time_sync.wait_for_sync(timeout_sec=s.time_sync_s)
            with doing("ask who it is", s.host):
                serial = robot.get_cached_robot_id(timeout=s.rpc_timeout_s).serial_number
                leases = robot.ensure_client("lease").list_leases(timeout=s.rpc_timeout_s)
                services = robot.ensure_client("directory").list(timeout=s.rpc_timeout_s)
        except BaseException:
            _close(robot)
            raise
        self.services = frozenset(service.name for service in services)
        self.epoch = next((r.lease.epoch for r in leases if r.resource == "body"), "")
        self.boot_id = "-".join(filter(None, (serial, self.epoch)))
        self._robot = robot

    def client(self, name: str) -> Any:
        """The client of a service. Raises Unavailable before `connect`."""
        with doing(f"find the service {name}", self.host):
            return self.robot.ensure_client(name)

    @property
    def robot(self) -> Any:
        if self._robot is None:
            raise Unavailable(f"the robot at {self.host} is not connected yet; wait")
        return self._robot

    def read(self) -> Reading:
        """The robot's state now. Raises Unavailable when its clock has jumped, since the end times
        of commands would be wrong."""
        before_s = time.time()
        with doing("read the robot's state", self.host):
            state = self.client("robot-state").get_robot_state(timeout=self.settings.rpc_timeout_s)
            skew_s = self.robot.time_sync.endpoint.clock_skew.ToNanoseconds() / 1e9
        stamp_s = state.kinematic_state.acquisition_timestamp.ToNanoseconds() / 1e9
        robot_s = stamp_s - skew_s
        off_s = robot_s - min(max(robot_s, before_s), time.time())  # 0 between request and response
        if stamp_s and abs(off_s) > CLOCK_SLACK_S:
            self._compare_clocks()
            raise Unavailable(
                f"the robot's clock or ours has jumped by {off_s:.0f} s; they are compared anew, "
                "send the action again"
            )
        return reading_of(state)

    def command(self, command: Any, what: str, end_s: float | None = None) -> int:
        """Send a robot command; return its id. end_s: time until the motion expires."""
        end = None if end_s is None else time.time() + end_s
        try:
            return self.client("robot-command").robot_command(
                command, end_time_secs=end, timeout=self.settings.rpc_timeout_s
            )
        except bosdyn_api.robot_command.ExpiredError as error:
            self._compare_clocks()
            raise translate(error, self.host, what) from error
        except (bosdyn_api.exceptions.Error, bosdyn_api.lease.Error) as error:
            raise translate(error, self.host, what) from error

    def feedback(self, command_id: int, what: str) -> Any:
        """The feedback on a robot command."""
        with doing(what, self.host):
            client = self.client("robot-command")
            return client.robot_command_feedback(
                command_id, timeout=self.settings.rpc_timeout_s
            ).feedback

    def close(self) -> None:
        """Close the connection."""
        robot, self._robot = self._robot, None
        if robot is not None:
            _close(robot)

    def _compare_clocks(self) -> None:
        try:
            for _ in range(2):  # each exchange reports the result of the previous one
                self.robot.time_sync.endpoint.get_new_estimate()
        except Exception as error:  # the caller raises the command's own error
            log.warning("the clocks could not be compared: %s", error)


def _reconnect_soon(robot: Any) -> None:
    """Limit each channel's reconnect delay to `RECONNECT_MS`; the SDK has no setting for it."""
    ensure = robot.ensure_secure_channel
    wanted = [
        ("grpc.initial_reconnect_backoff_ms", RECONNECT_MS),
        ("grpc.max_reconnect_backoff_ms", RECONNECT_MS),
    ]
    robot.ensure_secure_channel = lambda authority, options=(): ensure(
        authority, options=[*options, *wanted]
    )


def _close(robot: Any) -> None:
    """Shut the SDK down in a thread, because it joins threads that may wait for the network."""

    def close() -> None:
        robot._shutdown()
        robot.shutdown()

    thread = threading.Thread(target=close, name="close link", daemon=True)
    thread.start()
    thread.join(CLOSE_WITHIN_S)
