from helios_core.proto.helios.v1 import common_pb2 as _common_pb2
from helios_core.proto.helios.v1 import frame_pb2 as _frame_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SnapshotRequest(_message.Message):
    __slots__ = ("layers", "if_newer", "ground_only")
    LAYERS_FIELD_NUMBER: _ClassVar[int]
    IF_NEWER_FIELD_NUMBER: _ClassVar[int]
    GROUND_ONLY_FIELD_NUMBER: _ClassVar[int]
    layers: bool
    if_newer: int
    ground_only: bool
    def __init__(self, layers: bool = ..., if_newer: _Optional[int] = ..., ground_only: bool = ...) -> None: ...

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
    __slots__ = ("id", "version", "cell_m", "origin_x_m", "origin_y_m", "width", "height", "occupancy", "explored", "top_mm", "values", "frontiers", "robot", "trajectory_m", "context_id", "unchanged", "explored_m2", "occupied_m2", "bottom_mm", "trajectory_starts", "map_id")
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
    BOTTOM_MM_FIELD_NUMBER: _ClassVar[int]
    TRAJECTORY_STARTS_FIELD_NUMBER: _ClassVar[int]
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
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
    bottom_mm: bytes
    trajectory_starts: _containers.RepeatedScalarFieldContainer[int]
    map_id: str
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., version: _Optional[int] = ..., cell_m: _Optional[float] = ..., origin_x_m: _Optional[float] = ..., origin_y_m: _Optional[float] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., occupancy: _Optional[bytes] = ..., explored: _Optional[bytes] = ..., top_mm: _Optional[bytes] = ..., values: _Optional[_Mapping[str, bytes]] = ..., frontiers: _Optional[_Iterable[_Union[Frontier, _Mapping]]] = ..., robot: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., trajectory_m: _Optional[_Iterable[float]] = ..., context_id: _Optional[str] = ..., unchanged: bool = ..., explored_m2: _Optional[float] = ..., occupied_m2: _Optional[float] = ..., bottom_mm: _Optional[bytes] = ..., trajectory_starts: _Optional[_Iterable[int]] = ..., map_id: _Optional[str] = ...) -> None: ...

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

class MapChangesRequest(_message.Message):
    __slots__ = ("map_id", "after", "most_tiles", "layers")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    MOST_TILES_FIELD_NUMBER: _ClassVar[int]
    LAYERS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    after: MapCursor
    most_tiles: int
    layers: bool
    def __init__(self, map_id: _Optional[str] = ..., after: _Optional[_Union[MapCursor, _Mapping]] = ..., most_tiles: _Optional[int] = ..., layers: bool = ...) -> None: ...

class MapCursor(_message.Message):
    __slots__ = ("version", "row", "column", "layer")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ROW_FIELD_NUMBER: _ClassVar[int]
    COLUMN_FIELD_NUMBER: _ClassVar[int]
    LAYER_FIELD_NUMBER: _ClassVar[int]
    version: int
    row: int
    column: int
    layer: str
    def __init__(self, version: _Optional[int] = ..., row: _Optional[int] = ..., column: _Optional[int] = ..., layer: _Optional[str] = ...) -> None: ...

class GroundTile(_message.Message):
    __slots__ = ("occupancy", "searched", "top_mm", "bottom_mm")
    OCCUPANCY_FIELD_NUMBER: _ClassVar[int]
    SEARCHED_FIELD_NUMBER: _ClassVar[int]
    TOP_MM_FIELD_NUMBER: _ClassVar[int]
    BOTTOM_MM_FIELD_NUMBER: _ClassVar[int]
    occupancy: bytes
    searched: bytes
    top_mm: bytes
    bottom_mm: bytes
    def __init__(self, occupancy: _Optional[bytes] = ..., searched: _Optional[bytes] = ..., top_mm: _Optional[bytes] = ..., bottom_mm: _Optional[bytes] = ...) -> None: ...

class MapTile(_message.Message):
    __slots__ = ("row", "column", "version", "ground", "layer", "value")
    ROW_FIELD_NUMBER: _ClassVar[int]
    COLUMN_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    GROUND_FIELD_NUMBER: _ClassVar[int]
    LAYER_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    row: int
    column: int
    version: int
    ground: GroundTile
    layer: str
    value: bytes
    def __init__(self, row: _Optional[int] = ..., column: _Optional[int] = ..., version: _Optional[int] = ..., ground: _Optional[_Union[GroundTile, _Mapping]] = ..., layer: _Optional[str] = ..., value: _Optional[bytes] = ...) -> None: ...

class MapChanges(_message.Message):
    __slots__ = ("map_id", "next", "more", "version", "id", "cell_m", "tile_cells", "tiles", "frontiers", "robot", "context_id", "layers")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    MORE_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    CELL_M_FIELD_NUMBER: _ClassVar[int]
    TILE_CELLS_FIELD_NUMBER: _ClassVar[int]
    TILES_FIELD_NUMBER: _ClassVar[int]
    FRONTIERS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    LAYERS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    next: MapCursor
    more: bool
    version: int
    id: _common_pb2.FrameId
    cell_m: float
    tile_cells: int
    tiles: _containers.RepeatedCompositeFieldContainer[MapTile]
    frontiers: _containers.RepeatedCompositeFieldContainer[Frontier]
    robot: _common_pb2.Pose2
    context_id: str
    layers: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, map_id: _Optional[str] = ..., next: _Optional[_Union[MapCursor, _Mapping]] = ..., more: bool = ..., version: _Optional[int] = ..., id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., cell_m: _Optional[float] = ..., tile_cells: _Optional[int] = ..., tiles: _Optional[_Iterable[_Union[MapTile, _Mapping]]] = ..., frontiers: _Optional[_Iterable[_Union[Frontier, _Mapping]]] = ..., robot: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., context_id: _Optional[str] = ..., layers: _Optional[_Iterable[str]] = ...) -> None: ...

class Map2DFile(_message.Message):
    __slots__ = ("name", "data")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    name: str
    data: bytes
    def __init__(self, name: _Optional[str] = ..., data: _Optional[bytes] = ...) -> None: ...

class SaveMap2DRequest(_message.Message):
    __slots__ = ("format", "layer", "size_px")
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    LAYER_FIELD_NUMBER: _ClassVar[int]
    SIZE_PX_FIELD_NUMBER: _ClassVar[int]
    format: str
    layer: str
    size_px: int
    def __init__(self, format: _Optional[str] = ..., layer: _Optional[str] = ..., size_px: _Optional[int] = ...) -> None: ...

class SaveMap2DReply(_message.Message):
    __slots__ = ("files", "version", "map_id", "id")
    FILES_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    files: _containers.RepeatedCompositeFieldContainer[Map2DFile]
    version: int
    map_id: str
    id: _common_pb2.FrameId
    def __init__(self, files: _Optional[_Iterable[_Union[Map2DFile, _Mapping]]] = ..., version: _Optional[int] = ..., map_id: _Optional[str] = ..., id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ...) -> None: ...

class LoadMap2DRequest(_message.Message):
    __slots__ = ("files", "same_frame")
    FILES_FIELD_NUMBER: _ClassVar[int]
    SAME_FRAME_FIELD_NUMBER: _ClassVar[int]
    files: _containers.RepeatedCompositeFieldContainer[Map2DFile]
    same_frame: bool
    def __init__(self, files: _Optional[_Iterable[_Union[Map2DFile, _Mapping]]] = ..., same_frame: bool = ...) -> None: ...

class LoadMap2DReply(_message.Message):
    __slots__ = ("version", "known_m2", "occupied_m2", "views", "stored")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    KNOWN_M2_FIELD_NUMBER: _ClassVar[int]
    OCCUPIED_M2_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    STORED_FIELD_NUMBER: _ClassVar[int]
    version: int
    known_m2: float
    occupied_m2: float
    views: int
    stored: bool
    def __init__(self, version: _Optional[int] = ..., known_m2: _Optional[float] = ..., occupied_m2: _Optional[float] = ..., views: _Optional[int] = ..., stored: bool = ...) -> None: ...

class WorldName(_message.Message):
    __slots__ = ("robot_boot_id", "world_epoch", "origin_id")
    ROBOT_BOOT_ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_EPOCH_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_ID_FIELD_NUMBER: _ClassVar[int]
    robot_boot_id: str
    world_epoch: int
    origin_id: str
    def __init__(self, robot_boot_id: _Optional[str] = ..., world_epoch: _Optional[int] = ..., origin_id: _Optional[str] = ...) -> None: ...

class Relocalisation(_message.Message):
    __slots__ = ("state", "stored", "present", "T_present_stored", "overlap_m", "agreement", "contradiction", "ratio", "attempts", "reason")
    STATE_FIELD_NUMBER: _ClassVar[int]
    STORED_FIELD_NUMBER: _ClassVar[int]
    PRESENT_FIELD_NUMBER: _ClassVar[int]
    T_PRESENT_STORED_FIELD_NUMBER: _ClassVar[int]
    OVERLAP_M_FIELD_NUMBER: _ClassVar[int]
    AGREEMENT_FIELD_NUMBER: _ClassVar[int]
    CONTRADICTION_FIELD_NUMBER: _ClassVar[int]
    RATIO_FIELD_NUMBER: _ClassVar[int]
    ATTEMPTS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    state: str
    stored: WorldName
    present: WorldName
    T_present_stored: _common_pb2.Pose2
    overlap_m: float
    agreement: float
    contradiction: float
    ratio: float
    attempts: int
    reason: str
    def __init__(self, state: _Optional[str] = ..., stored: _Optional[_Union[WorldName, _Mapping]] = ..., present: _Optional[_Union[WorldName, _Mapping]] = ..., T_present_stored: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., overlap_m: _Optional[float] = ..., agreement: _Optional[float] = ..., contradiction: _Optional[float] = ..., ratio: _Optional[float] = ..., attempts: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class PathCostRequest(_message.Message):
    __slots__ = ("path_m", "radius_m", "comfort_m")
    PATH_M_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    COMFORT_M_FIELD_NUMBER: _ClassVar[int]
    path_m: _containers.RepeatedScalarFieldContainer[float]
    radius_m: float
    comfort_m: float
    def __init__(self, path_m: _Optional[_Iterable[float]] = ..., radius_m: _Optional[float] = ..., comfort_m: _Optional[float] = ...) -> None: ...

class PathCostReply(_message.Message):
    __slots__ = ("length_m", "cost_m", "least_clearance_m", "unknown_m", "blocked", "samples_m", "clearance_m", "version")
    LENGTH_M_FIELD_NUMBER: _ClassVar[int]
    COST_M_FIELD_NUMBER: _ClassVar[int]
    LEAST_CLEARANCE_M_FIELD_NUMBER: _ClassVar[int]
    UNKNOWN_M_FIELD_NUMBER: _ClassVar[int]
    BLOCKED_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_M_FIELD_NUMBER: _ClassVar[int]
    CLEARANCE_M_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    length_m: float
    cost_m: float
    least_clearance_m: float
    unknown_m: float
    blocked: bool
    samples_m: _containers.RepeatedScalarFieldContainer[float]
    clearance_m: _containers.RepeatedScalarFieldContainer[float]
    version: int
    def __init__(self, length_m: _Optional[float] = ..., cost_m: _Optional[float] = ..., least_clearance_m: _Optional[float] = ..., unknown_m: _Optional[float] = ..., blocked: bool = ..., samples_m: _Optional[_Iterable[float]] = ..., clearance_m: _Optional[_Iterable[float]] = ..., version: _Optional[int] = ...) -> None: ...

class RecallRequest(_message.Message):
    __slots__ = ("prompt", "layer", "most_places")
    PROMPT_FIELD_NUMBER: _ClassVar[int]
    LAYER_FIELD_NUMBER: _ClassVar[int]
    MOST_PLACES_FIELD_NUMBER: _ClassVar[int]
    prompt: str
    layer: str
    most_places: int
    def __init__(self, prompt: _Optional[str] = ..., layer: _Optional[str] = ..., most_places: _Optional[int] = ...) -> None: ...

class SeenPlace(_message.Message):
    __slots__ = ("id", "stamp_ns", "score", "camera", "x_m", "y_m", "jpeg", "class_name")
    ID_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    JPEG_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    stamp_ns: int
    score: float
    camera: _common_pb2.Pose2
    x_m: float
    y_m: float
    jpeg: bytes
    class_name: str
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., stamp_ns: _Optional[int] = ..., score: _Optional[float] = ..., camera: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., jpeg: _Optional[bytes] = ..., class_name: _Optional[str] = ...) -> None: ...

class RecallReply(_message.Message):
    __slots__ = ("places", "views", "version", "note")
    PLACES_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    NOTE_FIELD_NUMBER: _ClassVar[int]
    places: _containers.RepeatedCompositeFieldContainer[SeenPlace]
    views: int
    version: int
    note: str
    def __init__(self, places: _Optional[_Iterable[_Union[SeenPlace, _Mapping]]] = ..., views: _Optional[int] = ..., version: _Optional[int] = ..., note: _Optional[str] = ...) -> None: ...

class KeptTile(_message.Message):
    __slots__ = ("row", "column", "occupancy", "searched", "z_low_m", "z_high_m", "evidence", "floor_seen")
    ROW_FIELD_NUMBER: _ClassVar[int]
    COLUMN_FIELD_NUMBER: _ClassVar[int]
    OCCUPANCY_FIELD_NUMBER: _ClassVar[int]
    SEARCHED_FIELD_NUMBER: _ClassVar[int]
    Z_LOW_M_FIELD_NUMBER: _ClassVar[int]
    Z_HIGH_M_FIELD_NUMBER: _ClassVar[int]
    EVIDENCE_FIELD_NUMBER: _ClassVar[int]
    FLOOR_SEEN_FIELD_NUMBER: _ClassVar[int]
    row: int
    column: int
    occupancy: bytes
    searched: bytes
    z_low_m: bytes
    z_high_m: bytes
    evidence: bytes
    floor_seen: bytes
    def __init__(self, row: _Optional[int] = ..., column: _Optional[int] = ..., occupancy: _Optional[bytes] = ..., searched: _Optional[bytes] = ..., z_low_m: _Optional[bytes] = ..., z_high_m: _Optional[bytes] = ..., evidence: _Optional[bytes] = ..., floor_seen: _Optional[bytes] = ...) -> None: ...

class KeptValues(_message.Message):
    __slots__ = ("row", "column", "layer", "value", "confidence")
    ROW_FIELD_NUMBER: _ClassVar[int]
    COLUMN_FIELD_NUMBER: _ClassVar[int]
    LAYER_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    row: int
    column: int
    layer: str
    value: bytes
    confidence: bytes
    def __init__(self, row: _Optional[int] = ..., column: _Optional[int] = ..., layer: _Optional[str] = ..., value: _Optional[bytes] = ..., confidence: _Optional[bytes] = ...) -> None: ...

class KeptFrontier(_message.Message):
    __slots__ = ("id", "cells")
    ID_FIELD_NUMBER: _ClassVar[int]
    CELLS_FIELD_NUMBER: _ClassVar[int]
    id: int
    cells: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, id: _Optional[int] = ..., cells: _Optional[_Iterable[int]] = ...) -> None: ...

class KeptSighting(_message.Message):
    __slots__ = ("class_name", "score", "x_m", "y_m")
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    class_name: str
    score: float
    x_m: float
    y_m: float
    def __init__(self, class_name: _Optional[str] = ..., score: _Optional[float] = ..., x_m: _Optional[float] = ..., y_m: _Optional[float] = ...) -> None: ...

class KeptView(_message.Message):
    __slots__ = ("id", "stamp_ns", "x_m", "y_m", "heading_x", "heading_y", "half_fov_rad", "bins", "first_bin", "reach_m", "embedding", "jpeg", "named")
    ID_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    HEADING_X_FIELD_NUMBER: _ClassVar[int]
    HEADING_Y_FIELD_NUMBER: _ClassVar[int]
    HALF_FOV_RAD_FIELD_NUMBER: _ClassVar[int]
    BINS_FIELD_NUMBER: _ClassVar[int]
    FIRST_BIN_FIELD_NUMBER: _ClassVar[int]
    REACH_M_FIELD_NUMBER: _ClassVar[int]
    EMBEDDING_FIELD_NUMBER: _ClassVar[int]
    JPEG_FIELD_NUMBER: _ClassVar[int]
    NAMED_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    stamp_ns: int
    x_m: float
    y_m: float
    heading_x: float
    heading_y: float
    half_fov_rad: float
    bins: int
    first_bin: int
    reach_m: bytes
    embedding: _frame_pb2.Embedding
    jpeg: bytes
    named: _containers.RepeatedCompositeFieldContainer[KeptSighting]
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., stamp_ns: _Optional[int] = ..., x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., heading_x: _Optional[float] = ..., heading_y: _Optional[float] = ..., half_fov_rad: _Optional[float] = ..., bins: _Optional[int] = ..., first_bin: _Optional[int] = ..., reach_m: _Optional[bytes] = ..., embedding: _Optional[_Union[_frame_pb2.Embedding, _Mapping]] = ..., jpeg: _Optional[bytes] = ..., named: _Optional[_Iterable[_Union[KeptSighting, _Mapping]]] = ...) -> None: ...

class KeptMap(_message.Message):
    __slots__ = ("map_id", "id", "stamp_ns", "version", "cell_m", "tile_cells", "context_id", "layers", "robot", "trajectory_m", "next_frontier_id", "frontiers", "ground", "values", "views", "robot_boot_id", "world_epoch", "trajectory_starts", "origin_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    CELL_M_FIELD_NUMBER: _ClassVar[int]
    TILE_CELLS_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    LAYERS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_FIELD_NUMBER: _ClassVar[int]
    TRAJECTORY_M_FIELD_NUMBER: _ClassVar[int]
    NEXT_FRONTIER_ID_FIELD_NUMBER: _ClassVar[int]
    FRONTIERS_FIELD_NUMBER: _ClassVar[int]
    GROUND_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_BOOT_ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_EPOCH_FIELD_NUMBER: _ClassVar[int]
    TRAJECTORY_STARTS_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    id: _common_pb2.FrameId
    stamp_ns: int
    version: int
    cell_m: float
    tile_cells: int
    context_id: str
    layers: _containers.RepeatedScalarFieldContainer[str]
    robot: _common_pb2.Pose2
    trajectory_m: _containers.RepeatedScalarFieldContainer[float]
    next_frontier_id: int
    frontiers: _containers.RepeatedCompositeFieldContainer[KeptFrontier]
    ground: _containers.RepeatedCompositeFieldContainer[KeptTile]
    values: _containers.RepeatedCompositeFieldContainer[KeptValues]
    views: _containers.RepeatedCompositeFieldContainer[KeptView]
    robot_boot_id: str
    world_epoch: int
    trajectory_starts: _containers.RepeatedScalarFieldContainer[int]
    origin_id: str
    def __init__(self, map_id: _Optional[str] = ..., id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., stamp_ns: _Optional[int] = ..., version: _Optional[int] = ..., cell_m: _Optional[float] = ..., tile_cells: _Optional[int] = ..., context_id: _Optional[str] = ..., layers: _Optional[_Iterable[str]] = ..., robot: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., trajectory_m: _Optional[_Iterable[float]] = ..., next_frontier_id: _Optional[int] = ..., frontiers: _Optional[_Iterable[_Union[KeptFrontier, _Mapping]]] = ..., ground: _Optional[_Iterable[_Union[KeptTile, _Mapping]]] = ..., values: _Optional[_Iterable[_Union[KeptValues, _Mapping]]] = ..., views: _Optional[_Iterable[_Union[KeptView, _Mapping]]] = ..., robot_boot_id: _Optional[str] = ..., world_epoch: _Optional[int] = ..., trajectory_starts: _Optional[_Iterable[int]] = ..., origin_id: _Optional[str] = ...) -> None: ...
