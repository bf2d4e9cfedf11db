"""Basic types as frozen dataclasses over numpy arrays, used in place of protobuf messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from helios_core.geometry import Matrix, Pinhole


@dataclass(frozen=True, order=True)
class FrameId:
    """Identifier of one frame of one robot: boot, world epoch within it, number within that."""

    robot_boot_id: str
    world_epoch: int
    seq: int

    @property
    def epoch(self) -> tuple[str, int]:
        """Robot boot id and world epoch: the origin of the frame's poses, unless it is named."""
        return self.robot_boot_id, self.world_epoch

    def __str__(self) -> str:
        return f"{self.robot_boot_id[:6]}/{self.world_epoch}/{self.seq}"


@dataclass(frozen=True)
class WorldId:
    """Identifier of a world frame: poses with the same WorldId share one origin.

    If the driver names the origin of its poses, the WorldId outlives a restart of the robot.
    """

    robot_boot_id: str  # empty if the origin is named
    world_epoch: int
    origin_id: str = ""

    @staticmethod
    def of(robot_boot_id: str, world_epoch: int, origin_id: str) -> WorldId:
        """World of a frame or of a RobotState."""
        return WorldId("" if origin_id else robot_boot_id, world_epoch, origin_id)

    def __str__(self) -> str:
        name = f"origin {self.origin_id!r}" if self.origin_id else f"start {self.robot_boot_id!r}"
        return f"world epoch {self.world_epoch} of {name}"


@dataclass(frozen=True)
class Shown:
    """Held object that the robot holds in front of the camera."""

    point_m: tuple[float, float, float]  # centre of the object, world
    turn_rad: float  # from how it was carried, about the vertical; positive turns left


@dataclass(frozen=True)
class Frame:
    """Posed RGB-D image."""

    id: FrameId
    stamp_ns: int  # the robot's clock
    keyframe: bool
    color: NDArray[np.uint8]  # [h, w, 3] RGB
    depth_m: NDArray[np.float32]  # [h, w] along the optical axis; 0 is invalid
    camera: Pinhole
    T_world_cam: Matrix  # [4, 4]
    T_world_base: Matrix  # [4, 4]
    held: str | None = None  # class of the object held then, "" for none; None: not known
    origin_id: str = ""  # RobotState.origin_id at that time
    shown: Shown | None = None  # the maps leave a frame with a shown object out

    @property
    def world(self) -> WorldId:
        """World of the frame's poses."""
        return WorldId.of(self.id.robot_boot_id, self.id.world_epoch, self.origin_id)


@dataclass(frozen=True)
class Detection:
    """Object that the detector found in an image: class, score, box and mask."""

    class_name: str
    score: float  # 0 to 1
    box_xyxy: tuple[int, int, int, int]  # half open: x0 <= x < x1
    mask: NDArray[np.bool_]  # [h, w]


@dataclass(frozen=True)
class Embedding:
    """Vectors that an image-text model computed for one image or one text."""

    model: str  # only embeddings of the same model are comparable
    vectors: NDArray[np.float32]  # [rows, d] of unit length; the best-matching one decides


@dataclass(frozen=True)
class Observation:
    """Everything that the detector service found in one frame, together with that frame.

    The only input of the object map and of the value layers.
    """

    frame: Frame
    context_id: str
    detections: tuple[Detection, ...]
    layer_scores: dict[str, float]  # value layer -> image-text score, 0 to 1
    detector: str
    scorer: str = ""
    image_embedding: Embedding | None = None  # to score a later prompt
    others: tuple[Detection, ...] = ()  # under the other names of the search context
    # class -> image-text score, 0 to 1; empty if the scorer does not look at the image
    class_scores: dict[str, float] = field(default_factory=dict)


class Role(StrEnum):
    """Role of a class in the task."""

    OBJECT = "object"
    START_RECEPTACLE = "start_receptacle"
    GOAL_RECEPTACLE = "goal_receptacle"
    WATCH = "watch"

    @property
    def is_receptacle(self) -> bool:
        return self in (Role.START_RECEPTACLE, Role.GOAL_RECEPTACLE)


@dataclass(frozen=True)
class SearchClass:
    """One class of a search context."""

    name: str
    role: Role
    threshold: float  # least detector confidence of a detection that counts, 0 to 1
    synonyms: tuple[str, ...] = ()


@dataclass(frozen=True)
class SearchContext:
    """Target of the current task: classes with roles and detector thresholds, and prompts.

    The planner publishes it; later messages name its id.
    """

    id: str
    classes: tuple[SearchClass, ...]
    prompts: dict[str, str] = field(default_factory=dict)  # value layer -> prompt
    also: tuple[str, ...] = ()  # other names to detect, to tell look-alikes of the classes apart
    class_prompts: dict[str, str] = field(default_factory=dict)  # class -> prompt of its score

    def distinct(self, same: Callable[[str], str] = str) -> tuple[SearchClass, ...]:
        """Classes with one entry per name, in their order. A name in two roles ("from a table to
        another table") keeps the first role, and gets the lower threshold and all synonyms.

        same: maps equal names to one key.
        """
        out: dict[str, SearchClass] = {}
        for c in self.classes:
            if (old := out.get(same(c.name))) is not None:
                synonyms = tuple(dict.fromkeys((*old.synonyms, *c.synonyms)))
                c = SearchClass(old.name, old.role, min(old.threshold, c.threshold), synonyms)
            out[same(c.name)] = c
        return tuple(out.values())


@dataclass(frozen=True)
class RobotDescription:
    """Properties of a robot. Lengths in metres, angles in radians."""

    name: str
    footprint_radius_m: float
    height_m: float
    camera: Pinhole
    camera_height_m: float
    reach_m: float  # horizontal, base centre to object centre
    max_depth_m: float
    camera_forward_m: float = 0.0  # distance ahead of the base's centre
    min_forward_m: float = 0.1
    max_forward_m: float = 1.0
    max_back_m: float = 0.0  # longest move straight back; 0: it cannot move back
    min_turn_rad: float = float(np.deg2rad(5))
    max_turn_rad: float = float(np.deg2rad(30))
    tilt_range_rad: tuple[float, float] = (0.0, 0.0)  # positive looks down
    can_move: bool = True
    can_pick: bool = True
    can_place: bool = True
    simulated: bool = False
    recorded: bool = False  # replay of a recording: the robot had a body, but cannot act
    footprint_box_m: tuple[float, float] | None = None  # length, width; None: a disc
    # Centre of a held object that is shown to the camera, base frame; None: it cannot show one.
    show_base_m: tuple[float, float, float] | None = None
    world_frame: str = ""  # frame of the poses in the robot's own messages (ROS); empty: none

    @property
    def inner_radius_m(self) -> float:
        """Radius of the largest disc around the base's centre within the footprint."""
        return min(self.footprint_box_m) / 2 if self.footprint_box_m else self.footprint_radius_m


@dataclass(frozen=True)
class RobotState:
    """Present state of the robot."""

    T_world_base: Matrix
    tilt_rad: float = 0.0
    held: str = ""  # class of the held object
    moving: bool = False
    stopped: bool = False  # stop-now is latched
    world_epoch: int = 0
    robot_boot_id: str = ""
    message: str = ""
    finished: bool = False  # the recording has ended
    last_seq: int = 0
    last_action_id: str = ""  # newest completed action; empty: none is known
    origin_id: str = ""  # name of the poses' origin, constant over restarts; empty: not known
    battery: float | None = None  # charge, 0 to 1; None: not known


AlignedBox = tuple[NDArray[np.float64], NDArray[np.float64]]  # centre, size [3]; world, m


@dataclass(frozen=True)
class ObjectInstance:
    """One instance of the object map (paper section 3.1.3)."""

    id: int
    class_name: str
    center_m: NDArray[np.float64]  # [3] centre of the box of its likely Gaussians
    size_m: NDArray[np.float64]  # [3]
    score: float  # Ψ, eq. 7
    class_score: float  # S
    uncertainty: float  # U
    views: int  # distinct viewpoints fused
    gaussians: int
    probabilities: dict[str, float]
    top_m: float  # height of its highest likely Gaussian
    outline_m: NDArray[np.float64]  # [n, 2] hull of its ground projection
    detection_rate: float = 0.0  # share of its views that detected it as its class
    # Log-likelihood ratio of its class by the image-text scores of its views; it is in the scores.
    # None: the scorer does not rate the class.
    image_text_nats: float | None = None
    relocalised: bool = False  # of a stored map whose place was found since the service started
