"""Methods `bridge/stop` and `bridge/clear_stop`, served before the driver can describe its robot.

A robot whose camera is silent may still move, so its stop must not wait for the rest of the bridge.
"""

from __future__ import annotations

import logging

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.robot import RobotDriver
from helios_core.topics import CLEAR_STOP, STOP

from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.driver_executor import DriverExecutor
from helios_bridge.driver_guard import GuardedDriver
from helios_bridge.robot_stop import RobotStop
from helios_bridge.settings import Settings
from helios_bridge.stop_latch import StopLatch

log = logging.getLogger(__name__)

KEEPS_ITS_STOP = ("sim", "bus", "replay", "push")  # drivers of another process, or that never move


class StopService:
    """Stop of one driver on the bus, and what the rest of the bridge shares with it: the guarded
    driver, the health and the executor."""

    def __init__(
        self,
        bus: Bus,
        driver: RobotDriver,
        settings: Settings,
        health: Health,
        executor: DriverExecutor,
    ) -> None:
        self.executor, self.health = executor, BridgeHealth(health)
        self.driver = GuardedDriver(driver, self.health)
        if settings.state_dir is None and settings.driver not in KEEPS_ITS_STOP:
            log.warning(
                "a stop ends with this process, unless the robot keeps it itself; start the bridge "
                "with --state-dir FOLDER to keep it over restarts"
            )
        latch = StopLatch(settings.state_dir, executor)
        self.robot_stop = RobotStop(
            self.driver, latch, executor, self.health, settings.stop_timeout_s
        )
        bus.serve(STOP, self._stop)
        bus.serve(CLEAR_STOP, self._clear)

    def _stop(self, request: pb.StopRequest) -> pb.Empty:
        """Stop the robot, as `RobotStop.stop`."""
        self.robot_stop.stop(request.reason or "stop-now")
        return pb.Empty()

    def _clear(self, _: pb.Empty) -> pb.Empty:
        """Clear the stop, as `RobotStop.clear`."""
        self.robot_stop.clear()
        return pb.Empty()
