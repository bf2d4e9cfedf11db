"""`helios chaos`: play tasks while faults hit the services, and judge what became of them."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError
from helios_core.topics import TRUTH_OBJECTS

from helios_chaos.chaos_result import ChaosResult, PlayedFault
from helios_chaos.checks import journal_faults, map_faults
from helios_chaos.faults import Injector, must_stand
from helios_chaos.isolation import Abilities
from helios_chaos.messages import opened
from helios_chaos.schedule import KINDS, Fault, Kind, schedule
from helios_chaos.stack import Stack, open_bus, plan_for, running_stack
from helios_chaos.tasks import PlayedTask, TaskPlayer
from helios_chaos.witness import ControlChain, Witness

ACTS_WITHIN_S = 60.0  # then the robot counts as never acting again
FIRST_ACTION_S = 120.0
HITS_WITHIN_S = 20.0  # for a process that is being started again
LAST_TASK_S = 240.0  # for the last task, after the last fault
ANSWERS_WITHIN_S = 60.0
Say = Callable[[str], None]


@dataclass(frozen=True)
class ChaosPlan:
    """What to play: until `minutes` are over or `faults` were played."""

    minutes: float
    seed: int
    json_path: Path
    faults: int | None = None
    kinds: tuple[Kind, ...] = KINDS
    longest_s: float = 15.0  # of one fault
    logs: Path | None = None  # folder for a copy of the logs


def run_chaos(plan: ChaosPlan, able: Abilities, say: Say) -> ChaosResult:
    """Play the plan and write its JSON. Raises HeliosError if HELIOS does not start."""
    kinds = able.playable(plan.kinds)
    with run_folder() as out:
        stack_plan = plan_for(able, out, plan.seed)
        stack_plan = replace(stack_plan, clock="clock" in kinds)
        say("starting HELIOS in a simulated home")
        with running_stack(stack_plan) as (stack, orphans):
            try:
                stack.wait_ready()
                result = _play(stack, plan, kinds, say)
            finally:
                if plan.logs is not None:
                    _copy_logs(stack, plan.logs)
        result.orphans = len(orphans)
        result.skipped = {k: why for k, why in able.skipped.items() if k in plan.kinds}
        ids = [task.id for task in result.tasks]
        result.journal_faults = journal_faults(stack.state_dir, ids)
    write_file(plan.json_path, json.dumps(result.as_json(), indent=1) + "\n")
    return result


def _play(stack: Stack, plan: ChaosPlan, kinds: tuple[Kind, ...], say: Say) -> ChaosResult:
    bus, tap = open_bus(stack.router), opened(stack.router, plan.seed)
    witness, helios = Witness(bus), stack.client()
    chain = ControlChain(partial(open_bus, stack.router))
    try:
        player = TaskPlayer(helios, bus, plan.seed)
        player.start()
        began_s = time.monotonic()
        witness.wait_action(began_s, FIRST_ACTION_S)
        faults: list[PlayedFault] = []
        injector = Injector(stack, tap)
        for fault in schedule(plan.seed, kinds, plan.longest_s):
            over = time.monotonic() - began_s >= plan.minutes * 60
            if over or len(faults) == plan.faults:
                break
            time.sleep(fault.rest_s)
            player.running.wait(ACTS_WITHIN_S)
            played = _play_fault(fault, injector, witness, chain, began_s)
            if played is None:
                say(f"left out {fault.kind} {fault.target}: there was nothing to hit")
                continue
            faults.append(played)
            say(_told(len(faults), played))
        say("no more faults; the last task may end")
        player.finish(LAST_TASK_S)
        minutes = (time.monotonic() - began_s) / 60
        tasks = _with_unknown(player.played, helios)
        truth = bus.call(TRUTH_OBJECTS, pb.Empty(), ANSWERS_WITHIN_S)
        return ChaosResult(
            minutes,
            plan.seed,
            tasks,
            faults,
            witness.between_actions_s(),
            _patient_map_faults(helios, truth),
        )
    finally:
        witness.close()
        chain.close()
        helios.close()
        tap.close()
        bus.close()


def _play_fault(
    fault: Fault, injector: Injector, witness: Witness, chain: ControlChain, run_began_s: float
) -> PlayedFault | None:
    """Play a fault; None if there was nothing to hit."""
    if not injector.can_hit(fault, HITS_WITHIN_S):
        return None
    began_s = time.monotonic()
    undo = injector.inject(fault)
    try:
        time.sleep(fault.lasts_s)
    finally:
        undo()
    ended_s = time.monotonic()
    must = must_stand(fault)
    if must and not fault.lasts_s:  # one that is over at once: its target is being started again
        may_drive_s = chain.whole_after(ended_s, ACTS_WITHIN_S)
    else:
        may_drive_s = partial(float, ended_s)
    acted_s = witness.wait_action(ended_s, ACTS_WITHIN_S)
    still_s = driving = None
    if must:
        drive = witness.drive_after(began_s)
        driving = len(drive) > 0
        if driving:
            still_s = round(min(float(drive[-1, 0]), may_drive_s()) - began_s, 3)
    return PlayedFault(
        round(began_s - run_began_s, 2),
        fault.kind,
        fault.target,
        round(ended_s - began_s, 2),
        fault.size,
        None if acted_s is None else round(acted_s - ended_s, 3),
        still_s,
        driving,
    )


def _with_unknown(played: list[PlayedTask], helios: Helios) -> list[PlayedTask]:
    """Played tasks, and those of the planner's list that the player does not know: it gave up on
    them, or an answer to it got lost. Their ends cannot be judged, so they count as lost."""
    known = {task.id for task in played}
    deadline_s = time.monotonic() + ANSWERS_WITHIN_S
    while True:
        try:
            listed = helios.tasks()
            break
        except HeliosError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.5)
    more = [
        PlayedTask(t.id, t.instruction, t.state, t.message, "nobody could follow it to its end")
        for t in listed
        if t.id not in known
    ]
    gone = known - {task.id for task in listed}
    return [
        replace(task, untrue="the planner does not know it any more") if task.id in gone else task
        for task in (*played, *more)
    ]


def _patient_map_faults(helios: Helios, truth: pb.TruthObjects) -> list[str]:
    """Faults of the maps, once the services had time to come back."""
    deadline_s = time.monotonic() + ANSWERS_WITHIN_S
    while (found := map_faults(helios, truth)) and time.monotonic() < deadline_s:
        time.sleep(2.0)
    return found


def _told(number: int, fault: PlayedFault) -> str:
    again = fault.acting_again_s
    acted = "did not act again" if again is None else f"acted again after {again:.2f} s"
    lasted = f" for {fault.lasted_s:.1f} s" if fault.lasted_s >= 0.1 else ""
    stood = "" if fault.still_after_s is None else f", stood after {fault.still_after_s:.2f} s"
    return f"{number:4d}  {fault.at_s:7.1f} s  {fault.kind} {fault.target}{lasted}: {acted}{stood}"


@contextmanager
def run_folder() -> Iterator[Path]:
    """Temporary folder; a file system that the run has mounted in it goes, too."""
    out = Path(tempfile.mkdtemp(prefix="helios-chaos-"))
    try:
        yield out
    finally:
        if (out / "state").is_mount():
            subprocess.run(["umount", "--lazy", str(out / "state")], check=False)
        shutil.rmtree(out, ignore_errors=True)


def _copy_logs(stack: Stack, to: Path) -> None:
    to.mkdir(parents=True, exist_ok=True)
    for log in (stack.plan.out / "up.log", *stack.state_dir.glob("logs/*")):
        shutil.copy(log, to / log.name)
