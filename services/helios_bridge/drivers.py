"""Which driver: by name, or `package:Class` of anybody's own."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput
from helios_core.robot import RobotDriver

from helios_bridge.settings import Settings

NAMED = {
    "sim": "helios_sim.driver:SimDriver",
    "replay": "helios_replay.driver:ReplayDriver",
    "spot": "helios_spot.driver:SpotDriver",
    "push": "helios_bridge.push:PushDriver",
    "bus": "helios_sim.driver:SimDriver",  # whoever serves `world/…`, in whatever language
}
OFFERED = (
    "source", "limit", "from_s", "to_s", "rate", "topics", "contexts", "address", "max_depth_m",
)  # fmt: skip


def load_driver(settings: Settings, bus: Bus) -> RobotDriver:
    """The driver that `settings.driver` names.

    Its constructor may ask by name for `bus`, for the settings of a replay (`source`, `limit`,
    `from_s`, `to_s`, `rate`, `topics`, `contexts`), for the `address` of a robot and for
    `max_depth_m`; whatever else it needs it has defaults for.
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
    except Exception as error:  # importing runs anybody's code
        raise InvalidInput(
            f"driver {settings.driver!r} cannot be loaded ({type(error).__name__}: {error}); "
            "install what it needs, or start from the folder it is in"
        ) from error
    if not (isinstance(cls, type) and issubclass(cls, RobotDriver)):
        raise InvalidInput(f"{name} is no RobotDriver; subclass helios_core.robot.RobotDriver")
    offered: dict[str, Any] = {"bus": bus} | {name: getattr(settings, name) for name in OFFERED}
    wanted = inspect.signature(cls).parameters
    try:
        return cls(**{k: v for k, v in offered.items() if k in wanted})
    except HeliosError:
        raise
    except Exception as error:
        raise InvalidInput(
            f"driver {settings.driver!r} cannot be made ({type(error).__name__}: {error}); it "
            "needs every method of RobotDriver, and a default for every argument of its own"
        ) from error
