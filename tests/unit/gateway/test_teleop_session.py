"""A teleoperation session in isolation: the moves that it sends when threads are scarce."""

from __future__ import annotations

import anyio
import pytest
from anyio import CapacityLimiter
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint
from helios_gateway.settings import Settings
from helios_gateway.teleop.driver import TeleopLease
from helios_gateway.teleop.pacing import Command
from helios_gateway.teleop.session import TeleopSession

from tests.gateway_backend import Backend


@pytest.mark.parametrize("then", [Command(), Command(forward=-1.0)], ids=["let go", "turned round"])
def test_a_command_that_changes_while_no_thread_is_free_causes_no_move(
    hub: MemoryHub, live: RobotMonitor, backend: Backend, then: Command
) -> None:
    driver = TeleopLease(RobotEndpoint(MemoryBus(hub), live), "", 5.0)
    settings = Settings.load(["--teleop-hold-s", "2"])

    async def drive() -> None:
        threads = CapacityLimiter(1)
        session = TeleopSession(driver, settings, threads)
        session.command(Command(forward=1.0))
        await session._step()
        assert driver.holds
        with anyio.fail_after(20):
            async with anyio.create_task_group() as group, threads:
                session.command(Command(forward=1.0))
                group.start_soon(session._step)
                while not threads.statistics().tasks_waiting:
                    await anyio.sleep(0.001)
                session.command(then)
        assert backend.driving.kinds() == []
        session.command(Command(turn=1.0))
        await session._step()
        assert backend.driving.kinds() == ["turn"]

    anyio.run(drive)
