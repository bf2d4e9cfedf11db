from helios_core.proto.helios.v1 import common_pb2 as _common_pb2
from helios_core.proto.helios.v1 import frame_pb2 as _frame_pb2
from helios_core.proto.helios.v1 import map_pb2 as _map_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SearchClass(_message.Message):
    __slots__ = ("name", "role", "threshold", "synonyms")
    NAME_FIELD_NUMBER: _ClassVar[int]
    ROLE_FIELD_NUMBER: _ClassVar[int]
    THRESHOLD_FIELD_NUMBER: _ClassVar[int]
    SYNONYMS_FIELD_NUMBER: _ClassVar[int]
    name: str
    role: str
    threshold: float
    synonyms: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, name: _Optional[str] = ..., role: _Optional[str] = ..., threshold: _Optional[float] = ..., synonyms: _Optional[_Iterable[str]] = ...) -> None: ...

class SearchContext(_message.Message):
    __slots__ = ("id", "classes", "prompts", "also", "class_prompts")
    class PromptsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    class ClassPromptsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    ID_FIELD_NUMBER: _ClassVar[int]
    CLASSES_FIELD_NUMBER: _ClassVar[int]
    PROMPTS_FIELD_NUMBER: _ClassVar[int]
    ALSO_FIELD_NUMBER: _ClassVar[int]
    CLASS_PROMPTS_FIELD_NUMBER: _ClassVar[int]
    id: str
    classes: _containers.RepeatedCompositeFieldContainer[SearchClass]
    prompts: _containers.ScalarMap[str, str]
    also: _containers.RepeatedScalarFieldContainer[str]
    class_prompts: _containers.ScalarMap[str, str]
    def __init__(self, id: _Optional[str] = ..., classes: _Optional[_Iterable[_Union[SearchClass, _Mapping]]] = ..., prompts: _Optional[_Mapping[str, str]] = ..., also: _Optional[_Iterable[str]] = ..., class_prompts: _Optional[_Mapping[str, str]] = ...) -> None: ...

class ObjectInstance(_message.Message):
    __slots__ = ("id", "class_name", "center_m", "size_m", "score", "class_score", "uncertainty", "views", "gaussians", "probabilities", "top_m", "outline_m", "detection_rate", "relocalised", "image_text_nats")
    class ProbabilitiesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    ID_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    CENTER_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    CLASS_SCORE_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    PROBABILITIES_FIELD_NUMBER: _ClassVar[int]
    TOP_M_FIELD_NUMBER: _ClassVar[int]
    OUTLINE_M_FIELD_NUMBER: _ClassVar[int]
    DETECTION_RATE_FIELD_NUMBER: _ClassVar[int]
    RELOCALISED_FIELD_NUMBER: _ClassVar[int]
    IMAGE_TEXT_NATS_FIELD_NUMBER: _ClassVar[int]
    id: int
    class_name: str
    center_m: _common_pb2.Vector3
    size_m: _common_pb2.Vector3
    score: float
    class_score: float
    uncertainty: float
    views: int
    gaussians: int
    probabilities: _containers.ScalarMap[str, float]
    top_m: float
    outline_m: _containers.RepeatedScalarFieldContainer[float]
    detection_rate: float
    relocalised: bool
    image_text_nats: float
    def __init__(self, id: _Optional[int] = ..., class_name: _Optional[str] = ..., center_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., size_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., score: _Optional[float] = ..., class_score: _Optional[float] = ..., uncertainty: _Optional[float] = ..., views: _Optional[int] = ..., gaussians: _Optional[int] = ..., probabilities: _Optional[_Mapping[str, float]] = ..., top_m: _Optional[float] = ..., outline_m: _Optional[_Iterable[float]] = ..., detection_rate: _Optional[float] = ..., relocalised: bool = ..., image_text_nats: _Optional[float] = ...) -> None: ...

class ObjectsRequest(_message.Message):
    __slots__ = ("class_names", "min_class_score")
    CLASS_NAMES_FIELD_NUMBER: _ClassVar[int]
    MIN_CLASS_SCORE_FIELD_NUMBER: _ClassVar[int]
    class_names: _containers.RepeatedScalarFieldContainer[str]
    min_class_score: float
    def __init__(self, class_names: _Optional[_Iterable[str]] = ..., min_class_score: _Optional[float] = ...) -> None: ...

class ObjectsReply(_message.Message):
    __slots__ = ("objects", "id", "version", "gaussians")
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    objects: _containers.RepeatedCompositeFieldContainer[ObjectInstance]
    id: _common_pb2.FrameId
    version: int
    gaussians: int
    def __init__(self, objects: _Optional[_Iterable[_Union[ObjectInstance, _Mapping]]] = ..., id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., version: _Optional[int] = ..., gaussians: _Optional[int] = ...) -> None: ...

class WhatIfRequest(_message.Message):
    __slots__ = ("object_id", "class_name", "T_world_cam", "camera", "joint", "other_share")
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_CAM_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    JOINT_FIELD_NUMBER: _ClassVar[int]
    OTHER_SHARE_FIELD_NUMBER: _ClassVar[int]
    object_id: int
    class_name: str
    T_world_cam: _containers.RepeatedCompositeFieldContainer[_common_pb2.Transform]
    camera: _common_pb2.Pinhole
    joint: bool
    other_share: float
    def __init__(self, object_id: _Optional[int] = ..., class_name: _Optional[str] = ..., T_world_cam: _Optional[_Iterable[_Union[_common_pb2.Transform, _Mapping]]] = ..., camera: _Optional[_Union[_common_pb2.Pinhole, _Mapping]] = ..., joint: bool = ..., other_share: _Optional[float] = ...) -> None: ...

class WhatIfReply(_message.Message):
    __slots__ = ("score", "information_gain", "pixels", "area_m2")
    SCORE_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_GAIN_FIELD_NUMBER: _ClassVar[int]
    PIXELS_FIELD_NUMBER: _ClassVar[int]
    AREA_M2_FIELD_NUMBER: _ClassVar[int]
    score: _containers.RepeatedScalarFieldContainer[float]
    information_gain: _containers.RepeatedScalarFieldContainer[float]
    pixels: _containers.RepeatedScalarFieldContainer[float]
    area_m2: float
    def __init__(self, score: _Optional[_Iterable[float]] = ..., information_gain: _Optional[_Iterable[float]] = ..., pixels: _Optional[_Iterable[float]] = ..., area_m2: _Optional[float] = ...) -> None: ...

class HeldObjectRequest(_message.Message):
    __slots__ = ("class_name",)
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    class_name: str
    def __init__(self, class_name: _Optional[str] = ...) -> None: ...

class NameShare(_message.Message):
    __slots__ = ("name", "share")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SHARE_FIELD_NUMBER: _ClassVar[int]
    name: str
    share: float
    def __init__(self, name: _Optional[str] = ..., share: _Optional[float] = ...) -> None: ...

class HeldObjectReply(_message.Message):
    __slots__ = ("probability", "sides", "names", "image_text_nats")
    PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    SIDES_FIELD_NUMBER: _ClassVar[int]
    NAMES_FIELD_NUMBER: _ClassVar[int]
    IMAGE_TEXT_NATS_FIELD_NUMBER: _ClassVar[int]
    probability: float
    sides: int
    names: _containers.RepeatedCompositeFieldContainer[NameShare]
    image_text_nats: float
    def __init__(self, probability: _Optional[float] = ..., sides: _Optional[int] = ..., names: _Optional[_Iterable[_Union[NameShare, _Mapping]]] = ..., image_text_nats: _Optional[float] = ...) -> None: ...

class NamesAtRequest(_message.Message):
    __slots__ = ("class_name", "center_m", "size_m")
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    CENTER_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    class_name: str
    center_m: _containers.RepeatedCompositeFieldContainer[_common_pb2.Vector3]
    size_m: _containers.RepeatedCompositeFieldContainer[_common_pb2.Vector3]
    def __init__(self, class_name: _Optional[str] = ..., center_m: _Optional[_Iterable[_Union[_common_pb2.Vector3, _Mapping]]] = ..., size_m: _Optional[_Iterable[_Union[_common_pb2.Vector3, _Mapping]]] = ...) -> None: ...

class NamesAtReply(_message.Message):
    __slots__ = ("probability",)
    PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    probability: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, probability: _Optional[_Iterable[float]] = ...) -> None: ...

class RetireRequest(_message.Message):
    __slots__ = ("object_id", "point_m", "radius_m", "reason")
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    POINT_M_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    object_id: int
    point_m: _common_pb2.Vector3
    radius_m: float
    reason: str
    def __init__(self, object_id: _Optional[int] = ..., point_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., radius_m: _Optional[float] = ..., reason: _Optional[str] = ...) -> None: ...

class RetireReply(_message.Message):
    __slots__ = ("retired_gaussians", "object_id", "class_name", "reason")
    RETIRED_GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    retired_gaussians: int
    object_id: int
    class_name: str
    reason: str
    def __init__(self, retired_gaussians: _Optional[int] = ..., object_id: _Optional[int] = ..., class_name: _Optional[str] = ..., reason: _Optional[str] = ...) -> None: ...

class Retired(_message.Message):
    __slots__ = ("request", "after", "retired_gaussians", "object_id", "class_name")
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    RETIRED_GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    request: RetireRequest
    after: _common_pb2.FrameId
    retired_gaussians: int
    object_id: int
    class_name: str
    def __init__(self, request: _Optional[_Union[RetireRequest, _Mapping]] = ..., after: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., retired_gaussians: _Optional[int] = ..., object_id: _Optional[int] = ..., class_name: _Optional[str] = ...) -> None: ...

class GaussiansRequest(_message.Message):
    __slots__ = ("object_id",)
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    object_id: int
    def __init__(self, object_id: _Optional[int] = ...) -> None: ...

class GaussiansReply(_message.Message):
    __slots__ = ("count", "means_m", "scales_m", "colors", "instances", "class_names", "concentration", "opacities")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    MEANS_M_FIELD_NUMBER: _ClassVar[int]
    SCALES_M_FIELD_NUMBER: _ClassVar[int]
    COLORS_FIELD_NUMBER: _ClassVar[int]
    INSTANCES_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAMES_FIELD_NUMBER: _ClassVar[int]
    CONCENTRATION_FIELD_NUMBER: _ClassVar[int]
    OPACITIES_FIELD_NUMBER: _ClassVar[int]
    count: int
    means_m: bytes
    scales_m: bytes
    colors: bytes
    instances: bytes
    class_names: _containers.RepeatedScalarFieldContainer[str]
    concentration: bytes
    opacities: bytes
    def __init__(self, count: _Optional[int] = ..., means_m: _Optional[bytes] = ..., scales_m: _Optional[bytes] = ..., colors: _Optional[bytes] = ..., instances: _Optional[bytes] = ..., class_names: _Optional[_Iterable[str]] = ..., concentration: _Optional[bytes] = ..., opacities: _Optional[bytes] = ...) -> None: ...

class VocabularyReply(_message.Message):
    __slots__ = ("open", "names", "detector", "scorer")
    OPEN_FIELD_NUMBER: _ClassVar[int]
    NAMES_FIELD_NUMBER: _ClassVar[int]
    DETECTOR_FIELD_NUMBER: _ClassVar[int]
    SCORER_FIELD_NUMBER: _ClassVar[int]
    open: bool
    names: _containers.RepeatedScalarFieldContainer[str]
    detector: str
    scorer: str
    def __init__(self, open: bool = ..., names: _Optional[_Iterable[str]] = ..., detector: _Optional[str] = ..., scorer: _Optional[str] = ...) -> None: ...

class EmbedTextRequest(_message.Message):
    __slots__ = ("prompts",)
    PROMPTS_FIELD_NUMBER: _ClassVar[int]
    prompts: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, prompts: _Optional[_Iterable[str]] = ...) -> None: ...

class EmbedTextReply(_message.Message):
    __slots__ = ("embeddings", "scale", "offset")
    EMBEDDINGS_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    embeddings: _containers.RepeatedCompositeFieldContainer[_frame_pb2.Embedding]
    scale: float
    offset: float
    def __init__(self, embeddings: _Optional[_Iterable[_Union[_frame_pb2.Embedding, _Mapping]]] = ..., scale: _Optional[float] = ..., offset: _Optional[float] = ...) -> None: ...

class ObjectMapFile(_message.Message):
    __slots__ = ("data", "same_frame")
    DATA_FIELD_NUMBER: _ClassVar[int]
    SAME_FRAME_FIELD_NUMBER: _ClassVar[int]
    data: bytes
    same_frame: bool
    def __init__(self, data: _Optional[bytes] = ..., same_frame: bool = ...) -> None: ...

class ObjectMapLoaded(_message.Message):
    __slots__ = ("gaussians", "objects", "stored")
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    STORED_FIELD_NUMBER: _ClassVar[int]
    gaussians: int
    objects: int
    stored: bool
    def __init__(self, gaussians: _Optional[int] = ..., objects: _Optional[int] = ..., stored: bool = ...) -> None: ...

class StoredObjectsReply(_message.Message):
    __slots__ = ("relocalisation", "objects")
    RELOCALISATION_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    relocalisation: _map_pb2.Relocalisation
    objects: _containers.RepeatedCompositeFieldContainer[ObjectInstance]
    def __init__(self, relocalisation: _Optional[_Union[_map_pb2.Relocalisation, _Mapping]] = ..., objects: _Optional[_Iterable[_Union[ObjectInstance, _Mapping]]] = ...) -> None: ...

class ExportRequest(_message.Message):
    __slots__ = ("format", "object_id")
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    format: str
    object_id: int
    def __init__(self, format: _Optional[str] = ..., object_id: _Optional[int] = ...) -> None: ...

class ExportReply(_message.Message):
    __slots__ = ("data", "gaussians")
    DATA_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    data: bytes
    gaussians: int
    def __init__(self, data: _Optional[bytes] = ..., gaussians: _Optional[int] = ...) -> None: ...

class RenderRequest(_message.Message):
    __slots__ = ("T_world_cam", "camera", "layer", "class_name")
    T_WORLD_CAM_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    LAYER_FIELD_NUMBER: _ClassVar[int]
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    T_world_cam: _common_pb2.Transform
    camera: _common_pb2.Pinhole
    layer: str
    class_name: str
    def __init__(self, T_world_cam: _Optional[_Union[_common_pb2.Transform, _Mapping]] = ..., camera: _Optional[_Union[_common_pb2.Pinhole, _Mapping]] = ..., layer: _Optional[str] = ..., class_name: _Optional[str] = ...) -> None: ...

class RenderReply(_message.Message):
    __slots__ = ("png",)
    PNG_FIELD_NUMBER: _ClassVar[int]
    png: bytes
    def __init__(self, png: _Optional[bytes] = ...) -> None: ...

class ObjectRequest(_message.Message):
    __slots__ = ("object_id",)
    OBJECT_ID_FIELD_NUMBER: _ClassVar[int]
    object_id: int
    def __init__(self, object_id: _Optional[int] = ...) -> None: ...

class Moment(_message.Message):
    __slots__ = ("stamp_ns", "views", "score", "class_score")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    CLASS_SCORE_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    views: float
    score: float
    class_score: float
    def __init__(self, stamp_ns: _Optional[int] = ..., views: _Optional[float] = ..., score: _Optional[float] = ..., class_score: _Optional[float] = ...) -> None: ...

class ObjectDetail(_message.Message):
    __slots__ = ("object", "history", "points_m", "box_center_m", "box_size_m", "box_yaw_rad")
    OBJECT_FIELD_NUMBER: _ClassVar[int]
    HISTORY_FIELD_NUMBER: _ClassVar[int]
    POINTS_M_FIELD_NUMBER: _ClassVar[int]
    BOX_CENTER_M_FIELD_NUMBER: _ClassVar[int]
    BOX_SIZE_M_FIELD_NUMBER: _ClassVar[int]
    BOX_YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    object: ObjectInstance
    history: _containers.RepeatedCompositeFieldContainer[Moment]
    points_m: _containers.RepeatedScalarFieldContainer[float]
    box_center_m: _common_pb2.Vector3
    box_size_m: _common_pb2.Vector3
    box_yaw_rad: float
    def __init__(self, object: _Optional[_Union[ObjectInstance, _Mapping]] = ..., history: _Optional[_Iterable[_Union[Moment, _Mapping]]] = ..., points_m: _Optional[_Iterable[float]] = ..., box_center_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., box_size_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., box_yaw_rad: _Optional[float] = ...) -> None: ...
