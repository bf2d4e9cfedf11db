"""Tasks and the stop for ROS users: topics with JSON, services, and the action DoTask.

`~/do_task` takes an instruction, or JSON as POST /v1/tasks does. `~/task` has the present task.
A stop never waits for the planner: calls that do so run in threads of their own, and the threads of
the ROS node stay free.
"""

from __future__ import annotations

import json
import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from google.protobuf.json_format import MessageToDict
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput
from helios_core.task_states import ENDED, HOLDS_ROBOT
from helios_core.topics import CANCEL, CLEAR_STOP, GET_TASK, STOP, SUBMIT, TASK

from helios_ros2.offered_qos import Qos
from helios_ros2.rclpy_loading import has_interface, interface, rclpy_module
from helios_ros2.ros_node import RosNode, qos_profile

log = logging.getLogger(__name__)

DO_TASK = "helios_msgs/action/DoTask"
CALL_S = 5.0
LOOK_S = 2.0  # period of the look at tasks whose end was not heard
REMEMBERED = 64  # goals whose cancel is remembered
MOST_CALLS = 16  # at a time
TOO_MANY = f"{MOST_CALLS} requests wait for the planner; send it again later"


class PlannerCalls:
    """Calls that may wait for the planner, each in a thread of its own."""

    def __init__(self) -> None:
        self._free = threading.Semaphore(MOST_CALLS)

    def start(self, call: Callable[[], object]) -> bool:
        """Run a call in the background; False if too many run."""
        if not self._free.acquire(blocking=False):
            return False
        threading.Thread(target=self._run, args=(call,), name="ros task", daemon=True).start()
        return True

    def _run(self, call: Callable[[], object]) -> None:
        try:
            call()
        finally:
            self._free.release()


class TaskInterface:
    """Topics and services of tasks. Callbacks may run at the same time in several threads."""

    def __init__(self, ros: RosNode, bus: Bus) -> None:
        self._bus, self._calls = bus, PlannerCalls()
        self._text = interface("std_msgs/msg/String")
        trigger = interface("std_srvs/srv/Trigger")
        group = rclpy_module("callback_groups").ReentrantCallbackGroup()
        kept = qos_profile(Qos(retained=True), 1)
        self._task = ros.node.create_publisher(self._text, "~/task", kept)
        self._refused = ros.node.create_publisher(self._text, "~/refused", 10)
        ros.node.create_subscription(
            self._text, "~/do_task", self._on_do_task, 10, callback_group=group
        )
        for name, call in (
            ("stop", self._stop),
            ("clear_stop", self._clear_stop),
            ("cancel", self._cancel),
        ):
            ros.node.create_service(
                trigger,
                f"~/{name}",
                lambda q, a, call=call: _answered(call, a),
                callback_group=group,
            )
        self._present = ""  # id of the running task
        self.action = None
        if has_interface(DO_TASK):
            self.action = DoTaskAction(ros, bus, group, self._calls)
        bus.subscribe(TASK, self._on_task)

    def close(self) -> None:
        """End the thread of the action."""
        if self.action is not None:
            self.action.close()

    def _on_task(self, task: pb.Task) -> None:
        runs = task.state in HOLDS_ROBOT
        if runs or self._present in ("", task.id):  # else it waits for another one
            self._task.publish(self._text(data=json.dumps(task_json(task))))
        if runs:
            self._present = task.id
        elif task.id == self._present:
            self._present = ""
        if self.action is not None:
            self.action.on_task(task)

    def _on_do_task(self, message: Any) -> None:
        if not self._calls.start(lambda: self._submit(message.data)):
            self._refuse(message.data, TOO_MANY)

    def _submit(self, text: str) -> None:
        try:
            self._bus.call(SUBMIT, submit_request(text), CALL_S)
        except HeliosError as error:
            self._refuse(text, error.message)

    def _refuse(self, text: str, why: str) -> None:
        log.warning("the task %r was refused: %s", text[:200], why)
        said = {"instruction": text, "error": why}
        self._refused.publish(self._text(data=json.dumps(said)))

    def _stop(self) -> str:
        self._bus.call(STOP, pb.StopRequest(reason="the ROS service ~/stop"), CALL_S)
        return "the robot is stopped; ~/clear_stop lets it move again"

    def _clear_stop(self) -> str:
        self._bus.call(CLEAR_STOP, pb.Empty(), CALL_S)
        return "the robot may move again"

    def _cancel(self) -> str:
        if not self._present:
            raise InvalidInput("no task runs")
        self._bus.call(CANCEL, pb.TaskRequest(id=self._present), CALL_S)
        return f"the task {self._present} is cancelled"


class DoTaskAction:
    """Action server of DoTask: feedback while the task runs; a cancelled goal cancels the task."""

    def __init__(self, ros: RosNode, bus: Bus, group: Any, calls: PlannerCalls) -> None:
        action = rclpy_module("action")
        self._ros, self._bus, self._calls = ros, bus, calls
        self._kind = interface(DO_TASK)
        self._lock = threading.Lock()
        self._goals: dict[str, tuple[Any, Any]] = {}  # task id -> goal handle, future of its end
        self._cancelled: deque[Any] = deque(maxlen=REMEMBERED)  # ids of goals
        self._accept = action.CancelResponse.ACCEPT
        self._server = action.ActionServer(
            ros.node,
            self._kind,
            "~/do_task",
            self._execute,
            cancel_callback=self._on_cancel,
            callback_group=group,
        )
        self._ending = threading.Event()
        self._looking = threading.Thread(target=self._look_on, name="looks at goals", daemon=True)
        self._looking.start()

    def close(self) -> None:
        """End the thread that looks at the tasks."""
        self._ending.set()

    def on_task(self, task: pb.Task) -> None:
        """Tell the goal of this task, if there is one."""
        with self._lock:
            handle, ended = self._goals.get(task.id, (None, None))
        if handle is None or ended.done():
            return
        if task.state in ENDED:
            ended.set_result(task)
            return
        feedback = self._kind.Feedback(
            task_id=task.id, phase=task.phase, message=task.message, progress=float(task.progress)
        )
        handle.publish_feedback(feedback)

    async def _execute(self, handle: Any) -> Any:
        goal = handle.request
        request = pb.SubmitRequest(
            instruction=goal.instruction, time_limit_s=max(0.0, goal.time_limit_s)
        )
        answer = self._future()
        if not self._calls.start(lambda: answer.set_result(self._submitted(request))):
            answer.set_result(TOO_MANY)
        task = await answer
        if isinstance(task, str):
            handle.abort()
            return self._kind.Result(state="refused", message=task)
        ended = self._future()
        with self._lock:
            self._goals[task.id] = (handle, ended)
            cancelled = self._is_cancelled(handle)  # `_on_cancel` found no task until now
        try:
            if cancelled:
                self._cancel_soon(task.id)
            task = await ended
        finally:
            with self._lock:
                self._goals.pop(task.id, None)
        if task.state == "succeeded":
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return self._kind.Result(
            succeeded=task.state == "succeeded",
            task_id=task.id,
            state=task.state,
            cause=task.cause,
            message=task.message,
        )

    def _on_cancel(self, handle: Any) -> Any:
        with self._lock:
            self._cancelled.append(handle.goal_id)
            ids = [id for id, (goal, _) in self._goals.items() if goal.goal_id == handle.goal_id]
        for id in ids:
            self._cancel_soon(id)
        return self._accept

    def _is_cancelled(self, handle: Any) -> bool:
        """True if a cancel has come. `is_cancel_requested` is true only after `_on_cancel`."""
        return handle.goal_id in self._cancelled or handle.is_cancel_requested

    def _future(self) -> Any:
        """A future whose result wakes the executor, which then goes on with what waits for it."""
        future = rclpy_module("task").Future(executor=self._ros.executor)
        future.add_done_callback(lambda _: None)
        return future

    def _submitted(self, request: pb.SubmitRequest) -> pb.Task | str:
        """The submitted task, or the reason why it was refused."""
        try:
            return self._bus.call(SUBMIT, request, CALL_S)
        except HeliosError as error:
            return error.message

    def _cancel_soon(self, id: str) -> None:
        """Cancel a task in the background; `_look` repeats it until the task has ended."""
        self._calls.start(lambda: self._cancel(id))

    def _cancel(self, id: str) -> None:
        try:
            self._bus.call(CANCEL, pb.TaskRequest(id=id), CALL_S)
        except HeliosError as error:
            log.warning(
                "the task %s could not be cancelled, it is tried again: %s", id, error.message
            )

    def _look_on(self) -> None:
        while not self._ending.wait(LOOK_S):
            self._look()

    def _look(self) -> None:
        with self._lock:
            goals = [(id, self._is_cancelled(goal)) for id, (goal, _) in self._goals.items()]
        for id, cancelled in goals:
            try:
                task = self._bus.call(GET_TASK, pb.TaskRequest(id=id), CALL_S)
            except HeliosError as error:  # the planner may come back
                log.info("the task %s cannot be asked: %s", id, error.message)
                continue
            self.on_task(task)
            if cancelled and task.state not in ENDED:
                self._cancel(id)


def submit_request(text: str) -> pb.SubmitRequest:
    """Request of an instruction, or of JSON with `instruction`, `max_steps`, `time_limit_s` …

    Raises InvalidInput.
    """
    if not text.lstrip().startswith("{"):
        return pb.SubmitRequest(instruction=text.strip())
    try:
        fields = json.loads(text)
        settings = fields.pop("settings", {})
        if not isinstance(settings, dict):
            raise ValueError(f"settings is {settings!r:.80}, wanted names with values")
        own = {name: str(value) for name, value in settings.items()}
        return pb.SubmitRequest(**fields, settings=own)
    except (ValueError, TypeError, RecursionError) as error:
        why = "its JSON has too many levels" if isinstance(error, RecursionError) else error
        raise InvalidInput(
            f"this is no task: {why}; send an instruction, or JSON with instruction, max_steps, "
            "agent, time_limit_s, priority, settings"
        ) from error


def task_json(task: pb.Task) -> dict[str, Any]:
    """The task with the field names of the HTTP API."""
    return MessageToDict(task, preserving_proto_field_name=True)


def _answered(call: Any, response: Any) -> Any:
    try:
        response.message, response.success = call(), True
    except HeliosError as error:
        response.message, response.success = error.message, False
    return response
