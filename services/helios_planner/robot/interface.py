"""Interface of a mission to the robot and its maps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from helios_core.geometry import Matrix
from helios_core.robot import Action, ActionResult
from helios_core.types import AlignedBox, ObjectInstance, RobotDescription
from numpy.typing import NDArray

from helios_planner.decisions.decision import Decision
from helios_planner.decisions.held_object import HeldObject
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.robot.detections import Sighting
from helios_planner.task import Phase


@dataclass(frozen=True)
class Frontier:
    """Border between floor that this search has explored and floor that it has not;
    values by layer."""

    id: int
    xy_m: tuple[float, float]
    size_m: float
    values: dict[str, float]


@dataclass(frozen=True)
class WhatIf:
    """Expected effect of views: Psi' and information gain in nats, per pose, or one if joint.

    pixels: number of pixels that show the instance, parallel to the gains; area_m2: surface of the
    instance seen so far. An older object map reports neither.
    """

    scores: tuple[float, ...]
    gains_nats: tuple[float, ...]
    pixels: tuple[float, ...] = ()
    area_m2: float = 0.0


class ProgressListener(Protocol):
    """Receives the progress of a mission, without influence on it."""

    def on_phase(self, phase: Phase, seeking: str, message: str) -> None:
        """Publish what the task does now."""

    def on_decision(self, decision: Decision) -> None:
        """Store and publish a decision."""

    def on_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None:
        """Publish the route [n, 2] being driven; empty when the robot stands."""

    def on_picks(self, picks: int) -> None:
        """Publish the number of picks so far."""


def _ignored(action: Action, result: ActionResult) -> None:
    """Do nothing with a result."""


class RobotInterface(ABC):
    """The robot and its maps. Every method may raise TaskFailed or TaskCancelled."""

    description: RobotDescription
    listener: ProgressListener
    cut_short: bool = False  # True if a stop ended the last action early
    # Receives each action with its result, before a keyframe that a map lost is taken again.
    on_result: Callable[[Action, ActionResult], None] = staticmethod(_ignored)

    @abstractmethod
    def act(self, action: Action) -> ActionResult:
        """Perform an action; returns when every map holds the keyframe taken after it."""

    @abstractmethod
    def budget_used(self) -> float:
        """Used share [0, 1] of the task's steps."""

    def detector_trouble(self) -> str:
        """Faults of the detector during the task, as the end of a sentence; empty without any."""
        return ""

    @abstractmethod
    def pose(self) -> Pose2:
        """Pose of the base."""

    @abstractmethod
    def tilt_rad(self) -> float:
        """Tilt of the head; positive looks down."""

    @abstractmethod
    def held(self) -> str:
        """Class name of the held object; empty for none."""

    @abstractmethod
    def ground(self) -> GroundMap:
        """The newest 2D map."""

    @abstractmethod
    def frontiers(self) -> Sequence[Frontier]:
        """The newest frontiers."""

    @abstractmethod
    def start(self) -> tuple[float, float] | None:
        """Robot's first position in this world (x, y in m), from the 2D map; None if unknown."""

    @abstractmethod
    def objects(self, class_name: str) -> Sequence[ObjectInstance]:
        """All instances of a class, whatever their score."""

    @abstractmethod
    def sightings(self) -> Sequence[Sighting]:
        """All sightings of this task, in order of arrival."""

    @abstractmethod
    def what_if(
        self,
        id: int,
        class_name: str,
        T_world_cam: Sequence[Matrix],
        joint: bool,
        other_share: float | None = None,
    ) -> WhatIf:
        """Expected score and information gain of an instance if these views show it as the class;
        other_share: share of their evidence that goes to the *other* class; None: by the object
        map's setting."""

    @abstractmethod
    def held_object(self, class_name: str) -> HeldObject:
        """Names of the object that the robot shows, as the object map has seen it."""

    @abstractmethod
    def probability_at(self, class_name: str, boxes: Sequence[AlignedBox]) -> Sequence[float]:
        """Probability that the thing in each box (centre [3] and size [3], world, m) is of a class,
        by the names of detections there; 0.5 without any."""

    @abstractmethod
    def retire(self, id: int, point_m: NDArray[np.float64], reason: str) -> None:
        """Report to the object map that an object is no longer where it was."""
