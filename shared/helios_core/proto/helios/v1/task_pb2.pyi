from helios_core.proto.helios.v1 import common_pb2 as _common_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Task(_message.Message):
    __slots__ = ("id", "instruction", "state", "phase", "cause", "message", "object", "start", "goal", "kind", "steps", "max_steps", "picks", "created_s", "started_s", "ended_s", "progress", "context_id", "seeking", "agent", "time_limit_s", "priority", "settings", "on_hold", "unused", "seen_at_goal", "eta_low_s", "eta_high_s", "point", "traceparent")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    ID_FIELD_NUMBER: _ClassVar[int]
    INSTRUCTION_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    OBJECT_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    GOAL_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    MAX_STEPS_FIELD_NUMBER: _ClassVar[int]
    PICKS_FIELD_NUMBER: _ClassVar[int]
    CREATED_S_FIELD_NUMBER: _ClassVar[int]
    STARTED_S_FIELD_NUMBER: _ClassVar[int]
    ENDED_S_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    SEEKING_FIELD_NUMBER: _ClassVar[int]
    AGENT_FIELD_NUMBER: _ClassVar[int]
    TIME_LIMIT_S_FIELD_NUMBER: _ClassVar[int]
    PRIORITY_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    ON_HOLD_FIELD_NUMBER: _ClassVar[int]
    UNUSED_FIELD_NUMBER: _ClassVar[int]
    SEEN_AT_GOAL_FIELD_NUMBER: _ClassVar[int]
    ETA_LOW_S_FIELD_NUMBER: _ClassVar[int]
    ETA_HIGH_S_FIELD_NUMBER: _ClassVar[int]
    POINT_FIELD_NUMBER: _ClassVar[int]
    TRACEPARENT_FIELD_NUMBER: _ClassVar[int]
    id: str
    instruction: str
    state: str
    phase: str
    cause: str
    message: str
    object: str
    start: str
    goal: str
    kind: str
    steps: int
    max_steps: int
    picks: int
    created_s: float
    started_s: float
    ended_s: float
    progress: float
    context_id: str
    seeking: str
    agent: str
    time_limit_s: float
    priority: int
    settings: _containers.ScalarMap[str, str]
    on_hold: bool
    unused: _containers.RepeatedScalarFieldContainer[str]
    seen_at_goal: bool
    eta_low_s: float
    eta_high_s: float
    point: GoalPoint
    traceparent: str
    def __init__(self, id: _Optional[str] = ..., instruction: _Optional[str] = ..., state: _Optional[str] = ..., phase: _Optional[str] = ..., cause: _Optional[str] = ..., message: _Optional[str] = ..., object: _Optional[str] = ..., start: _Optional[str] = ..., goal: _Optional[str] = ..., kind: _Optional[str] = ..., steps: _Optional[int] = ..., max_steps: _Optional[int] = ..., picks: _Optional[int] = ..., created_s: _Optional[float] = ..., started_s: _Optional[float] = ..., ended_s: _Optional[float] = ..., progress: _Optional[float] = ..., context_id: _Optional[str] = ..., seeking: _Optional[str] = ..., agent: _Optional[str] = ..., time_limit_s: _Optional[float] = ..., priority: _Optional[int] = ..., settings: _Optional[_Mapping[str, str]] = ..., on_hold: bool = ..., unused: _Optional[_Iterable[str]] = ..., seen_at_goal: bool = ..., eta_low_s: _Optional[float] = ..., eta_high_s: _Optional[float] = ..., point: _Optional[_Union[GoalPoint, _Mapping]] = ..., traceparent: _Optional[str] = ...) -> None: ...

class GoalPoint(_message.Message):
    __slots__ = ("x_m", "y_m", "yaw_rad")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    x_m: float
    y_m: float
    yaw_rad: float
    def __init__(self, x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., yaw_rad: _Optional[float] = ...) -> None: ...

class SubmitRequest(_message.Message):
    __slots__ = ("instruction", "max_steps", "agent", "time_limit_s", "priority", "settings", "id", "on_hold")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    INSTRUCTION_FIELD_NUMBER: _ClassVar[int]
    MAX_STEPS_FIELD_NUMBER: _ClassVar[int]
    AGENT_FIELD_NUMBER: _ClassVar[int]
    TIME_LIMIT_S_FIELD_NUMBER: _ClassVar[int]
    PRIORITY_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    ON_HOLD_FIELD_NUMBER: _ClassVar[int]
    instruction: str
    max_steps: int
    agent: str
    time_limit_s: float
    priority: int
    settings: _containers.ScalarMap[str, str]
    id: str
    on_hold: bool
    def __init__(self, instruction: _Optional[str] = ..., max_steps: _Optional[int] = ..., agent: _Optional[str] = ..., time_limit_s: _Optional[float] = ..., priority: _Optional[int] = ..., settings: _Optional[_Mapping[str, str]] = ..., id: _Optional[str] = ..., on_hold: bool = ...) -> None: ...

class TaskRequest(_message.Message):
    __slots__ = ("id", "settings")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    ID_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    id: str
    settings: _containers.ScalarMap[str, str]
    def __init__(self, id: _Optional[str] = ..., settings: _Optional[_Mapping[str, str]] = ...) -> None: ...

class TaskList(_message.Message):
    __slots__ = ("tasks",)
    TASKS_FIELD_NUMBER: _ClassVar[int]
    tasks: _containers.RepeatedCompositeFieldContainer[Task]
    def __init__(self, tasks: _Optional[_Iterable[_Union[Task, _Mapping]]] = ...) -> None: ...

class ReserveRequest(_message.Message):
    __slots__ = ("token", "why", "for_s")
    TOKEN_FIELD_NUMBER: _ClassVar[int]
    WHY_FIELD_NUMBER: _ClassVar[int]
    FOR_S_FIELD_NUMBER: _ClassVar[int]
    token: str
    why: str
    for_s: float
    def __init__(self, token: _Optional[str] = ..., why: _Optional[str] = ..., for_s: _Optional[float] = ...) -> None: ...

class ReserveReply(_message.Message):
    __slots__ = ("token",)
    TOKEN_FIELD_NUMBER: _ClassVar[int]
    token: str
    def __init__(self, token: _Optional[str] = ...) -> None: ...

class Candidate(_message.Message):
    __slots__ = ("kind", "name", "position_m", "terms", "chosen", "id")
    class TermsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    KIND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    POSITION_M_FIELD_NUMBER: _ClassVar[int]
    TERMS_FIELD_NUMBER: _ClassVar[int]
    CHOSEN_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    kind: str
    name: str
    position_m: _common_pb2.Vector3
    terms: _containers.ScalarMap[str, float]
    chosen: bool
    id: int
    def __init__(self, kind: _Optional[str] = ..., name: _Optional[str] = ..., position_m: _Optional[_Union[_common_pb2.Vector3, _Mapping]] = ..., terms: _Optional[_Mapping[str, float]] = ..., chosen: bool = ..., id: _Optional[int] = ...) -> None: ...

class Decision(_message.Message):
    __slots__ = ("task_id", "index", "phase", "rule", "candidates", "why", "id", "made_s", "settings", "context_id", "do", "memory", "recomputed")
    class SettingsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    TASK_ID_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    RULE_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    WHY_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    MADE_S_FIELD_NUMBER: _ClassVar[int]
    SETTINGS_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_ID_FIELD_NUMBER: _ClassVar[int]
    DO_FIELD_NUMBER: _ClassVar[int]
    MEMORY_FIELD_NUMBER: _ClassVar[int]
    RECOMPUTED_FIELD_NUMBER: _ClassVar[int]
    task_id: str
    index: int
    phase: str
    rule: str
    candidates: _containers.RepeatedCompositeFieldContainer[Candidate]
    why: str
    id: _common_pb2.FrameId
    made_s: float
    settings: _containers.ScalarMap[str, float]
    context_id: str
    do: str
    memory: _containers.RepeatedCompositeFieldContainer[Candidate]
    recomputed: Recomputed
    def __init__(self, task_id: _Optional[str] = ..., index: _Optional[int] = ..., phase: _Optional[str] = ..., rule: _Optional[str] = ..., candidates: _Optional[_Iterable[_Union[Candidate, _Mapping]]] = ..., why: _Optional[str] = ..., id: _Optional[_Union[_common_pb2.FrameId, _Mapping]] = ..., made_s: _Optional[float] = ..., settings: _Optional[_Mapping[str, float]] = ..., context_id: _Optional[str] = ..., do: _Optional[str] = ..., memory: _Optional[_Iterable[_Union[Candidate, _Mapping]]] = ..., recomputed: _Optional[_Union[Recomputed, _Mapping]] = ...) -> None: ...

class Recomputed(_message.Message):
    __slots__ = ("do", "candidates", "why", "flips", "certain")
    DO_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    WHY_FIELD_NUMBER: _ClassVar[int]
    FLIPS_FIELD_NUMBER: _ClassVar[int]
    CERTAIN_FIELD_NUMBER: _ClassVar[int]
    do: str
    candidates: _containers.RepeatedCompositeFieldContainer[Candidate]
    why: str
    flips: bool
    certain: bool
    def __init__(self, do: _Optional[str] = ..., candidates: _Optional[_Iterable[_Union[Candidate, _Mapping]]] = ..., why: _Optional[str] = ..., flips: bool = ..., certain: bool = ...) -> None: ...

class DecisionList(_message.Message):
    __slots__ = ("decisions",)
    DECISIONS_FIELD_NUMBER: _ClassVar[int]
    decisions: _containers.RepeatedCompositeFieldContainer[Decision]
    def __init__(self, decisions: _Optional[_Iterable[_Union[Decision, _Mapping]]] = ...) -> None: ...

class Plan(_message.Message):
    __slots__ = ("task_id", "path_m", "goal", "purpose")
    TASK_ID_FIELD_NUMBER: _ClassVar[int]
    PATH_M_FIELD_NUMBER: _ClassVar[int]
    GOAL_FIELD_NUMBER: _ClassVar[int]
    PURPOSE_FIELD_NUMBER: _ClassVar[int]
    task_id: str
    path_m: _containers.RepeatedScalarFieldContainer[float]
    goal: _common_pb2.Pose2
    purpose: str
    def __init__(self, task_id: _Optional[str] = ..., path_m: _Optional[_Iterable[float]] = ..., goal: _Optional[_Union[_common_pb2.Pose2, _Mapping]] = ..., purpose: _Optional[str] = ...) -> None: ...

class ServiceStatus(_message.Message):
    __slots__ = ("service", "instance", "state", "reason", "pid", "uptime_s", "metrics")
    class MetricsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    SERVICE_FIELD_NUMBER: _ClassVar[int]
    INSTANCE_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    PID_FIELD_NUMBER: _ClassVar[int]
    UPTIME_S_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    service: str
    instance: str
    state: str
    reason: str
    pid: int
    uptime_s: float
    metrics: _containers.ScalarMap[str, float]
    def __init__(self, service: _Optional[str] = ..., instance: _Optional[str] = ..., state: _Optional[str] = ..., reason: _Optional[str] = ..., pid: _Optional[int] = ..., uptime_s: _Optional[float] = ..., metrics: _Optional[_Mapping[str, float]] = ...) -> None: ...

class ProcessStatus(_message.Message):
    __slots__ = ("name", "pid", "restarts", "state", "reason")
    NAME_FIELD_NUMBER: _ClassVar[int]
    PID_FIELD_NUMBER: _ClassVar[int]
    RESTARTS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    name: str
    pid: int
    restarts: int
    state: str
    reason: str
    def __init__(self, name: _Optional[str] = ..., pid: _Optional[int] = ..., restarts: _Optional[int] = ..., state: _Optional[str] = ..., reason: _Optional[str] = ...) -> None: ...

class SupervisorStatus(_message.Message):
    __slots__ = ("processes",)
    PROCESSES_FIELD_NUMBER: _ClassVar[int]
    processes: _containers.RepeatedCompositeFieldContainer[ProcessStatus]
    def __init__(self, processes: _Optional[_Iterable[_Union[ProcessStatus, _Mapping]]] = ...) -> None: ...

class SettingsReply(_message.Message):
    __slots__ = ("json",)
    JSON_FIELD_NUMBER: _ClassVar[int]
    json: str
    def __init__(self, json: _Optional[str] = ...) -> None: ...
