"""All topics and methods of the bus: key, message types, quality of service.

Data:     helios/v1/<robot>/<service>/<stream>
Methods:  helios/v1/<robot>/svc/<service>/<method>
Truth:    helios/v1/<robot>/truth/**  (the simulated detector and the evaluation only)
Alive:    helios/v1/<robot>/alive/<service>/<instance>
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Generic, TypeVar

from google.protobuf.message import Message

from helios_core import proto as pb

M = TypeVar("M", bound=Message)
Req = TypeVar("Req", bound=Message)
Rep = TypeVar("Rep", bound=Message)

ROOT = "helios/v1"


class QoS(Enum):
    """Quality of service: guarantee of delivery to a receiver."""

    LATEST_WINS = auto()  # a slow reader gets the newest message; older ones are dropped
    NEVER_DROP = auto()  # every message, in order; acknowledgements pace the sender
    RETAINED = auto()  # as NEVER_DROP; a late subscriber also gets the last message


@dataclass(frozen=True)
class Topic(Generic[M]):
    """Stream of one message type."""

    name: str  # <service>/<stream>
    type: type[M]
    qos: QoS

    def key(self, robot: str) -> str:
        return f"{ROOT}/{robot}/{self.name}"


@dataclass(frozen=True)
class Method(Generic[Req, Rep]):
    """Remote call that returns a reply or a typed error."""

    name: str  # <service>/<method>
    request: type[Req]
    reply: type[Rep]
    truth: bool = False

    def key(self, robot: str) -> str:
        return f"{ROOT}/{robot}/{'truth/' if self.truth else ''}svc/{self.name}"


def alive_key(robot: str, service: str, instance: str) -> str:
    return f"{ROOT}/{robot}/alive/{service}/{instance}"


# --- bridge ---------------------------------------------------------------------------------
FRAME = Topic("bridge/frame", pb.Frame, QoS.LATEST_WINS)
KEYFRAME = Topic("bridge/keyframe", pb.Frame, QoS.NEVER_DROP)
ROBOT_STATE = Topic("bridge/state", pb.RobotState, QoS.RETAINED)
ROBOT_DESCRIPTION = Topic("bridge/description", pb.RobotDescription, QoS.RETAINED)
BRIDGE_HEARTBEAT = Topic("bridge/heartbeat", pb.Heartbeat, QoS.LATEST_WINS)  # to the robot
ACT = Method("bridge/act", pb.ActionRequest, pb.ActionResult)
LEASE = Method("bridge/lease", pb.LeaseRequest, pb.LeaseReply)
STOP = Method("bridge/stop", pb.StopRequest, pb.Empty)
CLEAR_STOP = Method("bridge/clear_stop", pb.Empty, pb.Empty)
GET_STATE = Method("bridge/get_state", pb.Empty, pb.RobotState)
PUSH = Method("bridge/push", pb.PushRequest, pb.PushReply)
ROBOT_CHECKS = Method("bridge/checks", pb.RobotChecksRequest, pb.RobotChecksReply)

# --- detector -------------------------------------------------------------------------------
OBSERVATION = Topic("detector/observation", pb.Observation, QoS.NEVER_DROP)
DETECTOR_ACK = Topic("detector/ack", pb.Ack, QoS.NEVER_DROP)
PREVIEW = Topic("detector/preview", pb.Preview, QoS.LATEST_WINS)
CLAIM = Topic("detector/claim", pb.Claim, QoS.NEVER_DROP)  # between replicas of the detector
VOCABULARY = Method("detector/vocabulary", pb.Empty, pb.VocabularyReply)
EMBED_TEXT = Method("detector/embed_text", pb.EmbedTextRequest, pb.EmbedTextReply)
ESTIMATE_DEPTH = Method("detector/estimate_depth", pb.DepthRequest, pb.DepthReply)

# --- maps -----------------------------------------------------------------------------------
OBJECTMAP_ACK = Topic("objectmap/ack", pb.Ack, QoS.NEVER_DROP)
OBJECTS = Method("objectmap/objects", pb.ObjectsRequest, pb.ObjectsReply)
WHAT_IF = Method("objectmap/what_if", pb.WhatIfRequest, pb.WhatIfReply)
RETIRE = Method("objectmap/retire", pb.RetireRequest, pb.RetireReply)
HELD_OBJECT = Method("objectmap/held", pb.HeldObjectRequest, pb.HeldObjectReply)
NAMES_AT = Method("objectmap/names_at", pb.NamesAtRequest, pb.NamesAtReply)
RETIRED = Topic("objectmap/retired", pb.Retired, QoS.NEVER_DROP)
GAUSSIANS = Method("objectmap/gaussians", pb.GaussiansRequest, pb.GaussiansReply)
RESET_OBJECTS = Method("objectmap/reset", pb.Empty, pb.Empty)
SAVE_OBJECTS = Method("objectmap/save", pb.Empty, pb.ObjectMapFile)
STORED_OBJECTS = Method("objectmap/stored", pb.Empty, pb.StoredObjectsReply)
LOAD_OBJECTS = Method("objectmap/load", pb.ObjectMapFile, pb.ObjectMapLoaded)
EXPORT_OBJECTS = Method("objectmap/export", pb.ExportRequest, pb.ExportReply)
RENDER_OBJECTS = Method("objectmap/render", pb.RenderRequest, pb.RenderReply)
OBJECT_DETAIL = Method("objectmap/detail", pb.ObjectRequest, pb.ObjectDetail)
MAP2D_ACK = Topic("map2d/ack", pb.Ack, QoS.NEVER_DROP)
SNAPSHOT = Method("map2d/snapshot", pb.SnapshotRequest, pb.MapSnapshot)
PICTURE = Method("map2d/picture", pb.PictureRequest, pb.PictureReply)
SIGHT = Method("map2d/sight", pb.SightRequest, pb.SightReply)
MAP_CHANGES = Method("map2d/changes", pb.MapChangesRequest, pb.MapChanges)
PATH_COST = Method("map2d/path_cost", pb.PathCostRequest, pb.PathCostReply)
RELOCALISATION = Topic("map2d/relocalisation", pb.Relocalisation, QoS.RETAINED)
RECALL = Method("map2d/recall", pb.RecallRequest, pb.RecallReply)
SAVE_MAP2D = Method("map2d/save", pb.SaveMap2DRequest, pb.SaveMap2DReply)
LOAD_MAP2D = Method("map2d/load", pb.LoadMap2DRequest, pb.LoadMap2DReply)
RESET_MAP2D = Method("map2d/reset", pb.Empty, pb.Empty)

# --- planner --------------------------------------------------------------------------------
CONTEXT = Topic("planner/context", pb.SearchContext, QoS.RETAINED)
PLANNER_HEARTBEAT = Topic("planner/heartbeat", pb.Heartbeat, QoS.LATEST_WINS)  # to the bridge
TASK = Topic("planner/task", pb.Task, QoS.RETAINED)
DECISION = Topic("planner/decision", pb.Decision, QoS.NEVER_DROP)
PLAN = Topic("planner/plan", pb.Plan, QoS.RETAINED)
MAX_INSTRUCTION_CHARACTERS = 400  # of a SubmitRequest
SUBMIT = Method("planner/submit", pb.SubmitRequest, pb.Task)
CHECK = Method("planner/check", pb.SubmitRequest, pb.Task)  # what it would be; nothing is queued
GET_TASK = Method("planner/get", pb.TaskRequest, pb.Task)
LIST_TASKS = Method("planner/list", pb.Empty, pb.TaskList)
CANCEL = Method("planner/cancel", pb.TaskRequest, pb.Task)
PAUSE = Method("planner/pause", pb.TaskRequest, pb.Task)
RESUME = Method("planner/resume", pb.TaskRequest, pb.Task)
DECISIONS = Method("planner/decisions", pb.TaskRequest, pb.DecisionList)
RESERVE = Method("planner/reserve", pb.ReserveRequest, pb.ReserveReply)

# --- health ---------------------------------------------------------------------------------
SUPERVISOR = Topic("supervisor/processes", pb.SupervisorStatus, QoS.RETAINED)


def status_topic(service: str) -> Topic[pb.ServiceStatus]:
    """Topic of a service's status."""
    return Topic(f"{service}/status", pb.ServiceStatus, QoS.RETAINED)


ANY_STATUS = status_topic("*")


def settings_method(service: str) -> Method[pb.Empty, pb.SettingsReply]:
    """Method that returns the settings of a running service."""
    return Method(f"{service}/settings", pb.Empty, pb.SettingsReply)


def spans_method(service: str) -> Method[pb.SpansRequest, pb.SpansReply]:
    """Method that returns the spans of a running service that traces."""
    return Method(f"{service}/spans", pb.SpansRequest, pb.SpansReply)


# --- the simulated world --------------------------------------------------------------------
WORLD_DESCRIBE = Method("world/describe", pb.Empty, pb.RobotDescription)
WORLD_STATE = Method("world/state", pb.Empty, pb.RobotState)
WORLD_CAPTURE = Method("world/capture", pb.Empty, pb.WorldCapture)
WORLD_ACT = Method("world/act", pb.WorldActRequest, pb.ActionResult)
WORLD_WATCHED = Method("world/watched", pb.Empty, pb.WorldCaptures)
WORLD_STOP = Method("world/stop", pb.StopRequest, pb.Empty)
WORLD_CLEAR_STOP = Method("world/clear_stop", pb.Empty, pb.Empty)
TRUTH_SEGMENTATION = Method(
    "world/segmentation", pb.TruthSegmentationRequest, pb.TruthSegmentation, truth=True
)
TRUTH_EPISODE = Method("world/episode", pb.Empty, pb.TruthEpisode, truth=True)
TRUTH_METRICS = Method("world/metrics", pb.Empty, pb.TruthMetrics, truth=True)
TRUTH_OBJECTS = Method("world/objects", pb.Empty, pb.TruthObjects, truth=True)
TRUTH_TRACE = Method("world/trace", pb.TruthTraceRequest, pb.TruthTrace, truth=True)

TOPICS: tuple[Topic, ...] = (
    FRAME, KEYFRAME, ROBOT_STATE, ROBOT_DESCRIPTION, OBSERVATION, DETECTOR_ACK, PREVIEW, CLAIM,
    OBJECTMAP_ACK, RETIRED, MAP2D_ACK, CONTEXT, TASK, DECISION, PLAN, SUPERVISOR, BRIDGE_HEARTBEAT,
    PLANNER_HEARTBEAT, RELOCALISATION,
)  # fmt: skip
METHODS: tuple[Method, ...] = (
    ACT, LEASE, STOP, CLEAR_STOP, GET_STATE, PUSH, ROBOT_CHECKS, VOCABULARY, EMBED_TEXT,
    ESTIMATE_DEPTH, OBJECTS, WHAT_IF, RETIRE, HELD_OBJECT, NAMES_AT, GAUSSIANS, RESET_OBJECTS,
    SAVE_OBJECTS, LOAD_OBJECTS, EXPORT_OBJECTS,
    RENDER_OBJECTS, OBJECT_DETAIL, SNAPSHOT, PICTURE, SIGHT, MAP_CHANGES, PATH_COST, RECALL,
    SAVE_MAP2D, LOAD_MAP2D, RESET_MAP2D, SUBMIT, CHECK, STORED_OBJECTS,
    GET_TASK, LIST_TASKS, CANCEL, PAUSE, RESUME, DECISIONS, RESERVE, WORLD_DESCRIBE,
    WORLD_STATE, WORLD_CAPTURE, WORLD_ACT, WORLD_WATCHED, WORLD_STOP, WORLD_CLEAR_STOP,
    TRUTH_SEGMENTATION,
    TRUTH_EPISODE, TRUTH_METRICS, TRUTH_OBJECTS, TRUTH_TRACE,
)  # fmt: skip
