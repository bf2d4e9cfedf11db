"""Processes of several robots on one machine: one router, one gateway, and services per robot."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from helios_client.supervision.child_process import ProcessSpec
from helios_client.supervision.service_specs import NEEDED, StackOptions

OF_A_SIMULATOR = ("simulated", "ground-truth")  # detectors and scorers that know one world


@dataclass(frozen=True)
class FleetOptions(StackOptions):
    """Options of several robots. Robot number k has the home of seed `seed` + k.

    A row that belongs to one robot is called ROBOT/SERVICE. The router, the gateway, and a detector
    that uses models serve all robots.
    """

    robots: tuple[str, ...] = ()  # names of the robots; the first one is `name`

    @property
    def robot_names(self) -> tuple[str, ...]:
        return self.robots

    @property
    def shared(self) -> tuple[str, ...]:
        """Services of which one process serves all robots."""
        scorer = (self.scorer or "").partition(":")[0]
        detector = () if {self.detector, scorer} & set(OF_A_SIMULATOR) else ("detector",)
        return ("router", "gateway", *detector)

    def processes(self) -> tuple[ProcessSpec, ...]:
        of_all = [
            replace(spec, argv=(*spec.argv, *self._more_robots(spec.name)))
            for spec in super().processes()
            if spec.name in self.shared
        ]
        own = [
            replace(spec, name=f"{robot}/{spec.name}")
            for number, robot in enumerate(self.robots)
            for spec in self._alone(number, robot).processes()
            if spec.name not in self.shared
        ]
        return (*of_all, *own)

    def elsewhere(self) -> tuple[str, ...]:
        return tuple(
            f"{robot}/{service}"
            for robot in self.robots
            for service in NEEDED
            if self._is_elsewhere(service)
        )

    def _more_robots(self, service: str) -> tuple[str, ...]:
        """Flag with the names of the robots that a shared service serves."""
        names = {"gateway": self.robots[1:], "detector": self.robots}.get(service, ())
        return ("--robots", ",".join(names)) if names else ()

    def _alone(self, number: int, robot: str) -> StackOptions:
        """Options of one robot, with a state folder of its own."""
        values = {name: getattr(self, name) for name in StackOptions.__dataclass_fields__}
        values |= {
            "name": robot,
            "seed": self.seed + number,
            "state_dir": self.state_dir / "robots" / robot,
            "ros2_node": re.sub(r"\W", "_", f"helios_{robot}", flags=re.ASCII),
        }
        if self.record is not None:
            values["record"] = self.record / robot
        return StackOptions(**values)
