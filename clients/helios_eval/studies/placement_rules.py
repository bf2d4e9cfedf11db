"""Comparison of two placement rules: the same object, receptacle and start, simulated physics.

    python -m helios_eval.studies.placement_rules --count 200 --out runs/placements

The robot starts near a receptacle with an object before it on the floor, picks it up, turns to the
receptacle, and places it by each rule (`place_rule` of the planner), each in a fresh world. 2D map,
base and skill are those of the services; the location of the receptacle is given. A placement
succeeds as in the benchmark: the object comes to rest on a receptacle of that class.

Seeds are homes; each gives up to `--per-home` placements. Results in the folder are not run again.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.robot import Pick
from helios_core.types import ObjectInstance
from helios_planner.manipulation import Manipulation
from helios_planner.motion_planning.base_placement import outline_of, tilt_towards
from helios_planner.navigation.base_controller import BaseController
from helios_planner.search.candidate_beliefs import MapBelief
from helios_planner.settings import PlaceRule, Settings
from helios_planner.task import TaskFailed
from helios_sim.episode_events import PlaceTried
from helios_sim.episode_tracker import reachable
from helios_sim.home import Episode, Home
from helios_sim.home.home_types import Receptacle
from helios_sim.world import World
from numpy.typing import NDArray

from helios_eval.episodes.episode_record import append_line
from helios_eval.episodes.home_presets import home_of
from helios_eval.ledger import FIRST_SEED
from helios_eval.report.interval_statistics import paired_difference, sign_test, wilson
from helios_eval.studies.development_homes import homes
from helios_eval.studies.jsonl_file import whole_lines
from helios_eval.studies.placement_robot import SimulatedRobot

RULES: tuple[PlaceRule, ...] = ("paper", "flat")
BEFORE_M = 0.5  # distance of the object ahead of the robot
AWAY_M = (0.5, 1.2)  # distance of the start from the receptacle's outline


@dataclass(frozen=True)
class Trial:
    """Task for both rules."""

    seed: int
    thing: str
    receptacle: str
    start: tuple[float, float, float]  # x (m), y (m), yaw (rad)


@dataclass(frozen=True)
class Outcome:
    """Result of a trial with one rule."""

    seed: int
    receptacle: str
    receptacle_class: str
    thing_class: str
    rule: PlaceRule
    succeeded: bool
    how: str  # succeeded, rolled off, fell beside, refused, not reached
    message: str
    steps: int
    preset: str = "ovmm-v1"  # of the homes


def as_instance(item: Receptacle) -> ObjectInstance:
    """Receptacle as an error-free instance of the object map."""
    c, s = math.cos(item.yaw_rad), math.sin(item.yaw_rad)
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    corners = signs * np.array(item.size_m[:2]) / 2 @ np.array([[c, s], [-s, c]])
    return ObjectInstance(
        id=1, class_name=item.class_name,
        center_m=np.array([item.x, item.y, item.size_m[2] / 2]), size_m=np.array(item.size_m),
        score=1.0, class_score=1.0, uncertainty=0.0, views=1, gaussians=1,
        probabilities={item.class_name: 1.0}, top_m=item.size_m[2],
        outline_m=corners + np.array([item.x, item.y]), detection_rate=1.0,
    )  # fmt: skip


def trials(kind: str, seed0: int, per_home: int) -> Iterator[Trial]:
    """Trials of one home after the other, from `seed0` on."""
    for seed in homes(seed0, max(1, FIRST_SEED - seed0)):
        home, rng = home_of(kind, seed), np.random.default_rng([seed, 0x91ACE])
        free, origin_m = reachable(home, 0.4)
        room_m = (
            cv2.distanceTransform(home.free_space(0.0, 0.05)[0].astype(np.uint8), cv2.DIST_L2, 5)
            * 0.05
        )
        found = 0
        for k in rng.permutation(len(home.receptacles)):
            item = home.receptacles[int(k)]
            start = _start_near(as_instance(item), free, room_m, origin_m, rng)
            if start is not None and found < per_home:
                found += 1
                thing = home.objects[int(rng.integers(len(home.objects)))]
                yield Trial(seed, thing.name, item.name, start)


def _start_near(
    item: ObjectInstance,
    free: NDArray[np.bool_],
    room_m: NDArray[np.floating],
    origin_m: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[float, float, float] | None:
    """Pose near a receptacle with free floor ahead for an object; None if there is none."""
    cells = np.argwhere(free)
    xy = (cells[:, ::-1] + 0.5) * 0.05 + origin_m
    hull = outline_of(item).astype(np.float32).reshape(-1, 1, 2)
    away = np.array([-cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in xy])
    xy = xy[(away >= AWAY_M[0]) & (away <= AWAY_M[1])]
    for x, y in rng.permutation(xy)[:40]:
        yaw = float(rng.uniform(-math.pi, math.pi))
        ahead = np.array([y + BEFORE_M * math.sin(yaw), x + BEFORE_M * math.cos(yaw)])
        row, column = ((ahead - origin_m[::-1]) / 0.05).astype(int)
        inside = 0 <= row < room_m.shape[0] and 0 <= column < room_m.shape[1]
        if inside and room_m[row, column] > 0.25:
            return float(x), float(y), yaw
    return None


def play(kind: str, trial: Trial, rule: PlaceRule) -> Outcome | None:
    """Result of one placement by one rule; None if the object could not be picked up first."""
    home = home_of(kind, trial.seed)
    item = home.receptacle(trial.receptacle)
    world = World(*_prepared(home, trial, item))
    try:
        furniture = as_instance(item)
        robot = SimulatedRobot(world, [furniture])
        settings = Settings(place_rule=rule)
        base = BaseController(robot, settings)
        skills = Manipulation(robot, base, settings, MapBelief(robot, settings), attempts=1)
        if not _hold(world, robot, trial.thing):
            return None
        try:
            middle = (item.x, item.y)
            base.turn_to(robot.pose().yaw_rad + robot.pose().bearing_rad(middle))
            base.tilt(settings.travel_tilt_rad)
            message = skills.place(furniture, item.class_name).name.lower()
            message = f"{message} {skills.last_reason}".strip()
        except TaskFailed as failure:
            message = f"{failure.cause}: {failure.message}"
        tries = [event for event in world.events if isinstance(event, PlaceTried)]
        how = _how(tries)
        thing = home.class_of(trial.thing)
        return Outcome(trial.seed, item.name, item.class_name, thing, rule, how == "succeeded",
                       how, message, robot.steps)  # fmt: skip
    finally:
        world.close()


def _prepared(home: Home, trial: Trial, item: Receptacle) -> tuple[Home, Episode]:
    """Home with the robot at its start and the object before it, and the task to bring it."""
    x, y, yaw = trial.start
    thing = next(t for t in home.objects if t.name == trial.thing)
    lies = (x + BEFORE_M * math.cos(yaw), y + BEFORE_M * math.sin(yaw), thing.size_m[2] / 2 + 0.01)
    things = tuple(replace(t, position_m=lies) if t is thing else t for t in home.objects)
    return (
        replace(home, start_pose=trial.start, objects=things),
        Episode(thing.class_name, "", item.class_name, ""),
    )


def _hold(world: World, robot: SimulatedRobot, thing: str) -> bool:
    """Look at the object and pick it up; True on success."""
    base = BaseController(robot, Settings())
    x, y, z = (float(v) for v in world.position_m(thing))
    pose = robot.pose()
    base.turn_to(pose.yaw_rad + pose.bearing_rad((x, y)))
    base.tilt(tilt_towards(pose.distance_m((x, y)), z, robot.description))
    return robot.act(Pick((x, y, z), world.home.class_of(thing))).succeeded


def _how(tries: Sequence[PlaceTried]) -> str:
    if not tries:
        return "not reached"
    last = tries[-1]
    if not last.released:
        return "refused"
    if last.placed:
        return "succeeded"
    return "rolled off" if last.rolled_off else "fell beside"


def report(outcomes: Sequence[Outcome]) -> str:
    """Markdown table of both rules and their difference, over the trials that both have done."""
    by_rule = {
        rule: {(o.seed, o.receptacle): o for o in outcomes if o.rule == rule} for rule in RULES
    }
    both = [key for key in by_rule[RULES[0]] if key in by_rule[RULES[1]]]
    if not both:
        raise InvalidInput("no placement was done by both rules; run more of them")
    lines = [
        "| rule | placed | 95 % | rolled off | fell beside | refused | not reached | n |",
        "|---|---|---|---|---|---|---|---|",
    ]
    won: dict[str, NDArray[np.float64]] = {}
    for rule in RULES:
        done = [by_rule[rule][key] for key in both]
        won[rule] = np.array([float(o.succeeded) for o in done])
        share = wilson(int(won[rule].sum()), len(done))
        count = Counter(o.how for o in done)
        lost = " | ".join(
            str(count[how]) for how in ("rolled off", "fell beside", "refused", "not reached")
        )
        lines.append(
            f"| {rule} | {100 * share.value:.1f} % | {100 * share.low:.1f} to "
            f"{100 * share.high:.1f} | {lost} | {len(done)} |"
        )
    gain = paired_difference(won["flat"], won["paper"])
    lines.append(
        f"\nflat - paper: {100 * gain.value:+.1f} points, 95 % interval "
        f"{100 * gain.low:+.1f} to {100 * gain.high:+.1f} (paired bootstrap); sign test "
        f"p = {sign_test(won['flat'], won['paper']):.2g}"
    )
    return "\n".join(lines) + "\n"


def run(kind: str, seed0: int, count: int, per_home: int, folder: Path) -> str:
    """Play the missing trials; return the report on all."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "placements.jsonl"
    outcomes = [Outcome(**line) for line in whole_lines(path)]
    if others := {o.preset for o in outcomes} - {kind}:
        raise InvalidInput(
            f"{path} holds placements in homes of {', '.join(others)}, not {kind}; name another "
            "folder with --out"
        )
    known = {(o.seed, o.receptacle, o.rule) for o in outcomes}
    done = 0
    for trial in trials(kind, seed0, per_home):
        if done >= count:
            break
        at = (trial.seed, trial.receptacle)
        played = [play(kind, trial, rule) for rule in RULES if (*at, rule) not in known]
        if None in played:
            continue
        done += 1
        for outcome in played:
            assert outcome is not None
            outcomes.append(outcome)
            append_line(path, json.dumps(asdict(outcome)))
    table = report(outcomes)
    write_file(folder / "placements.md", table)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=200, help="placements by each rule")
    parser.add_argument("--per-home", type=int, default=5, help="placements in one home, at most")
    parser.add_argument("--seed0", type=int, default=0, help="first home; below 1000")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    a = parser.parse_args()
    try:
        print(run(a.preset, a.seed0, a.count, a.per_home, a.out))
    except HeliosError as error:
        print(error.message, file=sys.stderr)
        raise SystemExit(1) from error


if __name__ == "__main__":
    main()
