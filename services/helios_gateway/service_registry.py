"""State of every service: its own report, its liveliness, and the supervisor's report."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping

from helios_core import proto as pb
from helios_core.health import STOP_FAILS, is_health_state
from helios_core.printable_text import printable

from helios_gateway.api_models import Service, ServiceState

log = logging.getLogger(__name__)

# Services that a task needs.
REQUIRED_SERVICES = ("bridge", "detector", "objectmap", "map2d", "planner")
LISTED_SERVICES = ("router", *REQUIRED_SERVICES, "gateway")  # always listed
# Services that publish a ServiceStatus.
STATUS_PUBLISHERS = ("world", *REQUIRED_SERVICES, "gateway", "recorder", "ros2")
# Services that handle requests while they are degraded, if they have begun to work before. From
# then on they publish one of these metrics. The maps and the planner are degraded only while they
# refuse requests or the robot's description.
WORKS_DEGRADED: Mapping[str, tuple[str, ...]] = {
    "bridge": ("keyframes",),
    "detector": ("contexts_sought", "contexts_unknown"),
}


class ServiceRegistry:
    """State of all services. Thread-safe. `clock` is monotonic seconds."""

    def __init__(self, silent_after_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._lock = threading.Lock()
        self._silent_after_s = silent_after_s
        self._clock = clock
        self._alive: dict[str, dict[str, None]] = {}  # service -> its instances, oldest first
        self._was_alive: set[str] = set()
        self._statuses: dict[str, tuple[pb.ServiceStatus, float]] = {}
        self._begun: dict[str, set[str]] = {}  # service -> instances that have begun to work
        self._processes: dict[str, pb.ProcessStatus] = {}
        self._simulated = False

    def on_alive(self, service: str, instance: str, alive: bool) -> None:
        with self._lock:
            instances = self._alive.setdefault(service, {})
            if alive:
                instances[instance] = None
                self._was_alive.add(service)
            else:
                instances.pop(instance, None)
                self._begun.get(service, set()).discard(instance)

    def listener(self, service: str) -> Callable[[pb.ServiceStatus], None]:
        """Handler for the status of one service; it refuses a status that names another service."""

        def take(status: pb.ServiceStatus) -> None:
            if status.service != service:
                log.warning(
                    "a status of %r came on the key of %s; it is not taken", status.service, service
                )
                return
            self.on_status(status)

        return take

    def on_status(self, status: pb.ServiceStatus) -> None:
        with self._lock:
            self._statuses[status.service] = (status, self._clock())
            begun = any(name in status.metrics for name in WORKS_DEGRADED.get(status.service, ()))
            if status.state == "ready" or (status.state == "degraded" and begun):
                self._begun.setdefault(status.service, set()).add(status.instance)

    def on_supervisor(self, status: pb.SupervisorStatus) -> None:
        with self._lock:
            # Several machines may each run some services of the robot.
            self._processes |= {p.name: p for p in status.processes if p.name}

    def on_description(self, robot: pb.RobotDescription) -> None:
        with self._lock:
            self._simulated = robot.simulated

    def is_alive(self, service: str) -> bool:
        with self._lock:
            return bool(self._alive.get(service))

    def services(self) -> list[Service]:
        """All known services and those seen, in the order of the data flow."""
        with self._lock:
            seen = {*self._statuses, *self._processes} - {"supervisor"}
            if self._simulated:
                seen.add("world")
            first = ["router", "world"] if "world" in seen else ["router"]
            names = [*first, *(n for n in LISTED_SERVICES if n != "router")]
            names += sorted(seen - set(names))
            return [self._service(name) for name in names]

    def not_ready_reasons(self) -> list[str]:
        """Services that cannot do their part of a task now, with reasons; empty if all can."""
        with self._lock:
            states = {name: self._state(name) for name in REQUIRED_SERVICES}
            return [
                f"{name} is {state}" + (f": {reason}" if reason else "")
                for name, (state, reason) in states.items()
                if not (state == "ready" or (state == "degraded" and self._works_degraded(name)))
            ]

    def troubles(self) -> list[tuple[str, str, str]]:
        """(service, kind, reason) of each service with a fault; kind: degraded, silent or down.

        A service that has not been seen, or that has ended in an orderly way, has none. Without the
        router nothing is known of the others.
        """
        with self._lock:
            state, reason = self._router()
            if state == "down":
                return [("router", "down", reason)]
            out = []
            for name, (status, heard_s) in self._statuses.items():
                state, reason = self._state(name)
                silent = self._is_silent(heard_s)
                if state == "down" and status.state != "stopping" and name in self._was_alive:
                    out.append((name, "down", reason))
                elif state == "degraded":
                    out.append((name, "silent" if silent else "degraded", reason))
            return out

    def metrics(self) -> Mapping[str, Mapping[str, float]]:
        """Metrics that each service publishes."""
        with self._lock:
            return {name: dict(status.metrics) for name, (status, _) in self._statuses.items()}

    def _service(self, name: str) -> Service:
        state, reason = self._router() if name == "router" else self._state(name)
        process, said = self._processes.get(name), self._statuses.get(name)
        pid = said[0].pid if said and self._alive.get(name) else process.pid if process else 0
        return Service(
            name=name,
            state=state,
            reason=reason,
            restarts=process.restarts if process else 0,
            pid=pid or None,
        )

    def _state(self, name: str) -> tuple[ServiceState, str]:
        instances, said = self._alive.get(name, {}), self._statuses.get(name)
        if not instances:
            return "down", self._why_down(name)
        if said is None or said[0].instance not in instances:
            return "starting", "it is there and has not said how it is"
        status, heard_s = said
        if self._is_silent(heard_s):
            return "degraded", f"it has not reported for {self._clock() - heard_s:.0f} s"
        if not is_health_state(state := status.state):
            return "degraded", f"it reports a state {state!r} that nobody knows"
        return state, printable(status.reason)

    def _is_silent(self, heard_s: float) -> bool:
        return self._clock() - heard_s > self._silent_after_s

    def _works_degraded(self, name: str) -> bool:
        """True if a service that is shown as degraded handles requests in spite of its fault."""
        status, heard_s = self._statuses[name]
        return (
            name in WORKS_DEGRADED
            and status.state == "degraded"
            and not self._is_silent(heard_s)
            and status.instance in self._begun.get(name, ())
            and not status.metrics.get(STOP_FAILS, 0)
        )

    def _why_down(self, name: str) -> str:
        process = self._processes.get(name)
        if process is not None:
            return process.reason or f"the supervisor says: {process.state}"
        if name in self._statuses:
            return "it was there and is gone; start it again"
        return "it has not been seen; start it"

    def _router(self) -> tuple[ServiceState, str]:
        """State of the router, which publishes no status.

        A message from any other service proves that it works. The gateway's own status does not: it
        arrives without the router.
        """
        now = self._clock()
        heard = [now - at for name, (_, at) in self._statuses.items() if name != "gateway"]
        if heard and min(heard) <= self._silent_after_s:
            return "ready", ""
        process = self._processes.get("router")
        if process is not None and process.state != "running":
            return "down", process.reason or f"the supervisor says: {process.state}"
        if not heard:
            return "starting", "nothing has been heard over it"
        return "down", f"nothing has been heard over it for {min(heard):.0f} s"
