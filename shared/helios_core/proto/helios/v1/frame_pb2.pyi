from foxglove_schemas_protobuf import CameraCalibration_pb2 as _CameraCalibration_pb2
from foxglove_schemas_protobuf import CompressedImage_pb2 as _CompressedImage_pb2
from foxglove_schemas_protobuf import PoseInFrame_pb2 as _PoseInFrame_pb2
from foxglove_schemas_protobuf import RawImage_pb2 as _RawImage_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from helios_core.proto.helios.v1 import common_pb2 as _common_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Frame(_message.Message):
    __slots__ = ("id", "stamp", "keyframe", "raw_color", "compressed_color", "raw_depth", "compressed_depth", "calibration", "T_world_cam", "T_world_base", "held", "origin_id", "shown")
    ID_FIELD_NUMBER: _ClassVar[int]
    STAMP_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    RAW_COLOR_FIELD_NUMBER: _ClassVar[int]
    COMPRESSED_COLOR_FIELD_NUMBER: _ClassVar[int]
    RAW_DEPTH_FIELD_NUMBER: _ClassVar[int]
    COMPRESSED_DEPTH_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_CAM_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_BASE_FIELD_NUMBER: _ClassVar[int]
    HELD_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_ID_FIELD_NUMBER: _ClassVar[int]
    SHOWN_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    stamp: _timestamp_pb2.Timestamp
    keyframe: bool
    raw_color: _RawImage_pb2.RawImage
    compressed_color: _CompressedImage_pb2.CompressedImage
    raw_depth: _RawImage_pb2.RawImage
    compressed_depth: _CompressedImage_pb2.CompressedImage
    calibration: _CameraCalibration_pb2.CameraCalibration
    T_world_cam: _PoseInFrame_pb2.PoseInFrame
    T_world_base: _PoseInFrame_pb2.PoseInFrame
    held: str
    origin_id: str
    shown: Shown
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., stamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., keyframe: bool = ..., raw_color: _Optional[_Union[_RawImage_pb2.RawImage, _Mapping]] = ..., compressed_color: _Optional[_Union[_CompressedImage_pb2.CompressedImage, _Mapping]] = ..., raw_depth: _Optional[_Union[_RawImage_pb2.RawImage, _Mapping]] = ..., compressed_depth: _Optional[_Union[_CompressedImage_pb2.CompressedImage, _Mapping]] = ..., calibration: _Optional[_Union[_CameraCalibration_pb2.CameraCalibration, _Mapping]] = ..., T_world_cam: _Optional[_Union[_PoseInFrame_pb2.PoseInFrame, _Mapping]] = ..., T_world_base: _Optional[_Union[_PoseInFrame_pb2.PoseInFrame, _Mapping]] = ..., held: _Optional[str] = ..., origin_id: _Optional[str] = ..., shown: _Optional[_Union[Shown, _Mapping]] = ...) -> None: ...

class Shown(_message.Message):
    __slots__ = ("point_m", "turn_rad")
    POINT_M_FIELD_NUMBER: _ClassVar[int]
    TURN_RAD_FIELD_NUMBER: _ClassVar[int]
    point_m: _common_pb2.Vector3
    turn_rad: float
    def __init__(self, point_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., turn_rad: _Optional[float] = ...) -> None: ...

class Mask(_message.Message):
    __slots__ = ("x", "y", "width", "height", "bits")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    BITS_FIELD_NUMBER: _ClassVar[int]
    x: int
    y: int
    width: int
    height: int
    bits: bytes
    def __init__(self, x: _Optional[int] = ..., y: _Optional[int] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., bits: _Optional[bytes] = ...) -> None: ...

class Embedding(_message.Message):
    __slots__ = ("model", "rows", "values")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    model: str
    rows: int
    values: bytes
    def __init__(self, model: _Optional[str] = ..., rows: _Optional[int] = ..., values: _Optional[bytes] = ...) -> None: ...

class Detection(_message.Message):
    __slots__ = ("class_name", "score", "mask")
    CLASS_NAME_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    MASK_FIELD_NUMBER: _ClassVar[int]
    class_name: str
    score: float
    mask: Mask
    def __init__(self, class_name: _Optional[str] = ..., score: _Optional[float] = ..., mask: _Optional[_Union[Mask, _Mapping]] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("frame", "context_id", "detections", "layer_scores", "detector", "detect_ms", "scorer", "image_embedding", "others", "class_scores")
    class LayerScoresEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class ClassScoresEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    FRAME_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    DETECTIONS_FIELD_NUMBER: _ClassVar[int]
    LAYER_SCORES_FIELD_NUMBER: _ClassVar[int]
    DETECTOR_FIELD_NUMBER: _ClassVar[int]
    DETECT_MS_FIELD_NUMBER: _ClassVar[int]
    SCORER_FIELD_NUMBER: _ClassVar[int]
    IMAGE_EMBEDDING_FIELD_NUMBER: _ClassVar[int]
    OTHERS_FIELD_NUMBER: _ClassVar[int]
    CLASS_SCORES_FIELD_NUMBER: _ClassVar[int]
    frame: Frame
    context_id: str
    detections: _containers.RepeatedCompositeFieldContainer[Detection]
    layer_scores: _containers.ScalarMap[str, float]
    detector: str
    detect_ms: float
    scorer: str
    image_embedding: Embedding
    others: _containers.RepeatedCompositeFieldContainer[Detection]
    class_scores: _containers.ScalarMap[str, float]
    def __init__(self, frame: _Optional[_Union[Frame, _Mapping]] = ..., context_id: _Optional[str] = ..., detections: _Optional[_Iterable[_Union[Detection, _Mapping]]] = ..., layer_scores: _Optional[_Mapping[str, float]] = ..., detector: _Optional[str] = ..., detect_ms: _Optional[float] = ..., scorer: _Optional[str] = ..., image_embedding: _Optional[_Union[Embedding, _Mapping]] = ..., others: _Optional[_Iterable[_Union[Detection, _Mapping]]] = ..., class_scores: _Optional[_Mapping[str, float]] = ...) -> None: ...

class DepthRequest(_message.Message):
    __slots__ = ("raw_color", "compressed_color", "calibration")
    RAW_COLOR_FIELD_NUMBER: _ClassVar[int]
    COMPRESSED_COLOR_FIELD_NUMBER: _ClassVar[int]
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    raw_color: _RawImage_pb2.RawImage
    compressed_color: _CompressedImage_pb2.CompressedImage
    calibration: _CameraCalibration_pb2.CameraCalibration
    def __init__(self, raw_color: _Optional[_Union[_RawImage_pb2.RawImage, _Mapping]] = ..., compressed_color: _Optional[_Union[_CompressedImage_pb2.CompressedImage, _Mapping]] = ..., calibration: _Optional[_Union[_CameraCalibration_pb2.CameraCalibration, _Mapping]] = ...) -> None: ...

class DepthReply(_message.Message):
    __slots__ = ("raw_depth", "focal_px", "model", "estimate_ms")
    RAW_DEPTH_FIELD_NUMBER: _ClassVar[int]
    FOCAL_PX_FIELD_NUMBER: _ClassVar[int]
    MODEL_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_MS_FIELD_NUMBER: _ClassVar[int]
    raw_depth: _RawImage_pb2.RawImage
    focal_px: float
    model: str
    estimate_ms: float
    def __init__(self, raw_depth: _Optional[_Union[_RawImage_pb2.RawImage, _Mapping]] = ..., focal_px: _Optional[float] = ..., model: _Optional[str] = ..., estimate_ms: _Optional[float] = ...) -> None: ...

class Preview(_message.Message):
    __slots__ = ("id", "jpeg", "detections")
    ID_FIELD_NUMBER: _ClassVar[int]
    JPEG_FIELD_NUMBER: _ClassVar[int]
    DETECTIONS_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    jpeg: bytes
    detections: _containers.RepeatedCompositeFieldContainer[Detection]
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., jpeg: _Optional[bytes] = ..., detections: _Optional[_Iterable[_Union[Detection, _Mapping]]] = ...) -> None: ...

class Claim(_message.Message):
    __slots__ = ("id", "instance", "answered")
    ID_FIELD_NUMBER: _ClassVar[int]
    INSTANCE_FIELD_NUMBER: _ClassVar[int]
    ANSWERED_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    instance: str
    answered: bool
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., instance: _Optional[str] = ..., answered: bool = ...) -> None: ...

class Ack(_message.Message):
    __slots__ = ("service", "part", "id", "accepted", "reason", "version", "update_ms", "context_id")
    SERVICE_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    UPDATE_MS_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    service: str
    part: str
    id: _common_pb2.FrameId
    accepted: bool
    reason: str
    version: int
    update_ms: float
    context_id: str
    def __init__(self, service: _Optional[str] = ..., part: _Optional[str] = ..., id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., accepted: bool = ..., reason: _Optional[str] = ..., version: _Optional[int] = ..., update_ms: _Optional[float] = ..., context_id: _Optional[str] = ...) -> None: ...

class PushRequest(_message.Message):
    __slots__ = ("frame", "wait_s", "classes")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    WAIT_S_FIELD_NUMBER: _ClassVar[int]
    CLASSES_FIELD_NUMBER: _ClassVar[int]
    frame: Frame
    wait_s: float
    classes: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, frame: _Optional[_Union[Frame, _Mapping]] = ..., wait_s: _Optional[float] = ..., classes: _Optional[_Iterable[str]] = ...) -> None: ...

class PushReply(_message.Message):
    __slots__ = ("id", "acks", "unanswered")
    ID_FIELD_NUMBER: _ClassVar[int]
    ACKS_FIELD_NUMBER: _ClassVar[int]
    UNANSWERED_FIELD_NUMBER: _ClassVar[int]
    id: _common_pb2.FrameId
    acks: _containers.RepeatedCompositeFieldContainer[Ack]
    unanswered: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., acks: _Optional[_Iterable[_Union[Ack, _Mapping]]] = ..., unanswered: _Optional[_Iterable[str]] = ...) -> None: ...
