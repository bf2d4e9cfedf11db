from helios_core.proto.helios.v1 import common_pb2 as _common_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SnapshotRequest(_message.Message):
    __slots__ = ("layers", "if_newer")
    LAYERS_FIELD_NUMBER: _ClassVar[int]
    IF_NEWER_FIELD_NUMBER: _ClassVar[int]
    layers: bool
    if_newer: int
    def __init__(self, layers: bool = ..., if_newer: _Optional[int] = ...) -> None: ...

class Frontier(_message.Message):
    __slots__ = ("id", "x_m", "y_m", "size_m", "values", "reachable")
    class ValuesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    ID_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    REACHABLE_FIELD_NUMBER: _ClassVar[int]
    id: int
    x_m: float
    y_m: float
    size_m: float
    values: _containers.ScalarMap[str, float]
    reachable: bool
    def __init__(self, id: _Optional[int] = ..., x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., size_m: _Optional[float] = ..., values: _Optional[_Mapping[str, float]] = ..., reachable: bool = ...) -> None: ...

class MapSnapshot(_message.Message):
    __slots__ = ("id", "version", "cell_m", "origin_x_m", "origin_y_m", "width", "height", "occupancy", "explored", "top_mm", "values", "frontiers", "robot", "trajectory_m", "context_id", "unchanged", "explored_m2", "occupied_m2")
    class ValuesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: bytes
        def __init__(self, key: _Optional[str] = ..., value: _Optional[bytes] = ...) -> None: ...
    ID_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    CELL_M_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_X_M_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_Y_M_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    OCCUPANCY_FIELD_NUMBER: _ClassVar[int]
    EXPLORED_FIELD_NUMBER: _ClassVar[int]
    TOP_MM_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    FRONTIERS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_FIELD_NUMBER: _ClassVar[int]
    TRAJECTORY_M_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    UNCHANGED_FIELD_NUMBER: _ClassVar[int]
    EXPLORED_M2_FIELD_NUMBER: _ClassVar[int]
    OCCUPIED_M2_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    version: int
    cell_m: float
    origin_x_m: float
    origin_y_m: float
    width: int
    height: int
    occupancy: bytes
    explored: bytes
    top_mm: bytes
    values: _containers.ScalarMap[str, bytes]
    frontiers: _containers.RepeatedCompositeFieldContainer[Frontier]
    robot: _common_pb2.Pose2
    trajectory_m: _containers.RepeatedScalarFieldContainer[float]
    context_id: str
    unchanged: bool
    explored_m2: float
    occupied_m2: float
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., version: _Optional[int] = ..., cell_m: _Optional[float] = ..., origin_x_m: _Optional[float] = ..., origin_y_m: _Optional[float] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., occupancy: _Optional[bytes] = ..., explored: _Optional[bytes] = ..., top_mm: _Optional[bytes] = ..., values: _Optional[_Mapping[str, bytes]] = ..., frontiers: _Optional[_Iterable[_Union[Frontier, _Mapping]]] = ..., robot: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., trajectory_m: _Optional[_Iterable[float]] = ..., context_id: _Optional[str] = ..., unchanged: bool = ..., explored_m2: _Optional[float] = ..., occupied_m2: _Optional[float] = ...) -> None: ...

class PictureRequest(_message.Message):
    __slots__ = ("layer", "size_px", "path_m", "objects")
    LAYER_FIELD_NUMBER: _ClassVar[int]
    SIZE_PX_FIELD_NUMBER: _ClassVar[int]
    PATH_M_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    layer: str
    size_px: int
    path_m: _containers.RepeatedScalarFieldContainer[float]
    objects: _containers.RepeatedCompositeFieldContainer[MarkedObject]
    def __init__(self, layer: _Optional[str] = ..., size_px: _Optional[int] = ..., path_m: _Optional[_Iterable[float]] = ..., objects: _Optional[_Iterable[_Union[MarkedObject, _Mapping]]] = ...) -> None: ...

class MarkedObject(_message.Message):
    __slots__ = ("label", "center_m", "size_m", "score")
    LABEL_FIELD_NUMBER: _ClassVar[int]
    CENTER_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    label: str
    center_m: _common_pb2.Vector3
    size_m: _common_pb2.Vector3
    score: float
    def __init__(self, label: _Optional[str] = ..., center_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., size_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., score: _Optional[float] = ...) -> None: ...

class PictureReply(_message.Message):
    __slots__ = ("png", "version")
    PNG_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    png: bytes
    version: int
    def __init__(self, png: _Optional[bytes] = ..., version: _Optional[int] = ...) -> None: ...

class SightRequest(_message.Message):
    __slots__ = ("x_m", "y_m", "z_m", "targets_m")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    Z_M_FIELD_NUMBER: _ClassVar[int]
    TARGETS_M_FIELD_NUMBER: _ClassVar[int]
    x_m: float
    y_m: float
    z_m: float
    targets_m: _containers.RepeatedCompositeFieldContainer[_common_pb2.Vector3]
    def __init__(self, x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., z_m: _Optional[float] = ..., targets_m: _Optional[_Iterable[_Union[_common_pb2.Vector3, _Mapping]]] = ...) -> None: ...

class SightReply(_message.Message):
    __slots__ = ("visible",)
    VISIBLE_FIELD_NUMBER: _ClassVar[int]
    visible: _containers.RepeatedScalarFieldContainer[bool]
    def __init__(self, visible: _Optional[_Iterable[bool]] = ...) -> None: ...
