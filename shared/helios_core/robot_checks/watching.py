"""Images while an action runs, for drivers whose `capture` may be called meanwhile."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from helios_core.errors import HeliosError
from helios_core.robot import ActionResult, Capture

log = logging.getLogger(__name__)

MOST_IMAGES = 60
END_WITHIN_S = 5.0  # wait for the last image after the action


def watched(
    act: Callable[[], ActionResult], capture: Callable[[], Capture], hz: float
) -> tuple[ActionResult, tuple[Capture, ...]]:
    """Result of `act`, and the images that `capture` took meanwhile in another thread, up to `hz`
    per second. An image that fails ends them. Use it for `RobotDriver.act_and_watch`."""
    ended, seen = threading.Event(), list[Capture]()

    def watch() -> None:
        try:
            while not ended.wait(1.0 / hz) and len(seen) < MOST_IMAGES:
                seen.append(capture())
        except HeliosError as error:
            log.info("no image while the robot moves: %s", error.message)

    thread = threading.Thread(target=watch, name="images of an action", daemon=True)
    thread.start()
    try:
        result = act()
    finally:
        ended.set()
        thread.join(END_WITHIN_S)
    return result, tuple(seen)
