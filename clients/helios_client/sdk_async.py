"""Python SDK over the HTTP interface, for asyncio.

    async with AsyncHelios("http://127.0.0.1:8080") as helios:
        task = await helios.submit("Move the mug from the coffee table to the kitchen counter")
        task = await helios.wait(task.id, timeout_s=300)
        print(task.state, task.message)

Every call has a deadline. Errors are those of `helios_core.errors`: InvalidInput, Unavailable,
DeadlineExceeded, Conflict, Internal.

`python -m scripts.generate_sdk` writes `helios_client.sdk`, the same without `await`, from this
file.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

import httpx
from helios_core.errors import DeadlineExceeded, Unavailable
from helios_core.name_rules import ANY_ROBOT
from numpy.typing import NDArray

from helios_client.answer_types import (
    Decision,
    DriveAnswer,
    Event,
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
)
from helios_client.http import requests
from helios_client.http.connection import EVENT_RETRY_S, POLL_S, SILENCE_S, Connection
from helios_client.http.errors import response_error, transport_error
from helios_client.http.server_sent_events import EventParser
from helios_client.http.task_polling import TaskWaitTimer
from helios_client.http.teleop import AsyncTeleop

T = TypeVar("T")


class AsyncHelios:
    """Client of a running HELIOS. For use in one event loop."""

    def __init__(
        self,
        base_url: str = "http://127.0.0.1:8080",
        timeout_s: float = 10.0,
        transport: httpx.AsyncBaseTransport | None = None,
        key: str | None = None,
        robot: str | None = None,
    ) -> None:
        """`key`: API key, if the gateway requires one. `robot`: name of one of its robots."""
        self._to = Connection(base_url, timeout_s, key, robot)
        self._http = httpx.AsyncClient(**self._to.options(), transport=transport)

    # --- tasks --------------------------------------------------------------------------------
    async def submit(
        self,
        instruction: str,
        max_steps: int | None = None,
        agent: str | None = None,
        time_limit_s: float | None = None,
        priority: int = 0,
        settings: Mapping[str, str | float] | None = None,
    ) -> Task:
        """Queue a task, with a limit on steps and on seconds. Queued tasks with a higher priority
        (-100 to 100) start first. `settings`: planner settings for this task alone, such as
        alpha_d. Raises InvalidInput if the instruction cannot be understood."""
        return await self._do(
            requests.submit(instruction, max_steps, agent, time_limit_s, priority, settings)
        )

    async def go(self, x_m: float, y_m: float, yaw_rad: float | None = None) -> Task:
        """Queue a task that drives to a point (world frame, metres) and turns to `yaw_rad` there
        (radians, counter-clockwise from the x axis; None: any heading)."""
        return await self._do(requests.go(x_m, y_m, yaw_rad))

    async def explore(self, time_limit_s: float | None = None) -> Task:
        """Queue a task that explores until all reachable floor is known, or its time is up. It
        succeeds in both cases."""
        return await self._do(requests.explore(time_limit_s))

    async def home(self) -> Task:
        """Queue a task that drives back to where the robot started in this world."""
        return await self._do(requests.home())

    async def task(self, id: str) -> Task:
        """One task by its id."""
        return await self._do(requests.task(id))

    async def tasks(self, state: str | None = None, limit: int | None = None) -> tuple[Task, ...]:
        """Tasks, newest first: all, or those in one state."""
        return await self._do(requests.tasks(state, limit))

    async def cancel(self, id: str) -> Task:
        """Request the end of a task."""
        return await self._do(requests.cancel(id))

    async def pause(self, id: str) -> Task:
        """Pause a task: start no further action until `resume`."""
        return await self._do(requests.pause(id))

    async def resume(self, id: str) -> Task:
        """Resume a paused task."""
        return await self._do(requests.resume(id))

    async def wait(
        self, id: str, timeout_s: float, on_update: Callable[[Task], None] | None = None
    ) -> Task:
        """Wait until a task has ended and return it; `on_update` is called after each change.

        While the gateway restarts, the call retries for up to `SILENCE_S`. Raises DeadlineExceeded,
        and Unavailable if the gateway no longer answers.
        """
        waiting = TaskWaitTimer(id, timeout_s, SILENCE_S)
        while True:
            try:
                task = await self.task(id)
            except (Unavailable, DeadlineExceeded):
                if waiting.gives_up():
                    raise
            else:
                if waiting.is_new(task) and on_update:
                    on_update(task)
                if task.ended:
                    return task
                waiting.check(task)
            await asyncio.sleep(POLL_S)

    async def decisions(self, id: str, changes: Sequence[str] = ()) -> tuple[Decision, ...]:
        """Decisions of a task with their reasons, oldest first. With `changes` such as
        "alpha_d=0.01", `recomputed` holds each decision under these settings."""
        return await self._do(requests.decisions(id, changes))

    async def trace(self, id: str) -> Trace:
        """Spans of a task that was submitted while tracing was on (`helios up --tracing`)."""
        return await self._do(requests.trace(id))

    async def faults(self) -> FaultList:
        """All known faults with their states and counts, and the recordings around them."""
        return await self._do(requests.faults())

    async def clear_fault(self, id: str) -> Fault:
        """Clear a fault, such as that of a failed task. Raises Conflict if it is still present."""
        return await self._do(requests.clear_fault(id))

    async def fault_recording(self, name: str) -> bytes:
        """The MCAP file of a recording around a fault."""
        return await self._do(requests.fault_recording(name))

    async def fleet(self) -> Fleet:
        """State of every robot of the gateway, and the open tasks of the fleet."""
        return await self._do(requests.fleet())

    async def submit_to_fleet(
        self,
        instruction: str,
        max_steps: int | None = None,
        agent: str | None = None,
        time_limit_s: float | None = None,
        priority: int = 0,
        settings: Mapping[str, str | float] | None = None,
        robot: str = ANY_ROBOT,
    ) -> FleetTask:
        """Queue a task for the fleet: it goes to the nearest idle robot whose map knows the thing,
        else to any idle one. `robot`: name of the robot that shall do it. Otherwise as `submit`."""
        task = requests.submit(instruction, max_steps, agent, time_limit_s, priority, settings)
        return await self._do(requests.submit_to_fleet(task, robot))

    async def fleet_task(self, id: str) -> FleetTask:
        """One task of the fleet by its id."""
        return await self._do(requests.fleet_task(id))

    async def fleet_tasks(
        self, state: str | None = None, limit: int | None = None
    ) -> tuple[FleetTask, ...]:
        """Tasks of the fleet, newest first: all, or those in one state."""
        return await self._do(requests.fleet_tasks(state, limit))

    async def cancel_fleet_task(self, id: str) -> FleetTask:
        """Request the end of a task of the fleet, also at the robot that does it."""
        return await self._do(requests.cancel_fleet_task(id))

    async def vocabulary(self) -> Vocabulary:
        """Names that a task may use: any name, or those of the detector."""
        return await self._do(requests.vocabulary())

    async def suggestions(self, limit: int = 3) -> Suggestions:
        """Names seen in this home, and at most `limit` tasks to try there."""
        return await self._do(requests.suggestions(limit))

    # --- maps and robot -----------------------------------------------------------------------
    async def objects(
        self, class_name: str | None = None, min_score: float | None = None
    ) -> tuple[FoundObject, ...]:
        """Instances of the object map: all, those of a class, or those with a score Ψ from
        `min_score` on."""
        return await self._do(requests.objects(class_name, min_score))

    async def stored_objects(
        self, class_name: str | None = None, min_score: float | None = None
    ) -> tuple[StoredObject, ...]:
        """Objects of a stored map that is not in use, because the robot has not found its place in
        it: all, those of a class, or those with a score Ψ from `min_score` on."""
        return await self._do(requests.stored_objects(class_name, min_score))

    async def object(self, id: int) -> FoundObject:
        """One instance of the object map, by its id."""
        return await self._do(requests.found_object(id))

    async def seen(self, prompt: str, limit: int = 5) -> Seen:
        """Places where something was seen: objects of that name, and at most `limit` past views
        that fit the prompt, with images."""
        return await self._do(requests.seen(prompt, limit))

    async def object_views(self, id: int, limit: int = 5) -> tuple[SeenView, ...]:
        """Past views that show an object, from different directions, best first, with images."""
        return await self._do(requests.object_views(id, limit))

    async def save_map(self) -> bytes:
        """Both maps as one ZIP file, complete enough to continue mapping from."""
        return await self._do(requests.save_map())

    async def load_map(self, data: bytes, same_frame: bool = False) -> LoadedMaps:
        """Replace both maps by those of `save_map`: both, or neither. A file of another world is
        stored instead, until the robot has found its place in it; `same_frame` says that its
        coordinates hold in the present world. Raises InvalidInput for another file, Conflict while
        a task is under way."""
        return await self._do(requests.load_map(data, same_frame))

    async def reset_map(self, only: Literal["objects", "occupancy"] | None = None) -> ResetMaps:
        """Discard both maps, or one, with its copy on disk. The next action begins a new map.
        Raises Conflict while a task is under way."""
        return await self._do(requests.reset_map(only))

    async def map_info(self) -> MapInfo:
        """Size, origin and layers of the 2D map."""
        return await self._do(requests.map_info())

    async def occupancy(self) -> dict[str, NDArray]:
        """Arrays of `/v1/map/occupancy.npz`, by name. With shape [rows, columns], row 0 at the
        smallest y, column 0 at the smallest x: `occupancy` int8 (-1 unknown, 0 free, 100 occupied),
        `explored` uint8 (1: seen since the search began), `top_m` float32 (m, highest obstacle, 0:
        none). `origin_m` [2] is the corner of the cell [0, 0] and `cell_m` its size, in metres in
        the world frame; `trajectory_m` [n, 2]; `robot_pose` [3] x (m), y (m), yaw (rad); `version`;
        per frontier `frontier_id`, `_center_m` [n, 2], `_size_m`, `_reachable`."""
        return await self._do(requests.arrays("occupancy"))

    async def value_layer(self, layer: str) -> dict[str, NDArray]:
        """Arrays of one value layer, `pick` or `place`: `value` float32 (no unit) and
        `explored`, with the same cells as those of `occupancy`; `origin_m`, `cell_m`,
        `robot_pose`, `version`."""
        return await self._do(requests.arrays(f"value/{layer}"))

    async def picture(self, what: str = "occupancy") -> bytes:
        """PNG image of the map: `occupancy` or `value/<layer>`."""
        return await self._do(requests.map_file(what, "png"))

    async def map_file(self, what: str, ending: str) -> bytes:
        """Map file of the HTTP interface: `occupancy` or `value/<layer>`, as `png` or `npz`."""
        return await self._do(requests.map_file(what, ending))

    async def ros_map(self) -> dict[str, bytes]:
        """Files `map.pgm` and `map.yaml` for ROS's map_server."""
        return await self._do(requests.ros_map())

    async def frontiers(self) -> list[Frontier]:
        """Frontiers between floor explored in this search and unexplored floor."""
        return await self._do(requests.frontiers())

    async def camera(self) -> bytes:
        """Current camera image as JPEG."""
        return await self._do(requests.camera())

    async def robot(self) -> RobotAnswer:
        """Connection, state and description of the robot."""
        return await self._do(requests.robot())

    async def stop_robot(self, reason: str = "asked for by the Python SDK") -> RobotAnswer:
        """Stop the robot at once; it stays stopped until `clear_stop`."""
        return await self._do(requests.stop_robot(reason))

    async def clear_stop(self) -> RobotAnswer:
        """Allow the robot to move again."""
        return await self._do(requests.clear_stop())

    async def drive(self, forward_m: float = 0.0, turn_rad: float = 0.0) -> DriveAnswer:
        """Make one short move: at most 0.5 m ahead (negative: back), or 0.6 rad on the spot
        (positive: left). Raises Conflict if a task or another client has the robot, or if it is
        stopped."""
        return await self._do(requests.drive(forward_m, turn_rad))

    def teleop(self) -> AsyncTeleop:
        """Drive by hand: `async with helios.teleop() as drive: await drive(forward=0.5, for_s=2)`.
        Raises Conflict, on entering, as `drive` does."""
        return AsyncTeleop(self._to)

    async def robot_checks(self, restart: bool = False) -> RobotChecks:
        """Results of the checks of the robot's set-up, from the images so far. With `restart`, the
        checks begin anew where the robot stands; move it with `drive` then."""
        return await self._do(requests.robot_checks(restart))

    # --- services and events ------------------------------------------------------------------
    async def status(self, robot: str | None = None) -> Status:
        """Health of every service, and readiness for a new task. `robot`: name of another robot of
        the gateway."""
        return await self._do(requests.status(robot))

    async def settings(self, service: str) -> dict[str, Any]:
        """Settings of a running service, by name."""
        return await self._do(requests.service_settings(service))

    async def ready(self) -> bool:
        """True if a task submitted now can be done; False if the gateway does not answer."""
        try:
            status = await self.status()
            return status["ready"]
        except (Unavailable, DeadlineExceeded):
            return False

    async def events(
        self,
        types: Iterable[str] = (),
        task_id: str | None = None,
        last_id: str = "",
        silence_s: float = SILENCE_S,
    ) -> AsyncIterator[Event]:
        """Events as they happen: all, those of some types, or those of one task until it has ended.

        A lost connection is resumed after the last event received. Raises Unavailable or
        DeadlineExceeded after `silence_s` without a line from the gateway, which sends keep-alive
        lines.
        """
        heard_s = time.monotonic()
        asked = tuple(types)
        while True:
            try:
                async for event in self._stream(asked, task_id, last_id, silence_s):
                    if event is not None:
                        last_id = event.id or last_id
                        yield event
                        if task_id and event.ends_task:
                            return
                    heard_s = time.monotonic()
                trouble = Unavailable(f"{self._to.url} ended the stream of events; try again")
            except (Unavailable, DeadlineExceeded) as error:
                trouble = error
            if time.monotonic() - heard_s >= silence_s:
                raise trouble
            await asyncio.sleep(EVENT_RETRY_S)

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    # --- transport ----------------------------------------------------------------------------
    async def _do(self, call: requests.Call[T]) -> T:
        try:
            response = await self._http.request(**self._to.request(call))
        except httpx.TransportError as error:
            raise transport_error(error, self._to.url) from error
        return call.answer(response)

    async def _stream(
        self, types: tuple[str, ...], task_id: str | None, last_id: str, silence_s: float
    ) -> AsyncIterator[Event | None]:
        """Yield, for each line received, the event that it completes, or None."""
        request = self._to.event_request(types, task_id, last_id, silence_s)
        parser = EventParser()
        try:
            async with self._http.stream(**request) as response:
                if response.is_error:
                    await response.aread()
                    raise response_error(response)
                async for line in response.aiter_lines():
                    yield parser.feed(line)
        except httpx.TransportError as error:
            raise transport_error(error, self._to.url) from error
