"""Prometheus metrics: the gateway's requests, and the metrics that each service publishes."""

from __future__ import annotations

import time
from collections.abc import Iterable

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.robot_registry import API_ROOT, ROBOT_ROOT, RobotRegistry

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")  # others count together
BUCKETS_S = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)


class Metrics:
    """Metrics of one application, in a registry of its own; nothing is global."""

    def __init__(self, robots: RobotRegistry, fleet: FleetQueue) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "helios_http_requests_total",
            "requests by route and status",
            ["method", "route", "status"],
            registry=self.registry,
        )
        self.seconds = Histogram(
            "helios_http_request_seconds",
            "time to the start of the answer",
            ["method", "route"],
            buckets=BUCKETS_S,
            registry=self.registry,
        )
        self.registry.register(_Services(robots))
        self.registry.register(_Faults(robots))
        self.registry.register(_Fleet(fleet))

    def text(self) -> tuple[bytes, str]:
        """Body and content type."""
        return generate_latest(self.registry), CONTENT_TYPE_PLAIN_0_0_4


class _Services(Collector):
    def __init__(self, robots: RobotRegistry) -> None:
        self._robots = robots

    def collect(self) -> Iterable[Metric]:
        ready = GaugeMetricFamily(
            "helios_ready", "1 where the robot can do a task now", labels=["robot"]
        )
        stopped = GaugeMetricFamily(
            "helios_stopped", "1 where the robot is stopped", labels=["robot"]
        )
        up = GaugeMetricFamily(
            "helios_service_ready", "1 where it is ready", labels=["robot", "service"]
        )
        restarts = GaugeMetricFamily(
            "helios_service_restarts", "restarts by the supervisor", labels=["robot", "service"]
        )
        figures = GaugeMetricFamily(
            "helios_service_figure",
            "what a service publishes of itself; the unit is in its name",
            labels=["robot", "service", "name"],
        )
        viewers = GaugeMetricFamily("helios_event_viewers", "open event streams", labels=["robot"])
        dropped = CounterMetricFamily(
            "helios_event_viewers_dropped",
            "event streams ended because their reader fell behind",
            labels=["robot"],
        )
        queue = GaugeMetricFamily(
            "helios_event_queue", "most events that wait for one reader", labels=["robot"]
        )
        for robot, served in self._robots.robots.items():
            status = served.monitor.status()
            ready.add_metric([robot], float(status.ready))
            stopped.add_metric([robot], float(status.stopped))
            for service in status.services:
                up.add_metric([robot, service.name], float(service.state == "ready"))
                restarts.add_metric([robot, service.name], service.restarts)
            for service, values in served.monitor.services.metrics().items():
                for name, value in values.items():
                    figures.add_metric([robot, service, name], value)
            viewers.add_metric([robot], served.monitor.events.viewers)
            dropped.add_metric([robot], served.monitor.events.dropped)
            queue.add_metric([robot], served.monitor.events.longest_queue)
        return [ready, stopped, up, restarts, figures, viewers, dropped, queue]


class _Fleet(Collector):
    def __init__(self, queue: FleetQueue) -> None:
        self._queue = queue

    def collect(self) -> Iterable[Metric]:
        waiting = GaugeMetricFamily("helios_fleet_tasks", "tasks of the fleet that have not ended")
        waiting.add_metric([], len(self._queue.open_tasks()))
        return [waiting]


class _Faults(Collector):
    def __init__(self, robots: RobotRegistry) -> None:
        self._robots = robots

    def collect(self) -> Iterable[Metric]:
        labels = ["robot", "source", "kind"]
        confirmed = GaugeMetricFamily(
            "helios_fault_confirmed", "1 where a fault is confirmed and not cleared", labels=labels
        )
        count = CounterMetricFamily(
            "helios_fault_occurrences", "occurrences of a fault", labels=labels
        )
        recordings = GaugeMetricFamily(
            "helios_fault_recording_bytes",
            "size of the recordings around faults",
            labels=["robot"],
        )
        for robot, served in self._robots.robots.items():
            for fault in served.monitor.faults.faults():
                values = [robot, fault.source, fault.kind]
                confirmed.add_metric(values, float(fault.state == "confirmed"))
                count.add_metric(values, fault.count)
            notes = served.monitor.faults.recordings()
            recordings.add_metric([robot], sum(note.bytes for note in notes))
        return [confirmed, count, recordings]


class RequestMetrics:
    """ASGI middleware that counts and times requests.

    The labels are the pattern of the route and a known method, so that ids and made-up methods
    create no new series.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began_s = time.perf_counter()
        started = False  # the answer

        def count(status: int) -> None:
            route = route_pattern(scope)
            method = scope["method"] if scope["method"] in METHODS else "other"
            if route == "other":
                method = "any"
            self._metrics.requests.labels(method, route, str(status)).inc()
            self._metrics.seconds.labels(method, route).observe(time.perf_counter() - began_s)

        async def counted(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                count(message["status"])
            await send(message)

        try:
            await self._app(scope, receive, counted)
        except Exception:
            if not started:
                count(500)
            raise


def route_pattern(scope: Scope) -> str:
    """Full path pattern of a request's route, such as `/v1/tasks/{id}`; `other` without a route.

    FastAPI leaves the route of an included router in the scope; its path lacks the prefix of the
    inclusion.
    """
    path = getattr(scope.get("route"), "path", None)
    if path is None:
        return "other"
    root = ""
    if "robot" in scope.get("path_params", {}):
        root = ROBOT_ROOT
    elif scope["path"].startswith(f"{API_ROOT}/"):
        root = API_ROOT
    return path if path.startswith(root) else root + path
