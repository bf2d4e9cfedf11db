"""Which driver: by name, by an entry point, or `package:Class` of anybody's own."""

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
    "push": "helios_bridge.pushed_frames:PushDriver",
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
    Raises InvalidInput when it cannot be loaded or made.
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
