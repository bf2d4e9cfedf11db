"""Ground-truth events of an episode, from which its failure cause is derived."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PickTried:
    """Attempt to pick. `name` is the body held afterwards; empty if the pick failed."""

    step: int  # number of the action; the first is 1
    path_m: float  # distance driven before the attempt
    asked_class: str
    at_candidate: bool  # a candidate of the task was within grasp of the requested point
    name: str = ""
    class_name: str = ""
    candidate: bool = False  # the held body is a candidate
    reason: str = ""  # reason of the failure, as reported to the robot


@dataclass(frozen=True)
class PlaceTried:
    """Attempt to place the held object, successful or refused."""

    step: int
    path_m: float
    name: str
    class_name: str
    candidate: bool
    released: bool
    reason: str = ""  # reason of the refusal, as reported to the robot
    at_rest: bool = False  # at rest at the end
    on: tuple[str, ...] = ()  # bodies in contact at the end
    met_goal: bool = False  # touched a goal receptacle at any time
    placed: bool = False  # rests on a goal receptacle
    on_floor: bool = False  # in contact with the floor at the end
    height_m: float = 0.0  # of the object's centre

    @property
    def rolled_off(self) -> bool:
        """True if the object touched a goal receptacle but did not stay on it."""
        return self.released and self.met_goal and not self.placed


@dataclass(frozen=True)
class Collided:
    """Collisions of the robot in one action."""

    step: int
    bodies: tuple[str, ...]


Event = PickTried | PlaceTried | Collided
