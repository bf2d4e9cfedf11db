"""Settings of ROS 2: variables `HELIOS_ROS2_…` or the table `[ros2]` of the settings file.

The driver (in the bridge) and the output process `python -m helios_ros2` share them.
"""

from __future__ import annotations

from typing import Any, Literal, Self

from helios_core.settings import ServiceSettings, service_config
from pydantic import BaseModel, Field, model_validator


class UserAction(BaseModel, frozen=True, extra="forbid"):
    """A ROS action of yours that moves the hand."""

    action: str  # name, such as /pick
    type: str  # such as my_msgs/action/Pick
    goal: dict[str, Any] = {}  # fields; texts may hold {x} {y} {z} {angle} {name} {frame}
    success: str = ""  # field of the result that is true on success; "": the action's status


class Ros2Settings(ServiceSettings):
    """Everything that may differ from robot to robot."""

    model_config = service_config("ros2")

    python: str = Field(
        default="",
        description="Python with rclpy that `helios up` uses for ROS 2; empty: this one if it has "
        "rclpy, else .venv-ros2 beside this environment",
    )

    transport: Literal["rclpy", "zenoh"] = Field(
        default="rclpy",
        description="rclpy; or zenoh: the driver talks to robots with rmw_zenoh without ROS "
        "(experimental; topics only)",
    )
    zenoh_router: str = Field(
        default="tcp/127.0.0.1:7447", description="router of rmw_zenoh, for transport = zenoh"
    )

    color: str = Field(default="", description="topic of the colour image; empty: found by name")
    depth: str = Field(default="", description="topic of the depth image; empty: found by name")
    color_info: str = Field(
        default="", description="topic of the colour CameraInfo; empty: beside the image"
    )
    depth_info: str = Field(
        default="", description="topic of the depth CameraInfo; empty: beside the image"
    )
    pose: Literal["auto", "tf", "topic"] = Field(
        default="auto",
        description="source of poses: tf, topic (`odom` and the mount below), or auto: tf where "
        "tf2_msgs is there and TF connects the camera, else topic. auto waits 20 s for TF if it is "
        "heard, and for ever if world_frame or base_frame is set",
    )
    odom: str = Field(
        default="/odom",
        description="topic of Odometry, PoseStamped or PoseWithCovarianceStamped",
    )
    world_frame: str = Field(
        default="",
        description="frame of the poses in TF; empty: map if TF has it at the start, else odom; "
        "with an `origin` always map",
    )
    base_frame: str = Field(
        default="",
        description="frame of the base in TF; empty: base_footprint, else base_link",
    )
    base_height_m: float = Field(
        default=0.0, ge=0, description="height of the base frame above the floor"
    )
    level: bool = Field(
        default=True,
        description="the base stays level on one floor; false: roll, pitch and height are used",
    )
    jump_m: float = Field(
        default=0.5, gt=0, description="a larger jump of the pose begins a new world"
    )
    origin: str = Field(
        default="",
        description="name of the origin of the poses if it outlives a restart, such as the name "
        "of the robot's map",
    )

    name: str = Field(default="ROS 2 robot", description="name of the robot")
    camera_height_m: float = Field(
        default=1.2, gt=0, description="height of the camera above the floor, without TF"
    )
    camera_forward_m: float = Field(
        default=0.0, description="distance of the camera ahead of the base, without TF"
    )
    camera_tilt_rad: float = Field(
        default=0.5, description="downward tilt of the camera, without TF"
    )
    footprint_radius_m: float = Field(default=0.25, gt=0, description="radius of the base")
    height_m: float = Field(default=1.3, gt=0, description="height of the robot")
    max_depth_m: float = Field(default=5.0, gt=0, description="farther depth is ignored")
    reach_m: float = Field(
        default=0.8, gt=0, description="horizontal reach from the base's centre, for pick and place"
    )

    motion: Literal["auto", "cmd_vel", "nav2", "none"] = Field(
        default="auto",
        description="auto: Nav2's Spin, DriveOnHeading and BackUp where the robot has them, else "
        "velocities; none: the robot does not move",
    )
    cmd_vel: str = Field(default="/cmd_vel", description="topic of velocities")
    speed_m_s: float = Field(default=0.4, gt=0, le=2, description="fastest drive")
    turn_rad_s: float = Field(default=1.0, gt=0, le=3, description="fastest turn")
    min_speed_m_s: float = Field(default=0.04, gt=0, description="slowest drive that still moves")
    min_turn_rad_s: float = Field(default=0.1, gt=0, description="slowest turn that still moves")
    max_back_m: float = Field(
        default=0.0, ge=0, le=2, description="longest drive back; 0: it never drives back"
    )
    blocked_s: float = Field(
        default=1.5, gt=0, description="a motion without progress for this long is blocked"
    )
    nav2_prefix: str = Field(
        default="", description="before the names of Nav2's actions, such as /robot1/"
    )

    tilt: str = Field(
        default="", description="topic of JointTrajectory that tilts the camera; empty: fixed"
    )
    tilt_joint: str = Field(default="", description="joint that tilts the camera")
    tilt_sign: Literal[1, -1] = Field(
        default=1, description="1 if a positive joint angle looks down, else -1"
    )
    tilt_offset_rad: float = Field(
        default=0.0, description="downward tilt of the camera at joint angle 0"
    )
    tilt_min_rad: float = Field(default=-0.3, description="highest view; positive looks down")
    tilt_max_rad: float = Field(default=1.0, description="lowest view; positive looks down")
    joint_states: str = Field(default="/joint_states", description="topic of JointState")

    battery: str = Field(
        default="", description="topic of BatteryState; empty: the only one that there is"
    )

    pick: UserAction | None = Field(
        default=None, description="action that picks: a table with action, type, goal, success"
    )
    place: UserAction | None = Field(
        default=None, description="action that places: a table with action, type, goal, success"
    )
    show: UserAction | None = Field(
        default=None,
        description="action that holds the held object at `show_base_m`, turned by {angle}: a "
        "table with action, type, goal, success",
    )
    show_base_m: tuple[float, float, float] | None = Field(
        default=None,
        description="where `show` holds an object: x, y, z from the base, in view of the camera",
    )
    carry: UserAction | None = Field(
        default=None,
        description="action that draws the hand in again, before the next drive, turn or place; "
        "without it, your robot does so itself",
    )
    ask_person: bool = Field(
        default=True,
        description="without an action of yours, ask a person to pick and place: `~/request` asks, "
        "the services `~/done` and `~/refuse` answer",
    )
    hand_timeout_s: float = Field(
        default=50.0,
        gt=0,
        description="longest pick or place; keep it below the planner's action_timeout_s",
    )

    silent_s: float = Field(
        default=1.0, gt=0, description="a topic without a message for this long is silent"
    )
    image_wait_s: float = Field(
        default=3.0,
        gt=0,
        description="longest wait for an image newer than the robot's rest, and for its pose",
    )
    pair_s: float = Field(
        default=0.02, ge=0, description="longest time between colour and depth of one image"
    )

    node: str = Field(
        default="helios", description="name of the output node; its topics are /<node>/…"
    )
    frame: str = Field(
        default="",
        description="frame of everything that HELIOS publishes; empty: world_frame, else the frame "
        "of the robot's poses as its driver tells it, else map",
    )
    sim_time: bool = Field(
        default=False,
        description="stamp what HELIOS publishes by /clock, for a robot in simulated time",
    )
    publish_tf: Literal["none", "odom", "base"] = Field(
        default="none",
        description="odom: publish that `frame` and odom are the same; base: publish `frame` → "
        "base_link from the robot's state",
    )
    map_period_s: float = Field(
        default=1.0, gt=0, description="least time between two publications of a changed map"
    )

    @model_validator(mode="after")
    def _shows_somewhere(self) -> Self:
        if (self.show is None) != (self.show_base_m is None):
            raise ValueError("show and show_base_m belong together; give both or neither")
        return self
