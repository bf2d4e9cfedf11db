"""`helios stop-distance`: how far the simulated robot drives after a stop, or without a service.

The robot drives at the speed of a real one. Metres and seconds count from the request, or from the
loss, to the last step of the drive that ran at that time. Every trial begins while the robot drives
straight ahead.
"""

from __future__ import annotations

import json
import os
import random
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from helios_client.sdk import Helios
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, Unavailable
from helios_eval.provenance import commit, machine

from helios_chaos.chaos_run import run_folder
from helios_chaos.figures import percentiles
from helios_chaos.isolation import Abilities
from helios_chaos.schedule import SERVICES
from helios_chaos.stack import PACE, Stack, open_bus, plan_for, running_stack
from helios_chaos.tasks import TaskPlayer
from helios_chaos.witness import Witness, length_m

CAUSES = ("gateway", "stop", "planner", "bridge link", "router")
DRIVES_M_S, DRIVES_WITHIN_S = 0.3, 120.0
OFFSET_S = 0.15  # longest delay after the robot was seen to drive
STANDS_S = 1.5  # after it, the drive of a trial is over
BACK_WITHIN_S = 60.0
REFUSES_S = 3.0  # a stopped robot is watched for this long
MOST_STILL_S = 1.0
Say = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """Path and duration of a drive after the stop or the loss."""

    metres: float
    seconds: float


@dataclass
class StopResult:
    """Result of all trials. latch: service -> the stop outlived its death."""

    seed: int
    trials: dict[str, list[Trial]] = field(default_factory=dict)
    latch: dict[str, bool] = field(default_factory=dict)
    unconfirmed: dict[str, Any] = field(default_factory=dict)

    def misses(self) -> list[str]:
        out = [f"the stop did not outlive the {name}" for name, ok in self.latch.items() if not ok]
        for cause, trials in self.trials.items():
            if (slowest_s := max((t.seconds for t in trials), default=0.0)) > MOST_STILL_S:
                out.append(f"{cause}: the robot stood after {slowest_s:.2f} s; wanted 1 s")
        if self.unconfirmed.get("told_as_stopped", True):
            out.append("a stop that the robot did not confirm was told as stopped")
        if self.unconfirmed.get("stopped_after_s") is None:
            out.append("a stop was not repeated until the robot confirmed it")
        return out

    def as_json(self) -> dict[str, Any]:
        return {
            "machine": machine(),
            "commit": commit(),
            "seed": self.seed,
            "pace": float(PACE),
            "causes": [
                {
                    "cause": cause,
                    "trials": len(trials),
                    "metres": percentiles([t.metres for t in trials], 50, 99),
                    "seconds": percentiles([t.seconds for t in trials], 50, 99),
                }
                for cause, trials in self.trials.items()
            ],
            "latch": self.latch,
            "unconfirmed": self.unconfirmed,
        }


def run_stop_distance(
    trials: int, seed: int, json_path: Path, able: Abilities, say: Say
) -> StopResult:
    """Run `trials` trials of each cause and write the JSON. Raises HeliosError if HELIOS does not
    start, or the robot does not drive."""
    result = StopResult(seed)
    with run_folder() as out, running_stack(plan_for(able, out, seed)) as (stack, _):
        say("starting HELIOS in a simulated home")
        stack.wait_ready()
        bus = open_bus(stack.router)
        witness, helios = Witness(bus), stack.client()
        try:
            scene = _Scene(stack, witness, helios, random.Random(seed))
            scene.measure("gateway", trials, scene.lose_gateway, result, say)
            player = TaskPlayer(helios, bus, seed)
            player.start()
            for cause, happen in (
                ("stop", scene.ask_to_stop),
                ("planner", scene.lose_planner),
                ("bridge link", scene.lose_bridge_link),
                ("router", scene.lose_router),
            ):
                scene.measure(cause, trials, happen, result, say)
            result.latch = scene.latch(say)
            result.unconfirmed = scene.unconfirmed(say)
            player.finish(0.0)
        finally:
            witness.close()
            helios.close()
            bus.close()
    write_file(json_path, json.dumps(result.as_json(), indent=1) + "\n")
    return result


class _Scene:
    def __init__(
        self, stack: Stack, witness: Witness, helios: Helios, random_: random.Random
    ) -> None:
        self._stack, self._witness, self._helios = stack, witness, helios
        self._random = random_

    def measure(
        self, cause: str, trials: int, happen: Callable[[], float], result: StopResult, say: Say
    ) -> None:
        """Run the trials of one cause. happen: lets it happen while the robot drives, and returns
        its time; everything works again afterwards."""
        found = result.trials.setdefault(cause, [])
        while len(found) < trials:
            at_s = happen()
            drive = self._witness.drive_after(at_s)
            if len(drive) > 1:  # else the robot had just arrived
                found.append(Trial(length_m(drive), float(drive[-1, 0]) - at_s))
                last = found[-1]
                say(f"{cause} {len(found)}: {last.metres:.3f} m in {last.seconds:.2f} s")

    # --- causes -------------------------------------------------------------------------------
    def ask_to_stop(self) -> float:
        self._until_it_drives()
        at_s = time.monotonic()
        answer = self._helios.stop_robot("a measured stop")
        if answer["state"] is not None and not answer["state"]["stopped"]:
            raise Unavailable("the robot did not confirm its stop")
        time.sleep(STANDS_S)
        self._patiently(self._helios.clear_stop)
        self._until_it_acts(time.monotonic())
        return at_s

    def lose_planner(self) -> float:
        return self._lose("planner")

    def lose_router(self) -> float:
        return self._lose("router")

    def lose_bridge_link(self) -> float:
        self._until_it_drives()
        link, at_s = self._stack.links["bridge"], time.monotonic()
        link.hold()
        time.sleep(STANDS_S)
        link.restore()
        self._until_it_acts(time.monotonic())
        return at_s

    def lose_gateway(self) -> float:
        """The gateway dies while a person drives by it."""
        deadline_s = time.monotonic() + DRIVES_WITHIN_S
        while True:
            with suppress(HeliosError), self._helios.teleop() as drive:
                while time.monotonic() < deadline_s:
                    drive(0.0, 1.0, for_s=self._random.uniform(0.3, 4.0))  # away from a wall
                    for _ in range(20):
                        if self._witness.wait_driving(0.1, 0.0):
                            at_s = time.monotonic()
                            os.kill(self._stack.pid("gateway"), signal.SIGKILL)
                            time.sleep(STANDS_S)
                            self._stack.wait_ready()
                            return at_s
                        drive(1.0, for_s=0.1)
            if time.monotonic() > deadline_s:
                raise Unavailable(f"no one could drive the robot within {DRIVES_WITHIN_S:g} s")
            time.sleep(0.5)

    def _lose(self, service: str) -> float:
        self._until_it_drives()
        at_s = time.monotonic()
        os.kill(self._stack.pid(service), signal.SIGKILL)
        self._until_it_acts(at_s + STANDS_S)
        return at_s

    # --- the latch ----------------------------------------------------------------------------
    def latch(self, say: Say) -> dict[str, bool]:
        """Stop the robot under a running task, and kill one service after the other."""
        self._until_it_drives()
        self._helios.stop_robot("a stop that shall hold")
        time.sleep(STANDS_S)
        out: dict[str, bool] = {}
        for service in ("router", *SERVICES):
            before = self._counts()
            os.kill(self._stack.pid(service), signal.SIGKILL)
            self._until_services_are_back()
            time.sleep(REFUSES_S)
            robot = self._patiently(self._helios.robot)
            held = robot["state"] is not None and robot["state"]["stopped"]
            out[service] = held and self._counts() == before
            say(f"{service} killed: the stop {'holds' if out[service] else 'is LOST'}")
        self._patiently(self._helios.clear_stop)
        self._until_it_acts(time.monotonic())
        return out

    def unconfirmed(self, say: Say) -> dict[str, Any]:
        """Ask for a stop while the robot cannot be reached."""
        self._until_it_drives()
        link = self._stack.links["world"]
        link.hold()
        error, told = "", False
        try:
            told = _told_as_stopped(self._helios.stop_robot("a stop that does not arrive"))
        except HeliosError as refused:
            error = refused.message
        told = told or _told_as_stopped(self._patiently(self._helios.robot))
        link.restore()
        back_s = time.monotonic()
        stopped_s = None
        while stopped_s is None and time.monotonic() < back_s + BACK_WITHIN_S:
            if _told_as_stopped(self._patiently(self._helios.robot)):
                stopped_s = round(time.monotonic() - back_s, 2)
            time.sleep(0.05)
        self._patiently(self._helios.clear_stop)
        say(f"a stop without the robot: told as stopped: {told}; stopped after {stopped_s} s")
        return {"told_as_stopped": told, "error": error, "stopped_after_s": stopped_s}

    # --- waiting ------------------------------------------------------------------------------
    def _until_it_drives(self) -> None:
        if not self._witness.wait_driving(DRIVES_M_S, DRIVES_WITHIN_S):
            raise Unavailable(f"the robot did not drive within {DRIVES_WITHIN_S:g} s")
        time.sleep(self._random.uniform(0.0, OFFSET_S))

    def _until_it_acts(self, after_s: float) -> None:
        if self._witness.wait_action(after_s, BACK_WITHIN_S) is None:
            raise Unavailable(f"the robot did not act within {BACK_WITHIN_S:g} s")

    def _counts(self) -> tuple[int, int]:
        counts = self._witness.counts(time.monotonic(), BACK_WITHIN_S)
        if counts is None:
            raise Unavailable("the simulated world does not answer")
        return counts.begun, counts.ended

    def _until_services_are_back(self) -> None:
        time.sleep(1.0)  # so that the loss is known
        deadline_s = time.monotonic() + BACK_WITHIN_S
        while time.monotonic() < deadline_s:
            services = self._patiently(self._helios.status)["services"]
            if all(one["state"] == "ready" for one in services):
                return
            time.sleep(0.2)
        raise Unavailable(f"the services were not ready within {BACK_WITHIN_S:g} s")

    def _patiently(self, call: Callable[[], Any]) -> Any:
        deadline_s = time.monotonic() + BACK_WITHIN_S
        while True:
            try:
                return call()
            except HeliosError:
                if time.monotonic() > deadline_s:
                    raise
                time.sleep(0.2)


def _told_as_stopped(robot: Any) -> bool:
    return robot["state"] is not None and robot["state"]["stopped"]
