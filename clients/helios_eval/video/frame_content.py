"""Content of one video frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from helios_core import proto as pb
from helios_core.map_snapshot import MapView
from helios_core.types import Detection, ObjectInstance
from numpy.typing import NDArray

from helios_eval.video.drawing import BLUE, GREEN, MUTED, ORANGE, Rgb

Pose2 = tuple[float, float, float]  # x, y (m), yaw (rad)

ROLE_COLOR: dict[str, Rgb] = {
    "object": ORANGE,
    "start_receptacle": BLUE,
    "goal_receptacle": GREEN,
}


@dataclass(frozen=True)
class Scene:
    """State at one moment of an episode; unknown values are empty or None."""

    title: str = ""  # agent, home and semantics of the run
    task: pb.Task = field(default_factory=pb.Task)
    held: str = ""
    color: NDArray[np.uint8] | None = None  # [h, w, 3] RGB of the last keyframe
    detections: tuple[Detection, ...] = ()  # detections in that keyframe
    map: MapView | None = None
    robot: Pose2 | None = None
    path_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    objects: tuple[ObjectInstance, ...] = ()
    decisions: tuple[pb.Decision, ...] = ()  # newest last
    roles: Mapping[str, str] = field(default_factory=dict)  # class name -> role of the context
    story: tuple[tuple[int, str], ...] = ()  # (step, message of the planner), newest last
    step: int = 0  # actions of the robot so far
    verdict: str = ""  # by ground truth, once the episode is over
    right: bool = False  # True if the verdict is success

    def color_of(self, class_name: str) -> Rgb:
        """Colour of a class by its role in the task."""
        return ROLE_COLOR.get(self.roles.get(class_name, ""), MUTED)
