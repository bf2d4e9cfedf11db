"""Action log: each action id is executed once, however often and by any client it is requested."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future

from helios_core import proto as pb
from helios_core.robot import ActionResult

REMEMBERED = 512


class ActionLog:
    """Results of the newest actions, and the futures of running ones."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._results: OrderedDict[str, Future[pb.ActionResult]] = OrderedDict()
        self._robot_results: OrderedDict[str, ActionResult] = OrderedDict()
        self.last_id = ""  # id of the newest action that the robot executed

    def once(self, action_id: str, do: Callable[[], pb.ActionResult]) -> pb.ActionResult:
        """Result of `do`, which is called only if the id is new.

        A second caller waits for the first. An action that raises is not stored and may be
        requested again; `robot_result` then does not repeat one that the robot has done.
        """
        mine: Future[pb.ActionResult] = Future()
        with self._lock:
            known = self._results.get(action_id)
            if known is None:
                self._results[action_id] = mine
                while len(self._results) > REMEMBERED:
                    self._results.popitem(last=False)
        if known is not None:
            return known.result()
        try:
            result = do()
        except BaseException as error:
            with self._lock:
                self._results.pop(action_id, None)
            mine.set_exception(error)
            raise
        mine.set_result(result)
        return result

    def robot_result(self, action_id: str, do: Callable[[], ActionResult]) -> ActionResult:
        """Robot's result for an action id. Calls `do` only the first time.

        The steps after an action may fail and be retried; this never moves the robot twice.
        """
        done = self._robot_results.get(action_id)
        if done is None:
            done = self._robot_results[action_id] = do()
            self.last_id = action_id
            while len(self._robot_results) > REMEMBERED:
                self._robot_results.popitem(last=False)
        return done
