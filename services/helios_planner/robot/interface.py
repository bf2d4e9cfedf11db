"""What a mission needs of the robot and its maps, as one small interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from helios_core.geometry import Matrix
from helios_core.robot import Action, ActionResult
from helios_core.types import ObjectInstance, RobotDescription
from numpy.typing import NDArray

from helios_planner.decisions.decision import Decision
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.robot.detections import Sighting
from helios_planner.task import Phase


@dataclass(frozen=True)
class Frontier:
    """A border between what was searched and what was not; values by layer."""

    id: int
    xy_m: tuple[float, float]
    size_m: float
    values: dict[str, float]


@dataclass(frozen=True)
class WhatIf:
    """What views would bring: Psi' and information gain in nats, per pose, or one if joint."""

    scores: tuple[float, ...]
    gains_nats: tuple[float, ...]


class ProgressListener(Protocol):
    """Who is told how a mission goes; nothing that is told changes it."""

    def on_phase(self, phase: Phase, seeking: str, message: str) -> None:
        """What the task does now."""

    def on_decision(self, decision: Decision) -> None:
        """Keep and publish a decision."""

    def on_plan(self, route_m: NDArray[np.float64], goal: Pose2 | None, purpose: str) -> None:
        """The route [n, 2] being driven; empty when standing."""

    def on_picks(self, picks: int) -> None:
        """How many picks were tried."""


class RobotInterface(ABC):
    """The robot and its maps. Every method may raise TaskFailed or TaskCancelled."""

    description: RobotDescription
    listener: ProgressListener
    cut_short: bool = False  # whether the last action was ended early by stop-now

    @abstractmethod
    def act(self, action: Action) -> ActionResult:
        """Do it, and return when every map holds what the robot saw afterwards."""

    @abstractmethod
    def budget_used(self) -> float:
        """Share [0, 1] of the steps that the task may take."""

    def detector_trouble(self) -> str:
        """What was wrong with the detector during the task, for the end of a sentence; empty where
        nothing was."""
        return ""

    @abstractmethod
    def pose(self) -> Pose2:
        """Where the base stands."""

    @abstractmethod
    def tilt_rad(self) -> float:
        """Where the head points; positive looks down."""

    @abstractmethod
    def held(self) -> str:
        """Class name of what is held; empty for nothing."""

    @abstractmethod
    def ground(self) -> GroundMap:
        """The newest 2D map."""

    @abstractmethod
    def frontiers(self) -> Sequence[Frontier]:
        """The newest frontiers."""

    @abstractmethod
    def start(self) -> tuple[float, float] | None:
        """Where the robot stood first in this world (x, y in m), as the 2D map has it; None: it
        does not know."""

    @abstractmethod
    def objects(self, class_name: str) -> Sequence[ObjectInstance]:
        """All instances of a class, whatever their score."""

    @abstractmethod
    def sightings(self) -> Sequence[Sighting]:
        """All that the detector has reported in this task, in the order of its coming."""

    @abstractmethod
    def what_if(
        self,
        id: int,
        class_name: str,
        T_world_cam: Sequence[Matrix],
        joint: bool,
        other_share: float = 0.0,
    ) -> WhatIf:
        """What would be believed of an instance, were it seen as the class from there; a share of
        what is seen may speak for something else."""

    @abstractmethod
    def retire(self, id: int, point_m: NDArray[np.float64], reason: str) -> None:
        """Tell the object map that a thing is no longer where it was."""
