"""Loading of the driver: by name, by entry point, or from a user's `package:Class`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from helios_core.bus import Bus
from helios_core.errors import InvalidInput
from helios_core.plugins import ROBOTS, find, make
from helios_core.robot import RobotDriver

from helios_bridge.settings import Settings

NAMED = {
    "sim": "helios_sim.driver:SimDriver",
    "replay": "helios_replay.driver:ReplayDriver",
    "spot": "helios_spot.driver:SpotDriver",
    "ros2": "helios_ros2.driver:Ros2Driver",
    "push": "helios_bridge.pushed_frames:PushDriver",
    "bus": "helios_sim.driver:SimDriver",  # any process that serves `world/…`, in any language
}
OFFERED = (
    "source", "limit", "from_s", "to_s", "rate", "topics", "contexts", "address", "max_depth_m",
)  # fmt: skip


def load_driver(settings: Settings, bus: Bus) -> RobotDriver:
    """Driver that `settings.driver` names.

    Its constructor may have parameters named `bus`, the settings of a replay (`source`, `limit`,
    `from_s`, `to_s`, `rate`, `topics`, `contexts`), the `address` of a robot and `max_depth_m`; all
    others need defaults. Raises InvalidInput if it cannot be loaded or constructed.
    """
    named = find(ROBOTS, NAMED.get(settings.driver, settings.driver))
    if named is None:
        known = (*NAMED, *ROBOTS.entry_names())
        raise InvalidInput(
            f"driver {settings.driver!r} is not known; wanted one of {', '.join(known)} or "
            "package:Class of your own"
        )
    offered: dict[str, Any] = {"bus": bus} | {name: getattr(settings, name) for name in OFFERED}
    return make(ROBOTS, replace(named, spec=settings.driver), RobotDriver, offered)
