"""A fake Spot with a driver for the tests."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from helios_core.bus import Bus
from helios_core.robot import Action, ActionResult
from helios_spot import bosdyn_api
from helios_spot.driver import SpotDriver
from helios_spot.settings import SpotSettings
from pydantic import SecretStr

from tests.fake_spot.rooms import tea_room
from tests.fake_spot.server import PASSWORD, USER, FakeSpot
from tests.fake_spot.world import World
from tests.support import wait_until

PATIENT_S = 15.0  # for answers that arrive; they may take seconds on a busy machine
HASTY_S = 1.0  # for answers that never arrive, so that no test waits long


class Stage:
    """A fake Spot and its drivers, closed together. `hurry` multiplies the walking speed."""

    def __init__(self, folder: Path, hurry: float = 8.0, skew_s: float = 0.0, **fake: Any) -> None:
        self.fake = FakeSpot(folder, World(*tea_room(), hurry=hurry, skew_s=skew_s), **fake)
        self.world = self.fake.world
        self._drivers: list[SpotDriver] = []
        self._number = 0

    def settings(self, **more: Any) -> SpotSettings:
        values = {
            "host": "127.0.0.1",
            "port": self.fake.port,
            "ca_file": self.fake.ca_file,
            "username": USER,
            "password": SecretStr(PASSWORD),
            "rpc_timeout_s": PATIENT_S,
            "command_s": 2.0,
            "blocked_s": 10.0,
            **more,
        }
        return SpotSettings(**values)

    def driver(self, bus: Bus | None = None, connect: bool = True, **settings: Any) -> SpotDriver:
        out = SpotDriver(bus, settings=self.settings(**settings))
        self._drivers.append(out)
        if connect:
            out.describe()
        return out

    def cut(self, driver: SpotDriver) -> None:
        """Drop all answers. The driver times out soon, so that no test waits long."""
        asked = self.fake.commands.asked
        self._wait_for_answers(driver, HASTY_S)
        # A walk may still wait with the long timeout for an earlier request; let it get the answer.
        wait_until(
            lambda: self.fake.commands.asked >= asked + 2 or not self.world.moving,
            60,
            "the walk asks anew",
        )
        self.fake.wire.cut()

    def mend(self, driver: SpotDriver) -> None:
        """Let answers arrive again, with the timeout for a busy machine."""
        self.fake.wire.mend()
        self._wait_for_answers(driver, PATIENT_S)

    def _wait_for_answers(self, driver: SpotDriver, seconds: float) -> None:
        bosdyn_api.channel_common.DEFAULT_RPC_TIMEOUT = seconds
        object.__setattr__(driver._s, "rpc_timeout_s", seconds)  # bypasses the frozen settings
        if driver._control._estop is not None:
            driver._control._estop._rpc_timeout = seconds

    def act(self, driver: SpotDriver, action: Action) -> ActionResult:
        """Run an action under a new id."""
        self._number += 1
        return driver.act(action, f"action-{self._number}")

    def during(self, driver: SpotDriver, action: Action, do: Callable[[], object]) -> Outcome:
        """Begin an action in a thread and call `do` once the robot moves; the pending outcome."""
        out = Outcome(self, driver, action)
        wait_until(lambda: self.world.moving, 60, "the robot moves")
        do()
        return out

    def standing_still(self) -> bool:
        with self.world.lock:
            return not self.world.moving

    def close(self) -> None:
        self.fake.wire.mend()
        for driver in self._drivers:
            driver.close()
        self.fake.close()


class Outcome:
    """The result or error of an action in a thread."""

    def __init__(self, stage: Stage, driver: SpotDriver, action: Action) -> None:
        self.result: ActionResult | None = None
        self.error: Exception | None = None

        def run() -> None:
            try:
                self.result = stage.act(driver, action)
            except Exception as error:
                self.error = error

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def wait(self, within_s: float = 20.0) -> Outcome:
        self._thread.join(within_s)
        assert not self._thread.is_alive(), f"the action hung for {within_s:g} s"
        return self
