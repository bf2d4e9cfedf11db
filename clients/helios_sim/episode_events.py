"""What really happened in an episode, in order: the truth behind its failure causes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PickTried:
    """The robot reached for something. `name` is what it holds then; empty if nothing."""

    step: int  # number of the action, the first is 1
    path_m: float  # driven until then
    asked_class: str
    at_candidate: bool  # the point was on, or within a grasp of, a candidate of the task
    name: str = ""
    class_name: str = ""
    candidate: bool = False  # what it holds is a candidate
    reason: str = ""  # why it holds nothing, as the robot was told


@dataclass(frozen=True)
class PlaceTried:
    """The robot let go of what it held, or was refused to."""

    step: int
    path_m: float
    name: str
    class_name: str
    candidate: bool
    released: bool
    reason: str = ""  # why it was not released, as the robot was told
    at_rest: bool = False  # in the end
    on: tuple[str, ...] = ()  # bodies that it touched in the end
    met_goal: bool = False  # it touched a goal receptacle at some time
    placed: bool = False  # it rests on a goal receptacle
    on_floor: bool = False  # it touched the floor in the end
    height_m: float = 0.0  # of its middle

    @property
    def rolled_off(self) -> bool:
        """It met a goal receptacle and did not stay there."""
        return self.released and self.met_goal and not self.placed


@dataclass(frozen=True)
class Collided:
    """The robot touched what it must not touch, in one action."""

    step: int
    bodies: tuple[str, ...]


Event = PickTried | PlaceTried | Collided
