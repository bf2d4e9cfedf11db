"""Python SDK over the HTTP interface.

    with Helios("http://127.0.0.1:8080") as helios:
        task = helios.submit("Move the mug from the coffee table to the kitchen counter")
        task = helios.wait(task.id, timeout_s=300)
        print(task.state, task.message)

Every call has a deadline. Errors are those of `helios_core.errors`: InvalidInput, Unavailable,
DeadlineExceeded, Conflict, Internal.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

import httpx
import numpy as np
from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    HeliosError,
    Internal,
    InvalidInput,
    Unavailable,
)
from numpy.typing import NDArray

from helios_client.tasks import Decision, Event, FoundObject, Task

POLL_S = 0.3
SILENCE_S = 30.0  # a gateway is restarted within seconds
CONNECT_S = 3.0
_KINDS: dict[int, type[HeliosError]] = {
    400: InvalidInput, 404: InvalidInput, 405: InvalidInput, 413: InvalidInput, 422: InvalidInput,
    409: Conflict, 503: Unavailable, 504: DeadlineExceeded,
}  # fmt: skip


class Helios:
    """A running HELIOS. Safe to use from several threads."""

    def __init__(
        self,
        base_url: str = "http://127.0.0.1:8080",
        timeout_s: float = 10.0,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._url = base_url.rstrip("/")
        self._timeout_s = timeout_s
        self._http = httpx.Client(
            base_url=self._url,
            timeout=httpx.Timeout(timeout_s, connect=min(CONNECT_S, timeout_s)),
            transport=transport,
            trust_env=False,  # a proxy of the environment is no way to a robot on loopback
        )

    # --- tasks --------------------------------------------------------------------------------
    def submit(self, instruction: str, max_steps: int | None = None) -> Task:
        """Queue a task. Raises InvalidInput when the instruction cannot be understood."""
        body: dict[str, Any] = {"instruction": instruction}
        if max_steps is not None:
            body["max_steps"] = max_steps
        return Task.from_json(self._json("POST", "/v1/tasks", body))

    def task(self, id: str) -> Task:
        """How a task is."""
        return Task.from_json(self._json("GET", f"/v1/tasks/{quote(id, safe='')}"))

    def tasks(self) -> tuple[Task, ...]:
        """All tasks, newest first."""
        return tuple(Task.from_json(t) for t in self._json("GET", "/v1/tasks")["tasks"])

    def cancel(self, id: str) -> Task:
        """Ask a task to end."""
        return Task.from_json(self._json("POST", f"/v1/tasks/{quote(id, safe='')}/cancel"))

    def wait(
        self,
        id: str,
        timeout_s: float,
        on_update: Callable[[Task], None] | None = None,
    ) -> Task:
        """The task once it has ended; `on_update` is told whenever it changed.

        A gateway that is being restarted is waited for, up to `SILENCE_S`. Raises DeadlineExceeded,
        and Unavailable when nobody answers any more.
        """
        deadline_s = heard_s = time.monotonic()
        deadline_s += timeout_s
        last: Task | None = None
        while True:
            try:
                task = self.task(id)
            except (Unavailable, DeadlineExceeded):
                if time.monotonic() > min(heard_s + SILENCE_S, deadline_s):
                    raise
            else:
                heard_s = time.monotonic()
                if on_update and task != last:
                    on_update(task)
                last = task
                if task.ended:
                    return task
                if heard_s > deadline_s:
                    raise DeadlineExceeded(
                        f"task {id} is still {task.state} after {timeout_s:g} s; wait longer, or "
                        "cancel it"
                    )
            time.sleep(POLL_S)

    def decisions(self, id: str) -> tuple[Decision, ...]:
        """Why the task went as it did, oldest first."""
        answer = self._json("GET", f"/v1/tasks/{quote(id, safe='')}/decisions")
        return tuple(Decision.from_json(d) for d in answer["decisions"])

    # --- maps and robot -----------------------------------------------------------------------
    def objects(self) -> tuple[FoundObject, ...]:
        """The instances of the object map."""
        return tuple(FoundObject.from_json(o) for o in self._json("GET", "/v1/objects")["objects"])

    def occupancy(self) -> dict[str, NDArray]:
        """The arrays of `/v1/map/occupancy.npz`: `occupancy` int8 (-1 unknown, 0, 100) and more."""
        return self._arrays("/v1/map/occupancy.npz")

    def value_layer(self, layer: str) -> dict[str, NDArray]:
        """The arrays of one value layer: `pick` or `place`."""
        return self._arrays(f"/v1/map/value/{quote(layer, safe='')}.npz")

    def picture(self, what: str = "occupancy") -> bytes:
        """PNG of the map: `occupancy` or `value/<layer>`."""
        return self._send("GET", f"/v1/map/{quote(what)}.png").content

    def frontiers(self) -> list[dict[str, Any]]:
        """The borders of what was seen since the search began."""
        return self._json("GET", "/v1/map/frontiers")["frontiers"]

    def camera(self) -> bytes:
        """JPEG of what the robot sees now."""
        return self._send("GET", "/v1/camera.jpg").content

    def stop_robot(self, reason: str = "asked for by the Python SDK") -> None:
        """Stop now; latches until `clear_stop`."""
        self._send("POST", "/v1/robot/stop", {"reason": reason})

    def clear_stop(self) -> None:
        """Allow the robot to move again."""
        self._send("POST", "/v1/robot/clear-stop")

    # --- the whole ----------------------------------------------------------------------------
    def status(self) -> dict[str, Any]:
        """`{ready, services: [{name, state, reason, restarts, pid}]}`."""
        return self._json("GET", "/v1/status")

    def ready(self) -> bool:
        """Whether a task submitted now would start; False where nobody answers."""
        try:
            return self._http.get("/readyz").status_code == httpx.codes.OK
        except httpx.TransportError:
            return False

    def events(self, silent_after_s: float = 30.0) -> Iterator[Event]:
        """What happens, as it happens, without an end.

        Raises DeadlineExceeded after so long a silence (the gateway sends signs of life).
        """
        timeout = httpx.Timeout(self._timeout_s, read=silent_after_s)
        try:
            with self._http.stream("GET", "/v1/events", timeout=timeout) as response:
                if response.is_error:
                    response.read()
                    raise self._error(response)
                yield from parse_events(response.iter_lines())
        except httpx.TransportError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    # --- transport ----------------------------------------------------------------------------
    def _send(self, verb: str, path: str, body: dict[str, Any] | None = None) -> httpx.Response:
        try:
            response = self._http.request(verb, path, json=body)
        except httpx.TransportError as error:
            raise self._lost(error) from error
        if response.is_error:
            raise self._error(response)
        return response

    def _json(self, verb: str, path: str, body: dict[str, Any] | None = None) -> Any:
        response = self._send(verb, path, body)
        try:
            return response.json()
        except ValueError as error:
            raise Internal(f"{self._url}{path} answered no JSON; is HELIOS there?") from error

    def _arrays(self, path: str) -> dict[str, NDArray]:
        data = self._send("GET", path).content
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}

    def _lost(self, error: httpx.TransportError) -> HeliosError:
        if isinstance(error, httpx.ConnectError | httpx.ConnectTimeout):
            return Unavailable(f"nobody answers at {self._url}; start HELIOS with `helios up`")
        if isinstance(error, httpx.TimeoutException):
            return DeadlineExceeded(f"{self._url} gave no answer in time; see `helios status`")
        return Unavailable(f"{self._url} broke off ({error}); try again")

    def _error(self, response: httpx.Response) -> HeliosError:
        """The typed error that a problem+json answer stands for."""
        kind = _KINDS.get(response.status_code, Internal)
        try:
            detail = response.json()["detail"]
        except (ValueError, KeyError, TypeError):
            detail = f"{response.request.url} answered {response.status_code}; is HELIOS there?"
        return kind(str(detail))


def parse_events(lines: Iterable[str]) -> Iterator[Event]:
    """Server-sent events from their lines; comments and data that is no JSON object are skipped."""
    fields: dict[str, str] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(":")
            if name:
                value = value.removeprefix(" ")
                joined = name == "data" and "data" in fields
                fields[name] = f"{fields['data']}\n{value}" if joined else value
            continue
        try:
            data = json.loads(fields.get("data", ""))
        except ValueError:
            data = None
        if isinstance(data, dict):
            yield Event(fields.get("event", "message"), data, fields.get("id", ""))
        fields = {}
