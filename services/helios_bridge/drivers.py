"""Which driver: by name, or `package:Class` of anybody's own."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

from helios_core.bus import Bus
from helios_core.errors import InvalidInput
from helios_core.robot import RobotDriver

from helios_bridge.settings import Settings

NAMED = {
    "sim": "helios_sim.driver:SimDriver",
    "replay": "helios_replay.driver:ReplayDriver",
    "spot": "helios_spot.driver:SpotDriver",
}


def load_driver(settings: Settings, bus: Bus) -> RobotDriver:
    """The driver that `settings.driver` names.

    Its constructor may ask by name for `bus` and for the settings of a replay (`source`, `limit`,
    `from_s`, `to_s`, `rate`, `topics`, `contexts`) and for the `address` of a robot; whatever else
    it needs it has defaults for.
    Raises InvalidInput when it cannot be imported or is no RobotDriver.
    """
    name = NAMED.get(settings.driver, settings.driver)
    module_name, _, class_name = name.partition(":")
    if not class_name:
        raise InvalidInput(
            f"driver {settings.driver!r} is not known; wanted one of {', '.join(NAMED)} or "
            "package:Class of your own"
        )
    try:
        cls = getattr(importlib.import_module(module_name), class_name)
    except (ImportError, AttributeError) as error:
        raise InvalidInput(
            f"driver {settings.driver!r} cannot be loaded ({error}); install what it needs"
        ) from error
    if not (isinstance(cls, type) and issubclass(cls, RobotDriver)):
        raise InvalidInput(f"{name} is no RobotDriver; subclass helios_core.robot.RobotDriver")
    offered: dict[str, Any] = {"bus": bus} | {
        name: getattr(settings, name)
        for name in ("source", "limit", "from_s", "to_s", "rate", "topics", "contexts", "address")
    }
    wanted = inspect.signature(cls).parameters
    return cls(**{k: v for k, v in offered.items() if k in wanted})
