from helios_core.proto.helios.v1 import common_pb2 as _common_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class RobotDescription(_message.Message):
    __slots__ = ("name", "footprint_radius_m", "height_m", "camera", "camera_height_m", "min_forward_m", "max_forward_m", "min_turn_rad", "max_turn_rad", "min_tilt_rad", "max_tilt_rad", "reach_m", "can_move", "can_pick", "can_place", "max_depth_m", "simulated", "recorded", "camera_forward_m", "footprint_length_m", "footprint_width_m", "max_back_m", "show_base_m", "world_frame")
    NAME_FIELD_NUMBER: _ClassVar[int]
    FOOTPRINT_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    CAMERA_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    MIN_FORWARD_M_FIELD_NUMBER: _ClassVar[int]
    MAX_FORWARD_M_FIELD_NUMBER: _ClassVar[int]
    MIN_TURN_RAD_FIELD_NUMBER: _ClassVar[int]
    MAX_TURN_RAD_FIELD_NUMBER: _ClassVar[int]
    MIN_TILT_RAD_FIELD_NUMBER: _ClassVar[int]
    MAX_TILT_RAD_FIELD_NUMBER: _ClassVar[int]
    REACH_M_FIELD_NUMBER: _ClassVar[int]
    CAN_MOVE_FIELD_NUMBER: _ClassVar[int]
    CAN_PICK_FIELD_NUMBER: _ClassVar[int]
    CAN_PLACE_FIELD_NUMBER: _ClassVar[int]
    MAX_DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    SIMULATED_FIELD_NUMBER: _ClassVar[int]
    RECORDED_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FORWARD_M_FIELD_NUMBER: _ClassVar[int]
    FOOTPRINT_LENGTH_M_FIELD_NUMBER: _ClassVar[int]
    FOOTPRINT_WIDTH_M_FIELD_NUMBER: _ClassVar[int]
    MAX_BACK_M_FIELD_NUMBER: _ClassVar[int]
    SHOW_BASE_M_FIELD_NUMBER: _ClassVar[int]
    WORLD_FRAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    footprint_radius_m: float
    height_m: float
    camera: _common_pb2.Pinhole
    camera_height_m: float
    min_forward_m: float
    max_forward_m: float
    min_turn_rad: float
    max_turn_rad: float
    min_tilt_rad: float
    max_tilt_rad: float
    reach_m: float
    can_move: bool
    can_pick: bool
    can_place: bool
    max_depth_m: float
    simulated: bool
    recorded: bool
    camera_forward_m: float
    footprint_length_m: float
    footprint_width_m: float
    max_back_m: float
    show_base_m: _common_pb2.Vector3
    world_frame: str
    def __init__(self, name: _Optional[str] = ..., footprint_radius_m: _Optional[float] = ..., height_m: _Optional[float] = ..., camera: _Optional[_Union[_common_pb2.Pinhole, _Mapping]] = ..., camera_height_m: _Optional[float] = ..., min_forward_m: _Optional[float] = ..., max_forward_m: _Optional[float] = ..., min_turn_rad: _Optional[float] = ..., max_turn_rad: _Optional[float] = ..., min_tilt_rad: _Optional[float] = ..., max_tilt_rad: _Optional[float] = ..., reach_m: _Optional[float] = ..., can_move: bool = ..., can_pick: bool = ..., can_place: bool = ..., max_depth_m: _Optional[float] = ..., simulated: bool = ..., recorded: bool = ..., camera_forward_m: _Optional[float] = ..., footprint_length_m: _Optional[float] = ..., footprint_width_m: _Optional[float] = ..., max_back_m: _Optional[float] = ..., show_base_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., world_frame: _Optional[str] = ...) -> None: ...

class RobotState(_message.Message):
    __slots__ = ("T_world_base", "tilt_rad", "held", "moving", "stopped", "world_epoch", "robot_boot_id", "message", "finished", "last_seq", "last_action_id", "origin_id", "battery")
    T_WORLD_BASE_FIELD_NUMBER: _ClassVar[int]
    TILT_RAD_FIELD_NUMBER: _ClassVar[int]
    HELD_FIELD_NUMBER: _ClassVar[int]
    MOVING_FIELD_NUMBER: _ClassVar[int]
    STOPPED_FIELD_NUMBER: _ClassVar[int]
    WORLD_EPOCH_FIELD_NUMBER: _ClassVar[int]
    ROBOT_BOOT_ID_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    FINISHED_FIELD_NUMBER: _ClassVar[int]
    LAST_SEQ_FIELD_NUMBER: _ClassVar[int]
    LAST_ACTION_ID_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_ID_FIELD_NUMBER: _ClassVar[int]
    BATTERY_FIELD_NUMBER: _ClassVar[int]
    T_world_base: _common_pb2.Transform
    tilt_rad: float
    held: str
    moving: bool
    stopped: bool
    world_epoch: int
    robot_boot_id: str
    message: str
    finished: bool
    last_seq: int
    last_action_id: str
    origin_id: str
    battery: float
    def __init__(self, T_world_base: _Optional[_Union[_common_pb2.Transform, _Mapping]] = ..., tilt_rad: _Optional[float] = ..., held: _Optional[str] = ..., moving: bool = ..., stopped: bool = ..., world_epoch: _Optional[int] = ..., robot_boot_id: _Optional[str] = ..., message: _Optional[str] = ..., finished: bool = ..., last_seq: _Optional[int] = ..., last_action_id: _Optional[str] = ..., origin_id: _Optional[str] = ..., battery: _Optional[float] = ...) -> None: ...

class Action(_message.Message):
    __slots__ = ("forward", "turn", "tilt", "pick", "place", "observe", "show")
    class Forward(_message.Message):
        __slots__ = ("distance_m",)
        DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
        distance_m: float
        def __init__(self, distance_m: _Optional[float] = ...) -> None: ...
    class Turn(_message.Message):
        __slots__ = ("angle_rad",)
        ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
        angle_rad: float
        def __init__(self, angle_rad: _Optional[float] = ...) -> None: ...
    class Tilt(_message.Message):
        __slots__ = ("angle_rad",)
        ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
        angle_rad: float
        def __init__(self, angle_rad: _Optional[float] = ...) -> None: ...
    class Pick(_message.Message):
        __slots__ = ("point_world_m", "class_name")
        POINT_WORLD_M_FIELD_NUMBER: _ClassVar[int]
        CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
        point_world_m: _common_pb2.Vector3
        class_name: str
        def __init__(self, point_world_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., class_name: _Optional[str] = ...) -> None: ...
    class Place(_message.Message):
        __slots__ = ("point_world_m",)
        POINT_WORLD_M_FIELD_NUMBER: _ClassVar[int]
        point_world_m: _common_pb2.Vector3
        def __init__(self, point_world_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ...) -> None: ...
    class Observe(_message.Message):
        __slots__ = ()
        def __init__(self) -> None: ...
    class Show(_message.Message):
        __slots__ = ("angle_rad",)
        ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
        angle_rad: float
        def __init__(self, angle_rad: _Optional[float] = ...) -> None: ...
    FORWARD_FIELD_NUMBER: _ClassVar[int]
    TURN_FIELD_NUMBER: _ClassVar[int]
    TILT_FIELD_NUMBER: _ClassVar[int]
    PICK_FIELD_NUMBER: _ClassVar[int]
    PLACE_FIELD_NUMBER: _ClassVar[int]
    OBSERVE_FIELD_NUMBER: _ClassVar[int]
    SHOW_FIELD_NUMBER: _ClassVar[int]
    forward: Action.Forward
    turn: Action.Turn
    tilt: Action.Tilt
    pick: Action.Pick
    place: Action.Place
    observe: Action.Observe
    show: Action.Show
    def __init__(self, forward: _Optional[_Union[Action.Forward, _Mapping]] = ..., turn: _Optional[_Union[Action.Turn, _Mapping]] = ..., tilt: _Optional[_Union[Action.Tilt, _Mapping]] = ..., pick: _Optional[_Union[Action.Pick, _Mapping]] = ..., place: _Optional[_Union[Action.Place, _Mapping]] = ..., observe: _Optional[_Union[Action.Observe, _Mapping]] = ..., show: _Optional[_Union[Action.Show, _Mapping]] = ...) -> None: ...

class ActionRequest(_message.Message):
    __slots__ = ("action_id", "lease_token", "time_remaining_s", "action", "no_keyframe", "beats")
    ACTION_ID_FIELD_NUMBER: _ClassVar[int]
    LEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    TIME_REMAINING_S_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    NO_KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    BEATS_FIELD_NUMBER: _ClassVar[int]
    action_id: str
    lease_token: int
    time_remaining_s: float
    action: Action
    no_keyframe: bool
    beats: bool
    def __init__(self, action_id: _Optional[str] = ..., lease_token: _Optional[int] = ..., time_remaining_s: _Optional[float] = ..., action: _Optional[_Union[Action, _Mapping]] = ..., no_keyframe: bool = ..., beats: bool = ...) -> None: ...

class Heartbeat(_message.Message):
    __slots__ = ("action_id",)
    ACTION_ID_FIELD_NUMBER: _ClassVar[int]
    action_id: str
    def __init__(self, action_id: _Optional[str] = ...) -> None: ...

class ActionResult(_message.Message):
    __slots__ = ("action_id", "succeeded", "reason", "moved_m", "turned_rad", "collided", "steps", "keyframe", "T_world_base")
    ACTION_ID_FIELD_NUMBER: _ClassVar[int]
    SUCCEEDED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MOVED_M_FIELD_NUMBER: _ClassVar[int]
    TURNED_RAD_FIELD_NUMBER: _ClassVar[int]
    COLLIDED_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_BASE_FIELD_NUMBER: _ClassVar[int]
    action_id: str
    succeeded: bool
    reason: str
    moved_m: float
    turned_rad: float
    collided: bool
    steps: int
    keyframe: _common_pb2.FrameId
    T_world_base: _common_pb2.Transform
    def __init__(self, action_id: _Optional[str] = ..., succeeded: bool = ..., reason: _Optional[str] = ..., moved_m: _Optional[float] = ..., turned_rad: _Optional[float] = ..., collided: bool = ..., steps: _Optional[int] = ..., keyframe: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., T_world_base: _Optional[_Union[_common_pb2.Transform, _Mapping]] = ...) -> None: ...

class LeaseRequest(_message.Message):
    __slots__ = ("holder", "take", "duration_s", "renew_token", "release_token")
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    TAKE_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    RENEW_TOKEN_FIELD_NUMBER: _ClassVar[int]
    RELEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    holder: str
    take: bool
    duration_s: float
    renew_token: int
    release_token: int
    def __init__(self, holder: _Optional[str] = ..., take: bool = ..., duration_s: _Optional[float] = ..., renew_token: _Optional[int] = ..., release_token: _Optional[int] = ...) -> None: ...

class LeaseReply(_message.Message):
    __slots__ = ("token", "duration_s")
    TOKEN_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    token: int
    duration_s: float
    def __init__(self, token: _Optional[int] = ..., duration_s: _Optional[float] = ...) -> None: ...

class RobotChecksRequest(_message.Message):
    __slots__ = ("restart",)
    RESTART_FIELD_NUMBER: _ClassVar[int]
    restart: bool
    def __init__(self, restart: bool = ...) -> None: ...

class RobotCheck(_message.Message):
    __slots__ = ("name", "verdict", "value", "error", "limit", "unit", "words")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    WORDS_FIELD_NUMBER: _ClassVar[int]
    name: str
    verdict: str
    value: float
    error: float
    limit: float
    unit: str
    words: str
    def __init__(self, name: _Optional[str] = ..., verdict: _Optional[str] = ..., value: _Optional[float] = ..., error: _Optional[float] = ..., limit: _Optional[float] = ..., unit: _Optional[str] = ..., words: _Optional[str] = ...) -> None: ...

class RobotChecksReply(_message.Message):
    __slots__ = ("checks", "images", "free_ahead_m")
    CHECKS_FIELD_NUMBER: _ClassVar[int]
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    FREE_AHEAD_M_FIELD_NUMBER: _ClassVar[int]
    checks: _containers.RepeatedCompositeFieldContainer[RobotCheck]
    images: int
    free_ahead_m: float
    def __init__(self, checks: _Optional[_Iterable[_Union[RobotCheck, _Mapping]]] = ..., images: _Optional[int] = ..., free_ahead_m: _Optional[float] = ...) -> None: ...

class StopRequest(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class WorldActRequest(_message.Message):
    __slots__ = ("action_id", "action", "beats", "watch_hz")
    ACTION_ID_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    BEATS_FIELD_NUMBER: _ClassVar[int]
    WATCH_HZ_FIELD_NUMBER: _ClassVar[int]
    action_id: str
    action: Action
    beats: bool
    watch_hz: float
    def __init__(self, action_id: _Optional[str] = ..., action: _Optional[_Union[Action, _Mapping]] = ..., beats: bool = ..., watch_hz: _Optional[float] = ...) -> None: ...

class WorldCapture(_message.Message):
    __slots__ = ("color", "depth_mm", "camera", "T_world_cam", "T_world_base", "stamp_ns")
    COLOR_FIELD_NUMBER: _ClassVar[int]
    DEPTH_MM_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_CAM_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_BASE_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    color: bytes
    depth_mm: bytes
    camera: _common_pb2.Pinhole
    T_world_cam: _common_pb2.Transform
    T_world_base: _common_pb2.Transform
    stamp_ns: int
    def __init__(self, color: _Optional[bytes] = ..., depth_mm: _Optional[bytes] = ..., camera: _Optional[_Union[_common_pb2.Pinhole, _Mapping]] = ..., T_world_cam: _Optional[_Union[_common_pb2.Transform, _Mapping]] = ..., T_world_base: _Optional[_Union[_common_pb2.Transform, _Mapping]] = ..., stamp_ns: _Optional[int] = ...) -> None: ...

class WorldCaptures(_message.Message):
    __slots__ = ("captures",)
    CAPTURES_FIELD_NUMBER: _ClassVar[int]
    captures: _containers.RepeatedCompositeFieldContainer[WorldCapture]
    def __init__(self, captures: _Optional[_Iterable[_Union[WorldCapture, _Mapping]]] = ...) -> None: ...

class TruthSegmentationRequest(_message.Message):
    __slots__ = ("stamp_ns",)
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    def __init__(self, stamp_ns: _Optional[int] = ...) -> None: ...

class TruthInstance(_message.Message):
    __slots__ = ("id", "name", "class_name", "graspable", "center_m", "on", "turn_rad")
    ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    GRASPABLE_FIELD_NUMBER: _ClassVar[int]
    CENTER_M_FIELD_NUMBER: _ClassVar[int]
    ON_FIELD_NUMBER: _ClassVar[int]
    TURN_RAD_FIELD_NUMBER: _ClassVar[int]
    id: int
    name: str
    class_name: str
    graspable: bool
    center_m: _common_pb2.Vector3
    on: str
    turn_rad: float
    def __init__(self, id: _Optional[int] = ..., name: _Optional[str] = ..., class_name: _Optional[str] = ..., graspable: bool = ..., center_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., on: _Optional[str] = ..., turn_rad: _Optional[float] = ...) -> None: ...

class TruthSegmentation(_message.Message):
    __slots__ = ("stamp_ns", "width", "height", "ids", "instances", "T_world_cam")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    IDS_FIELD_NUMBER: _ClassVar[int]
    INSTANCES_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_CAM_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    width: int
    height: int
    ids: bytes
    instances: _containers.RepeatedCompositeFieldContainer[TruthInstance]
    T_world_cam: _common_pb2.Transform
    def __init__(self, stamp_ns: _Optional[int] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., ids: _Optional[bytes] = ..., instances: _Optional[_Iterable[_Union[TruthInstance, _Mapping]]] = ..., T_world_cam: _Optional[_Union[_common_pb2.Transform, _Mapping]] = ...) -> None: ...

class TruthEpisode(_message.Message):
    __slots__ = ("seed", "preset", "object_class", "start_receptacle_class", "goal_receptacle_class", "instruction")
    SEED_FIELD_NUMBER: _ClassVar[int]
    PRESET_FIELD_NUMBER: _ClassVar[int]
    OBJECT_CLASS_FIELD_NUMBER: _ClassVar[int]
    START_RECEPTACLE_CLASS_FIELD_NUMBER: _ClassVar[int]
    GOAL_RECEPTACLE_CLASS_FIELD_NUMBER: _ClassVar[int]
    INSTRUCTION_FIELD_NUMBER: _ClassVar[int]
    seed: int
    preset: str
    object_class: str
    start_receptacle_class: str
    goal_receptacle_class: str
    instruction: str
    def __init__(self, seed: _Optional[int] = ..., preset: _Optional[str] = ..., object_class: _Optional[str] = ..., start_receptacle_class: _Optional[str] = ..., goal_receptacle_class: _Optional[str] = ..., instruction: _Optional[str] = ...) -> None: ...

class TruthMetrics(_message.Message):
    __slots__ = ("find_object", "pick", "find_receptacle", "place", "success", "collision", "collisions", "steps", "collided_with", "path_m")
    FIND_OBJECT_FIELD_NUMBER: _ClassVar[int]
    PICK_FIELD_NUMBER: _ClassVar[int]
    FIND_RECEPTACLE_FIELD_NUMBER: _ClassVar[int]
    PLACE_FIELD_NUMBER: _ClassVar[int]
    SUCCESS_FIELD_NUMBER: _ClassVar[int]
    COLLISION_FIELD_NUMBER: _ClassVar[int]
    COLLISIONS_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    COLLIDED_WITH_FIELD_NUMBER: _ClassVar[int]
    PATH_M_FIELD_NUMBER: _ClassVar[int]
    find_object: bool
    pick: bool
    find_receptacle: bool
    place: bool
    success: bool
    collision: bool
    collisions: int
    steps: int
    collided_with: _containers.RepeatedScalarFieldContainer[str]
    path_m: float
    def __init__(self, find_object: bool = ..., pick: bool = ..., find_receptacle: bool = ..., place: bool = ..., success: bool = ..., collision: bool = ..., collisions: _Optional[int] = ..., steps: _Optional[int] = ..., collided_with: _Optional[_Iterable[str]] = ..., path_m: _Optional[float] = ...) -> None: ...

class TruthObjects(_message.Message):
    __slots__ = ("instances",)
    INSTANCES_FIELD_NUMBER: _ClassVar[int]
    instances: _containers.RepeatedCompositeFieldContainer[TruthInstance]
    def __init__(self, instances: _Optional[_Iterable[_Union[TruthInstance, _Mapping]]] = ...) -> None: ...

class TruthTraceRequest(_message.Message):
    __slots__ = ("since_ns",)
    SINCE_NS_FIELD_NUMBER: _ClassVar[int]
    since_ns: int
    def __init__(self, since_ns: _Optional[int] = ...) -> None: ...

class TruthTrace(_message.Message):
    __slots__ = ("actions", "after_s", "x_m", "y_m", "begun")
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    AFTER_S_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    BEGUN_FIELD_NUMBER: _ClassVar[int]
    actions: int
    after_s: _containers.RepeatedScalarFieldContainer[float]
    x_m: _containers.RepeatedScalarFieldContainer[float]
    y_m: _containers.RepeatedScalarFieldContainer[float]
    begun: int
    def __init__(self, actions: _Optional[int] = ..., after_s: _Optional[_Iterable[float]] = ..., x_m: _Optional[_Iterable[float]] = ..., y_m: _Optional[_Iterable[float]] = ..., begun: _Optional[int] = ...) -> None: ...
