"""What each service may do on the bus: the table behind the router's access control.

A service publishes, subscribes to, serves and calls exactly what stands here. Tests compare the
table with the services' code, with a recorded run, and with what a router under it lets through.
"""

from __future__ import annotations

from dataclasses import dataclass

from helios_core import topics as t
from helios_core.topics import Method, Topic

Methods = tuple[Method, ...]
Topics = tuple[Topic, ...]

FLEET_BUS = "_detectors"  # robot name of the bus on which the detector processes find each other
FLEET_TOKEN = "detector-replica"  # liveliness of a process that may answer for several robots


@dataclass(frozen=True)
class Access:
    """Rights of one service on the keys of its robots."""

    publishes: Topics = ()
    subscribes: Topics = ()
    serves: Methods = ()
    calls: Methods = ()
    announces: tuple[str, ...] = ()  # names of services in liveliness tokens
    watches: bool = False  # sees which services are alive

    def __or__(self, other: Access) -> Access:
        """Rights of both."""
        return Access(
            _union(self.publishes, other.publishes),
            _union(self.subscribes, other.subscribes),
            _union(self.serves, other.serves),
            _union(self.calls, other.calls),
            _union(self.announces, other.announces),
            self.watches or other.watches,
        )


def _union(a: tuple, b: tuple) -> tuple:
    return tuple(dict.fromkeys((*a, *b)))


def _process(service: str) -> Access:
    """What `service_process.run_service` does for every service."""
    return Access(
        publishes=(t.status_topic(service),),
        serves=(t.settings_method(service), t.spans_method(service)),
        announces=(service,),
    )


SERVICES = (
    "world",
    "bridge",
    "detector",
    "objectmap",
    "map2d",
    "planner",
    "gateway",
    "recorder",
    "ros2",
)
_ACKS = (t.MAP2D_ACK, t.OBJECTMAP_ACK)
# Methods that a robot of your own serves (`--robot bus`), and the simulated world.
_WORLD = (
    t.WORLD_DESCRIBE,
    t.WORLD_STATE,
    t.WORLD_CAPTURE,
    t.WORLD_ACT,
    t.WORLD_WATCHED,
    t.WORLD_STOP,
    t.WORLD_CLEAR_STOP,
)
_TRUTH = tuple(method for method in t.METHODS if method.truth)
_OF_SERVICES = tuple(m for m in t.METHODS if not m.truth and m not in _WORLD)
_READING = (
    t.GET_STATE, t.VOCABULARY, t.OBJECTS, t.GAUSSIANS, t.OBJECT_DETAIL, t.EXPORT_OBJECTS,
    t.RENDER_OBJECTS, t.SNAPSHOT, t.PICTURE, t.SIGHT, t.MAP_CHANGES, t.PATH_COST, t.RECALL,
    t.CHECK, t.GET_TASK, t.LIST_TASKS, t.DECISIONS, t.STORED_OBJECTS,
)  # fmt: skip

ACCESS: dict[str, Access] = {
    "world": _process("world") | Access(
        serves=(*_WORLD, *_TRUTH), subscribes=(t.BRIDGE_HEARTBEAT,)
    ),
    # A robot of your own on the bus, in any language.
    "robot": Access(
        serves=_WORLD, subscribes=(t.BRIDGE_HEARTBEAT,), announces=("robot",)
    ),
    # CONTEXT: a driver that plays a recording, and frames pushed over HTTP, begin the search
    # themselves. ANY_STATUS: the player waits for the maps. Watching: the driver of Spot.
    "bridge": _process("bridge") | Access(
        publishes=(
            t.FRAME, t.KEYFRAME, t.ROBOT_STATE, t.ROBOT_DESCRIPTION, t.CONTEXT, t.BRIDGE_HEARTBEAT,
        ),
        subscribes=(t.DETECTOR_ACK, *_ACKS, t.CONTEXT, t.ANY_STATUS, t.PLANNER_HEARTBEAT),
        serves=(t.ACT, t.LEASE, t.STOP, t.CLEAR_STOP, t.GET_STATE, t.PUSH, t.ROBOT_CHECKS),
        calls=(t.ESTIMATE_DEPTH, *_WORLD),
        watches=True,
    ),
    # The acknowledgements and RETIRE: the detector of a recording repeats what was recorded.
    "detector": _process("detector") | Access(
        publishes=(t.OBSERVATION, t.DETECTOR_ACK, t.PREVIEW, t.CLAIM, *_ACKS),
        subscribes=(t.FRAME, t.KEYFRAME, t.CONTEXT, t.CLAIM, t.OBJECTMAP_ACK),
        serves=(t.VOCABULARY, t.EMBED_TEXT, t.ESTIMATE_DEPTH),
        calls=(t.RETIRE,),
    ),
    "objectmap": _process("objectmap") | Access(
        publishes=(t.OBJECTMAP_ACK, t.RETIRED),
        subscribes=(t.CONTEXT, t.ROBOT_STATE, t.OBSERVATION, t.RELOCALISATION),
        serves=(
            t.OBJECTS, t.WHAT_IF, t.RETIRE, t.HELD_OBJECT, t.NAMES_AT, t.RESET_OBJECTS, t.GAUSSIANS,
            t.SAVE_OBJECTS,
            t.LOAD_OBJECTS, t.EXPORT_OBJECTS, t.RENDER_OBJECTS, t.OBJECT_DETAIL, t.STORED_OBJECTS,
        ),
    ),
    "map2d": _process("map2d") | Access(
        publishes=(t.MAP2D_ACK, t.RELOCALISATION),
        subscribes=(
            t.CONTEXT, t.ROBOT_DESCRIPTION, t.ROBOT_STATE, t.KEYFRAME, t.OBSERVATION, t.FRAME,
        ),
        serves=(
            t.SNAPSHOT, t.MAP_CHANGES, t.PICTURE, t.SIGHT, t.PATH_COST, t.RECALL, t.SAVE_MAP2D,
            t.LOAD_MAP2D, t.RESET_MAP2D,
        ),
        calls=(t.EMBED_TEXT, t.OBJECTS, t.STORED_OBJECTS),
    ),
    "planner": _process("planner") | Access(
        publishes=(t.CONTEXT, t.TASK, t.DECISION, t.PLAN, t.PLANNER_HEARTBEAT),
        subscribes=(
            t.ROBOT_DESCRIPTION, *_ACKS, t.OBSERVATION,
            *(t.status_topic(name) for name in ("detector", "objectmap", "map2d")),
        ),
        serves=(
            t.SUBMIT, t.CHECK, t.GET_TASK, t.LIST_TASKS, t.CANCEL, t.PAUSE, t.RESUME, t.DECISIONS,
            t.RESERVE,
        ),
        calls=(
            t.ACT, t.LEASE, t.STOP, t.GET_STATE, t.VOCABULARY, t.OBJECTS, t.WHAT_IF, t.RETIRE,
            t.HELD_OBJECT, t.NAMES_AT, t.SNAPSHOT, t.settings_method("objectmap"),
        ),
        watches=True,  # a map that was away has lost keyframes
    ),
    "gateway": _process("gateway") | Access(
        subscribes=(
            t.SUPERVISOR, t.ROBOT_DESCRIPTION, t.ROBOT_STATE, t.FRAME, t.KEYFRAME, t.PREVIEW,
            t.OBSERVATION, *_ACKS, t.CONTEXT, t.TASK, t.DECISION, t.PLAN,
            *(t.status_topic(name) for name in SERVICES),
        ),
        calls=(
            t.ACT, t.LEASE, t.STOP, t.CLEAR_STOP, t.PUSH, t.ROBOT_CHECKS, t.VOCABULARY, t.OBJECTS,
            t.GAUSSIANS, t.STORED_OBJECTS,
            t.OBJECT_DETAIL, t.EXPORT_OBJECTS, t.RENDER_OBJECTS, t.RESET_OBJECTS, t.SAVE_OBJECTS,
            t.LOAD_OBJECTS, t.SNAPSHOT, t.PICTURE, t.RECALL, t.SAVE_MAP2D, t.LOAD_MAP2D,
            t.RESET_MAP2D, t.SUBMIT, t.CHECK, t.GET_TASK, t.LIST_TASKS, t.CANCEL, t.PAUSE,
            t.RESUME, t.DECISIONS, t.RESERVE, *(t.settings_method(name) for name in SERVICES),
            *(t.spans_method(name) for name in SERVICES),
        ),
        watches=True,
    ),
    "recorder": _process("recorder") | Access(
        subscribes=(*t.TOPICS, t.ANY_STATUS), calls=(t.SNAPSHOT, t.OBJECTS, t.GAUSSIANS)
    ),
    # Maps, objects and tasks for ROS, and the stop from there.
    "ros2": _process("ros2") | Access(
        subscribes=(t.PLAN, t.ROBOT_DESCRIPTION, t.ROBOT_STATE, t.TASK, t.ANY_STATUS),
        calls=(
            t.SNAPSHOT, t.OBJECTS, t.GAUSSIANS, t.SUBMIT, t.GET_TASK, t.CANCEL, t.STOP,
            t.CLEAR_STOP,
        ),
    ),
    "supervisor": Access(
        publishes=(t.SUPERVISOR,), subscribes=tuple(t.status_topic(name) for name in SERVICES)
    ),
    # A person with a tool on the bus: sees everything but the truth, and may stop the robot.
    "operator": Access(
        subscribes=(*t.TOPICS, t.ANY_STATUS), calls=(*_READING, t.STOP), watches=True
    ),
    # A program of your own that may drive the robot and change the maps.
    "program": Access(
        subscribes=(*t.TOPICS, t.ANY_STATUS), calls=_OF_SERVICES, watches=True
    ),
    "evaluation": Access(calls=(*_READING, t.SUBMIT, t.STOP, *_TRUTH), watches=True),
}  # fmt: skip
# Rights of a detector whose robot is simulated: only there it may use the truth.
SIMULATED_DETECTOR = Access(calls=(t.TRUTH_SEGMENTATION, t.WORLD_DESCRIBE))
# Rights of every detector on `FLEET_BUS`.
FLEET = _process("detector") | Access(announces=(FLEET_TOKEN,), watches=True)


def access_of(service: str, *, simulated: bool = False) -> Access:
    """Rights of a service on its robots' keys. Raises KeyError for an unknown service."""
    own = ACCESS[service]
    return own | SIMULATED_DETECTOR if simulated and service == "detector" else own
