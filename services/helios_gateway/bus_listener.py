"""Bus subscriptions of the gateway: keeps the newest state for requests and publishes events."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.image_messages import ImageMessage
from helios_core.recording_format import channel_of
from helios_core.topics import (
    CONTEXT,
    DECISION,
    FRAME,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBSERVATION,
    PLAN,
    PREVIEW,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SUPERVISOR,
    TASK,
    M,
    Topic,
    status_topic,
)

from helios_gateway import api_map_models, api_models, message_conversion
from helios_gateway.camera_image import Camera
from helios_gateway.event_hub import BACKLOG, EventHub
from helios_gateway.faults import findings
from helios_gateway.faults.black_box import MB
from helios_gateway.faults.fault_monitor import FaultMonitor
from helios_gateway.faults.life_cycle import Fault, Finding
from helios_gateway.faults.messages import fault_model
from helios_gateway.map_cache import MapCache
from helios_gateway.service_registry import STATUS_PUBLISHERS, ServiceRegistry
from helios_gateway.settings import Settings

log = logging.getLogger(__name__)


class RobotMonitor:
    """Subscriber of all topics that the API shows. Thread-safe.

    Occurrences (tasks, decisions, plans, a stop) become events at once. State that changes all the
    time (the robot's pose, maps, services) is checked every `tick_s`.
    """

    def __init__(self, bus: Bus, settings: Settings) -> None:
        self.services = ServiceRegistry(settings.silent_after_s)
        self.camera = Camera()
        self.maps = MapCache(bus, settings.call_timeout_s)
        self.events = EventHub(BACKLOG, settings.max_viewers, settings.keepalive_s)
        folder = settings.faults and settings.faults / bus.robot
        self.faults = FaultMonitor(folder, settings.faults_mb * MB, self._on_fault)
        self._lock = threading.Condition()  # notified when the robot's state arrives
        self._ticking = threading.Lock()
        self._robot: api_models.RobotState | None = None
        self._description: api_models.RobotDescription | None = None
        self._published: dict[str, object] = {}
        self._told_faults: set[str] = set()  # ids of those that new subscribers are told of
        self._tick_s = settings.tick_s
        self._ended = threading.Event()
        self._ticker = threading.Thread(target=self._run, name="tick", daemon=True)

        bus.watch(self._on_alive)
        # By name, because `*/status` would also match the supervisor's.
        for service in STATUS_PUBLISHERS:
            self._hear(bus, status_topic(service), self.services.listener(service))
        self._hear(bus, SUPERVISOR, self._on_supervisor)
        self._hear(bus, ROBOT_DESCRIPTION, self._on_description)
        self._hear(bus, ROBOT_STATE, self._on_robot)
        self._hear_in_place(bus, FRAME, self.camera.on_frame)
        self._hear_in_place(bus, KEYFRAME, self.camera.on_frame)
        self._hear(bus, PREVIEW, self.camera.on_preview)
        self._hear_in_place(bus, OBSERVATION, self.camera.on_observation)
        self._hear(bus, MAP2D_ACK, self.maps.on_ack)
        self._hear(bus, OBJECTMAP_ACK, self.maps.on_ack)
        self._hear(bus, CONTEXT, lambda _: self.maps.on_change())
        self._hear(bus, TASK, self._on_task)
        self._hear(bus, DECISION, self._on_decision)
        self._hear(bus, PLAN, self._on_plan)

    def start(self) -> None:
        """Start the periodic check for changed state."""
        self._ticker.start()

    def close(self) -> None:
        self._ended.set()
        self.faults.close()
        self.events.close()

    def robot(self) -> api_models.Robot:
        with self._lock:
            state, description = self._robot, self._description
        return api_models.Robot(
            connected=self.services.is_alive("bridge"), state=state, description=description
        )

    def robot_when(self, stopped: bool, within_s: float) -> api_models.Robot:
        """Robot as soon as its last known state is stopped or not; as it is after `within_s`.

        The bridge publishes its state directly after the answer to a stop, and before the answer to
        other calls; even then the answer may arrive first.
        """
        with self._lock:
            self._lock.wait_for(
                lambda: self._robot is not None and self._robot.stopped == stopped, within_s
            )
        return self.robot()

    def status(self) -> api_models.Status:
        return api_models.Status(
            ready=not self.not_ready_reasons(),
            stopped=self.stopped,
            stop_reason=self.stop_reason,
            services=self.services.services(),
        )

    def task(self, message: pb.Task) -> api_models.Task:
        """HTTP model of a task, with the recordings around its failure."""
        self.faults.on_task(message)  # first: it names the recording of a failure
        return message_conversion.task(message, self.faults.recordings_of(message.id))

    @property
    def stopped(self) -> bool:
        """True if the last known state is stopped until clear-stop."""
        with self._lock:
            return self._robot is not None and self._robot.stopped

    @property
    def stop_reason(self) -> str:
        """Reason that the stop was given; empty while the robot is not stopped."""
        with self._lock:
            return self._robot.message if self._robot is not None and self._robot.stopped else ""

    def not_ready_reasons(self) -> list[str]:
        """Reasons why the robot cannot do a task now; empty if it can."""
        reasons = self.services.not_ready_reasons()
        if self.stopped:
            why = f" ({self.stop_reason})" if self.stop_reason else ""
            reasons.append(
                f"the robot is stopped{why}: it will not move until /v1/robot/clear-stop"
            )
        return reasons

    def tick(self) -> None:
        """Publish all state that has changed since the last call."""
        with self._ticking:
            robot = self.robot()
            if robot.state is not None or robot.description is not None:
                self._publish_if_changed("robot", "robot", robot)
            self._publish_if_changed("map", "map", self.maps.change())
            status = self.status()
            for service in status.services:
                self._publish_if_changed("service", f"service/{service.name}", service)
            readiness = api_models.Readiness(
                ready=status.ready,
                stopped=status.stopped,
                stop_reason=status.stop_reason,
                reasons=self.not_ready_reasons(),
            )
            self._publish_if_changed("ready", "ready", readiness)
            self.faults.observe(self._conditions())

    def _publish_if_changed(
        self,
        type: str,
        state_key: str,
        now: api_models.Robot
        | api_map_models.MapChange
        | api_models.Service
        | api_models.Readiness,
    ) -> None:
        if self._published.get(state_key) != now:
            self._published[state_key] = now
            self.events.publish(type, now, state_key)

    def _conditions(self) -> list[Finding]:
        """Faulty conditions of the services and the robot that are present now."""
        found = [findings.condition(*trouble) for trouble in self.services.troubles()]
        return [*found, findings.stop(self.stop_reason)] if self.stopped else found

    def _hear(self, bus: Bus, topic: Topic[M], handler: Callable[[M], None]) -> None:
        """Subscribe, and give every message to the black box as well."""
        bus.subscribe(topic, self._recorded(topic, handler))

    def _hear_in_place(
        self, bus: Bus, topic: Topic[M], handler: Callable[[ImageMessage[M]], None]
    ) -> None:
        """As `_hear`, with the images where they were received."""
        bus.subscribe_in_place(topic, self._recorded(topic, handler))

    def _recorded(self, topic: Topic, handler: Callable[[Any], None]) -> Callable[[Any], None]:
        channel = channel_of(topic)

        def take(message: Message | ImageMessage) -> None:
            self.faults.record(channel, message)
            handler(message)

        return take

    def _run(self) -> None:
        while not self._ended.wait(self._tick_s):
            try:
                self.tick()
            except Exception:
                log.exception("could not tell what has changed; trying again")

    def _on_alive(self, service: str, instance: str, alive: bool) -> None:
        self.services.on_alive(service, instance, alive)
        if service in ("map2d", "objectmap"):
            self.maps.on_change()

    def _on_supervisor(self, message: pb.SupervisorStatus) -> None:
        self.services.on_supervisor(message)
        self.faults.on_supervisor(message)

    def _on_fault(self, fault: Fault) -> None:
        model = fault_model(fault, self.faults.recordings())
        self.events.publish("fault", model, f"fault/{fault.id}")
        listed = {known.id for known in self.faults.faults()}
        with self._lock:
            self._told_faults.add(fault.id)
            dropped = self._told_faults - listed
            self._told_faults -= dropped
        for id in dropped:  # the list holds a limited number
            self.events.forget(f"fault/{id}")

    def _on_description(self, message: pb.RobotDescription) -> None:
        self.services.on_description(message)
        description = message_conversion.robot_description(message)
        with self._lock:
            self._description = description

    def _on_robot(self, message: pb.RobotState) -> None:
        state = message_conversion.robot_state(message)
        with self._lock:
            before, self._robot = self._robot, state
            self._lock.notify_all()
        if before is None or _immediate_fields(before) != _immediate_fields(state):
            self.tick()

    def _on_task(self, message: pb.Task) -> None:
        task = self.task(message)
        self.events.publish("task", task, "task", task.id, task.ended)

    def _on_decision(self, message: pb.Decision) -> None:
        self.events.publish(
            "decision", message_conversion.decision(message), "decision", message.task_id
        )

    def _on_plan(self, message: pb.Plan) -> None:
        self.maps.on_plan(message)
        self.events.publish("plan", message_conversion.plan(message), "plan", message.task_id)


def _immediate_fields(robot: api_models.RobotState) -> tuple[bool, str, str]:
    """Parts of the robot's state whose change is published at once."""
    return robot.stopped, robot.message if robot.stopped else "", robot.held
