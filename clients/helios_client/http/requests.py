"""Calls of the HTTP interface as values: the request, and the reader of its response.

The blocking and the asynchronous client send the same calls; nothing here does I/O.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar, cast
from urllib.parse import quote

import httpx
import numpy as np
from helios_core.errors import Internal
from numpy.typing import NDArray

from helios_client.answer_types import (
    Decision,
    DriveAnswer,
    Fault,
    FaultList,
    Fleet,
    FleetTask,
    FoundObject,
    Frontier,
    LoadedMaps,
    MapInfo,
    ResetMaps,
    RobotAnswer,
    RobotChecks,
    Seen,
    SeenView,
    Status,
    StoredObject,
    Suggestions,
    Task,
    Trace,
    Vocabulary,
    check_keys,
)
from helios_client.http.errors import response_error

T = TypeVar("T")
# What a reader raises for an answer of another form than HELIOS gives.
FOREIGN = (
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)

MAP_S = 180.0  # longest wait for both maps of a large home
DRIVE_S = 30.0  # one short move of a slow robot
SEEN_S = 20.0  # the text model may have to be loaded


@dataclass(frozen=True)
class Call(Generic[T]):
    """One request. `path` is relative to `/v1`, or to `/v1/robots/<robot>` unless `of_all`."""

    verb: str
    path: str
    read: Callable[[httpx.Response], T]
    body: dict[str, Any] | None = None
    query: Mapping[str, str | int | float | tuple[str, ...]] = field(default_factory=dict)
    content: bytes | None = None  # a body that is not JSON
    timeout_s: float | None = None  # None: the client's timeout
    of_all: bool = False  # it concerns all robots of the gateway

    def answer(self, response: httpx.Response) -> T:
        """Value read from the response. Raises the HeliosError that an error response stands
        for, and Internal for an answer that is none of HELIOS'."""
        if response.is_error:
            raise response_error(response)
        if not response.is_success:
            raise Internal(
                f"{response.request.url} answered {response.status_code}, which redirects to "
                f"{response.headers.get('location', 'nowhere')}; give that address (HELIOS_URL)"
            )
        try:
            return self.read(response)
        except FOREIGN as error:
            raise Internal(
                f"{response.request.url} answered something else than expected; is HELIOS there?"
            ) from error


def event_query(types: Iterable[str], task_id: str | None) -> dict[str, str]:
    """Query of `/v1/events` that selects events."""
    out = {"types": ",".join(types), "task_id": task_id or ""}
    return {name: value for name, value in out.items() if value}


def submit(
    instruction: str,
    max_steps: int | None,
    agent: str | None,
    time_limit_s: float | None,
    priority: int,
    settings: Mapping[str, str | float] | None,
) -> Call[Task]:
    asked = {
        "instruction": instruction,
        "max_steps": max_steps,
        "agent": agent,
        "time_limit_s": time_limit_s,
        "priority": priority or None,
        "settings": dict(settings) if settings else None,
    }
    body = {name: value for name, value in asked.items() if value is not None}
    return Call("POST", "/tasks", lambda r: Task.from_json(_json(r)), body)


def task(id: str) -> Call[Task]:
    return Call("GET", f"/tasks/{_part(id)}", lambda r: Task.from_json(_json(r)))


def tasks(state: str | None, limit: int | None) -> Call[tuple[Task, ...]]:
    asked = {"state": state, "limit": limit}
    return Call(
        "GET",
        "/tasks",
        lambda r: tuple(Task.from_json(t) for t in _json(r)["tasks"]),
        query={name: value for name, value in asked.items() if value is not None},
    )


def cancel(id: str) -> Call[Task]:
    return Call("POST", f"/tasks/{_part(id)}/cancel", lambda r: Task.from_json(_json(r)))


def pause(id: str) -> Call[Task]:
    return Call("POST", f"/tasks/{_part(id)}/pause", lambda r: Task.from_json(_json(r)))


def resume(id: str) -> Call[Task]:
    return Call("POST", f"/tasks/{_part(id)}/resume", lambda r: Task.from_json(_json(r)))


def decisions(id: str, changes: Sequence[str] = ()) -> Call[tuple[Decision, ...]]:
    def read(response: httpx.Response) -> tuple[Decision, ...]:
        return tuple(Decision.from_json(d) for d in _json(response)["decisions"])

    query = {"set": tuple(changes)} if changes else {}
    return Call("GET", f"/tasks/{_part(id)}/decisions", read, query=query)


def trace(id: str) -> Call[Trace]:
    return Call("GET", f"/tasks/{_part(id)}/trace", lambda r: Trace.from_json(_json(r)))


def faults() -> Call[FaultList]:
    return Call("GET", "/faults", lambda r: FaultList.from_json(_json(r)))


def clear_fault(id: str) -> Call[Fault]:
    return Call("POST", f"/faults/{_part(id)}/clear", lambda r: Fault.from_json(_json(r)))


def fault_recording(name: str) -> Call[bytes]:
    return Call("GET", f"/faults/recordings/{_part(name)}", lambda r: r.content)


def fleet() -> Call[Fleet]:
    return Call("GET", "/fleet", _object_of(Fleet), of_all=True)


def submit_to_fleet(task: Call[Task], robot: str) -> Call[FleetTask]:
    """The task of `submit`, for a robot that the fleet chooses (any), or a named one."""
    body = (task.body or {}) | {"robot": robot}
    return Call("POST", "/fleet/tasks", _fleet_task, body, of_all=True)


def fleet_task(id: str) -> Call[FleetTask]:
    return Call("GET", f"/fleet/tasks/{_part(id)}", _fleet_task, of_all=True)


def fleet_tasks(state: str | None, limit: int | None) -> Call[tuple[FleetTask, ...]]:
    asked = {"state": state, "limit": limit}
    return Call(
        "GET",
        "/fleet/tasks",
        lambda r: tuple(FleetTask.from_json(t) for t in _json(r)["tasks"]),
        query={name: value for name, value in asked.items() if value is not None},
        of_all=True,
    )


def cancel_fleet_task(id: str) -> Call[FleetTask]:
    return Call("POST", f"/fleet/tasks/{_part(id)}/cancel", _fleet_task, of_all=True)


def vocabulary() -> Call[Vocabulary]:
    return Call("GET", "/vocabulary", _object_of(Vocabulary))


def suggestions(limit: int) -> Call[Suggestions]:
    return Call("GET", "/suggestions", _object_of(Suggestions), query={"limit": limit})


def objects(class_name: str | None, min_score: float | None) -> Call[tuple[FoundObject, ...]]:
    return Call(
        "GET",
        "/objects",
        lambda r: tuple(FoundObject.from_json(o) for o in _json(r)["objects"]),
        query=_given({"class": class_name, "min_score": min_score}),
    )


def stored_objects(
    class_name: str | None, min_score: float | None
) -> Call[tuple[StoredObject, ...]]:
    return Call(
        "GET",
        "/objects",
        lambda r: tuple(StoredObject.from_json(o) for o in _json(r)["stored"]),
        query=_given({"class": class_name, "min_score": min_score}),
    )


def found_object(id: int) -> Call[FoundObject]:
    return Call("GET", f"/objects/{id}", lambda r: FoundObject.from_json(_json(r)))


def map_info() -> Call[MapInfo]:
    return Call("GET", "/map", _object_of(MapInfo))


def frontiers() -> Call[list[Frontier]]:
    return Call("GET", "/map/frontiers", lambda r: _json(r)["frontiers"])


def arrays(what: str) -> Call[dict[str, NDArray]]:
    """`what`: `occupancy`, or `value/<layer>`."""
    return Call("GET", f"/map/{quote(what)}.npz", lambda r: _arrays(r.content))


def map_file(what: str, ending: str) -> Call[bytes]:
    """`what`: as for `arrays`; `ending`: png or npz."""
    return Call("GET", f"/map/{quote(what)}.{ending}", _content)


def ros_map() -> Call[dict[str, bytes]]:
    return Call("GET", "/map/ros.zip", lambda r: _unzipped(r.content), timeout_s=MAP_S)


def save_map() -> Call[bytes]:
    return Call("GET", "/map.zip", _content_of("application/zip"), timeout_s=MAP_S)


def load_map(data: bytes, same_frame: bool) -> Call[LoadedMaps]:
    query = {"same_frame": True} if same_frame else {}
    return Call(
        "PUT", "/map.zip", _object_of(LoadedMaps), query=query, content=data, timeout_s=MAP_S
    )


def reset_map(only: str | None) -> Call[ResetMaps]:
    query = {} if only is None else {"only": only}
    return Call("POST", "/map/reset", _object_of(ResetMaps), query=query, timeout_s=MAP_S)


def seen(prompt: str, limit: int) -> Call[Seen]:
    query = {"prompt": prompt, "limit": limit}
    return Call("GET", "/seen", lambda r: Seen.from_json(_json(r)), query=query, timeout_s=SEEN_S)


def object_views(id: int, limit: int) -> Call[tuple[SeenView, ...]]:
    return Call(
        "GET",
        f"/objects/{id}/views",
        lambda r: tuple(SeenView.from_json(view) for view in _json(r)["views"]),
        query={"limit": limit},
        timeout_s=SEEN_S,
    )


def camera() -> Call[bytes]:
    return Call("GET", "/camera.jpg", _content_of("image/jpeg"))


def robot() -> Call[RobotAnswer]:
    return Call("GET", "/robot", _object_of(RobotAnswer))


def stop_robot(reason: str) -> Call[RobotAnswer]:
    return Call("POST", "/robot/stop", _object_of(RobotAnswer), {"reason": reason})


def clear_stop() -> Call[RobotAnswer]:
    return Call("POST", "/robot/clear-stop", _object_of(RobotAnswer))


def go(x_m: float, y_m: float, yaw_rad: float | None) -> Call[Task]:
    body = {"x_m": x_m, "y_m": y_m} | ({} if yaw_rad is None else {"yaw_rad": yaw_rad})
    return Call("POST", "/robot/go", lambda r: Task.from_json(_json(r)), body)


def explore(time_limit_s: float | None) -> Call[Task]:
    body = {} if time_limit_s is None else {"time_limit_s": time_limit_s}
    return Call("POST", "/robot/explore", lambda r: Task.from_json(_json(r)), body)


def home() -> Call[Task]:
    return Call("POST", "/robot/home", lambda r: Task.from_json(_json(r)))


def drive(forward_m: float, turn_rad: float) -> Call[DriveAnswer]:
    asked = {"forward_m": forward_m, "turn_rad": turn_rad}
    body = {name: value for name, value in asked.items() if value}
    return Call("POST", "/robot/drive", _object_of(DriveAnswer), body, timeout_s=DRIVE_S)


def robot_checks(restart: bool) -> Call[RobotChecks]:
    verb = "POST" if restart else "GET"
    return Call(verb, "/robot/checks", _object_of(RobotChecks), timeout_s=DRIVE_S)


def status(robot: str | None) -> Call[Status]:
    if robot is None:
        return Call("GET", "/status", _object_of(Status))
    return Call("GET", f"/robots/{_part(robot)}/status", _object_of(Status), of_all=True)


def service_settings(service: str) -> Call[dict[str, Any]]:
    return Call("GET", f"/services/{_part(service)}/settings", lambda r: _json(r)["settings"])


def _fleet_task(response: httpx.Response) -> FleetTask:
    return FleetTask.from_json(_json(response))


def _part(text: str) -> str:
    return quote(text, safe="")


def _content(response: httpx.Response) -> bytes:
    return response.content


def _content_of(kind: str) -> Callable[[httpx.Response], bytes]:
    """Reader of the content of this media type. Raises Internal for another one."""

    def read(response: httpx.Response) -> bytes:
        came = response.headers.get("content-type", "nothing")
        if came.partition(";")[0].strip() != kind:
            raise Internal(f"{response.request.url} answered {came}, not {kind}; is HELIOS there?")
        return response.content

    return read


def _given(query: dict[str, Any]) -> dict[str, Any]:
    """Parameters that have a value."""
    return {name: value for name, value in query.items() if value is not None}


def _json(response: httpx.Response) -> Any:
    try:
        return response.json()
    except ValueError as error:
        raise Internal(f"{response.request.url} answered no JSON; is HELIOS there?") from error


def _object_of(kind: type[T]) -> Callable[[httpx.Response], T]:
    """Reader of a JSON object that has the required keys of a TypedDict."""

    def read(response: httpx.Response) -> T:
        answer = _json(response)
        check_keys(answer, cast(Any, kind).__required_keys__)
        return answer

    return read


def _arrays(data: bytes) -> dict[str, NDArray]:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def _unzipped(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as together:
        return {name: together.read(name) for name in together.namelist()}
