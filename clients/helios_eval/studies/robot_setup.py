"""Does `helios doctor --robot` find the faults of a robot's set-up, and no others?

    python -m helios_eval.studies.robot_setup --healthy 200 --faulty 20 --out runs/robot-setup

Plays the doctor's routine in simulated homes, with a healthy robot and with injected faults
(`helios_sim.injected_faults`), with and without sensor noise. Writes one line per run to
`runs.jsonl`, which a second call continues, and the table to `table.md`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.robot import RobotDriver
from helios_core.robot_checks.checks import SETTLED, RobotChecks
from helios_core.robot_checks.direct_run import check_driver
from helios_sim.home import PRESETS, generate_home
from helios_sim.injected_faults import Faults, FaultyRobot
from helios_sim.sensor_noise import SENSORS
from helios_sim.world import World

from helios_eval.episodes.episode_record import append_line
from helios_eval.studies.development_homes import homes
from helios_eval.studies.jsonl_file import whole_lines

HEALTHY = ""
CLOSE = 0.2  # share of a fault's size within which its report is right


@dataclass(frozen=True)
class Kind:
    """A kind of fault: its name in `Faults`, the check that finds it, and its size there."""

    fault: str
    check: str
    size: float
    unit: float  # size in the finding's unit per size of the fault
    signed: bool = True

    def text(self, seed: int) -> str:
        """Faults of one run: every other home has the opposite sign."""
        sign = -1.0 if self.signed and seed % 2 else 1.0
        return f"{self.fault}={sign * self.size:g}"


KINDS = (
    Kind("pitch_deg", "pitch", 1.0, 1.0),
    Kind("roll_deg", "roll", 1.0, 1.0),
    Kind("height_m", "height", 0.03, 1.0),
    Kind("depth_percent", "depth scale", 1.0, 1.0),
    Kind("depth_percent", "depth scale", 3.0, 1.0),
    Kind("delay_ms", "time offset", 40.0, 1e-3),
    Kind("shift_px", "depth-colour registration", 4.0, 1.0),
    Kind("turn_percent", "heading drift", 3.0, 3.6),
    Kind("drive_percent", "distance drift", 5.0, 1.0),
    Kind("intrinsics_percent", "intrinsics", 100.0, 0.5, signed=False),
)


@dataclass(frozen=True)
class Run:
    """One run of the routine: the home, the injected faults, and value and verdict per check."""

    seed: int
    sensor: str
    faults: str
    cpu_s: float
    stopped: str  # why the routine ended early; empty if it did not
    verdicts: dict[str, str]
    values: dict[str, float]
    errors: dict[str, float]
    early: list[str] | None = None  # checks that were wrong on the way, from `SETTLED` images on


def play(robot: RobotDriver, seed: int, sensor: str, faults: str) -> Run:
    """Run the routine once. Raises HeliosError."""
    reasons: list[str] = []
    early: set[str] = set()

    def note(checks: RobotChecks) -> None:
        if checks.views >= SETTLED:
            early.update(f.name for f in checks.findings() if f.verdict == "wrong")

    began = time.process_time()
    findings = check_driver(
        FaultyRobot(robot, Faults.of(faults)),
        True,
        lambda result: reasons.append(result.reason),
        note,
    )
    return Run(
        seed,
        sensor,
        faults,
        time.process_time() - began,
        " ".join(reasons),
        {f.name: f.verdict for f in findings},
        {f.name: f.value for f in findings},
        {f.name: f.error for f in findings},
        sorted(early),
    )


def play_home(
    seed: int, sensor: str, preset: str, texts: Sequence[str], known: set[tuple[int, str, str]]
) -> Iterator[Run]:
    """Runs in one home with each of the faults.

    known: runs (seed, sensor, faults) that are left out. The robot goes on from where the run
    before left it.
    """
    wanted = [text for text in texts if (seed, sensor, text) not in known]
    if not wanted:
        return
    world = World(generate_home(seed, PRESETS[preset]), sensor=SENSORS[sensor])
    try:
        for text in wanted:
            yield play(world, seed, sensor, text)
    finally:
        world.close()


def table(runs: Sequence[Run]) -> str:
    """Markdown tables of false alarms on healthy robots, and of faults."""
    sensors = sorted({run.sensor for run in runs})
    lines = [
        "| sensor | healthy runs | with a false alarm at the end | with one on the way | "
        "checks that were not measured |",
        "|---|--:|--:|--:|---|",
    ]
    for sensor in sensors:
        healthy = [r for r in runs if r.sensor == sensor and r.faults == HEALTHY]
        alarms = sum("wrong" in r.verdicts.values() for r in healthy)
        missing: dict[str, int] = {}
        for run in healthy:
            for name, verdict in run.verdicts.items():
                missing[name] = missing.get(name, 0) + (verdict == "not measured")
        told = ", ".join(f"{name} {n}" for name, n in missing.items() if n)
        noted = [r for r in healthy if r.early is not None]
        on_the_way = f"{sum(bool(r.early) for r in noted)} of {len(noted)}"
        lines.append(f"| {sensor} | {len(healthy)} | {alarms} | {on_the_way} | {told} |")
    lines += [
        "",
        "| fault | sensor | runs | measured | reported | median size error | within 20 % | "
        "other checks wrong |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for kind in KINDS:
        for sensor in sensors:
            if row := _row(kind, [r for r in runs if r.sensor == sensor]):
                lines.append(row)
    return "\n".join(lines) + "\n"


def _row(kind: Kind, runs: Sequence[Run]) -> str:
    """Row of one kind of fault; empty without runs."""
    mine = [r for r in runs if r.faults in (kind.text(0), kind.text(1))]
    if not mine:
        return ""
    found = [r for r in mine if r.verdicts[kind.check] == "wrong"]
    measured = sum(r.verdicts[kind.check] != "not measured" for r in mine)
    off = [
        abs(r.values[kind.check] / (float(r.faults.split("=")[1]) * kind.unit) - 1.0) for r in found
    ]
    others = sum(
        any(v == "wrong" for name, v in r.verdicts.items() if name != kind.check) for r in mine
    )
    size = f"{100 * float(np.median(off)):.1f} %" if off else "-"
    close = sum(o <= CLOSE for o in off)
    return (
        f"| {kind.fault} {kind.size:g} | {mine[0].sensor} | {len(mine)} | {measured} | "
        f"{len(found)} | {size} | {close} | {others} |"
    )


def read(path: Path) -> list[Run]:
    """Runs of an earlier call; empty without the file."""
    return [Run(**line) for line in whole_lines(path)]


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.robot_setup",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--healthy", type=int, default=200, help="homes, each with a healthy run")
    parser.add_argument("--faulty", type=int, default=20, help="homes with every kind of fault")
    parser.add_argument("--seed0", type=int, default=0, help="first home")
    parser.add_argument("--sensors", default="none,realistic", help="sensor noise, by commas")
    parser.add_argument("--preset", default="demo-v1", help="kind of homes")
    parser.add_argument("--out", type=Path, default=Path("runs/robot-setup"))
    asked = parser.parse_args()
    sensors = asked.sensors.split(",")
    try:
        played = homes(asked.seed0, asked.healthy)
    except InvalidInput as error:
        parser.error(error.message)
    if asked.preset not in PRESETS:
        parser.error(f"no kind of homes {asked.preset}; wanted one of {', '.join(PRESETS)}")
    if unknown := set(sensors) - set(SENSORS):
        parser.error(f"no sensor noise {', '.join(unknown)}; wanted {', '.join(SENSORS)}")
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / "runs.jsonl"
    runs = read(path)
    known = {(r.seed, r.sensor, r.faults) for r in runs}
    try:
        for k, seed in enumerate(played):
            texts = [HEALTHY, *(kind.text(seed) for kind in KINDS if k < asked.faulty)]
            for sensor in sensors:
                for run in play_home(seed, sensor, asked.preset, texts, known):
                    runs.append(run)
                    append_line(path, json.dumps(asdict(run)))
    except HeliosError as error:
        print(f"robot-setup: {error.message}", file=sys.stderr)
        return 1
    text = table(runs)
    write_file(asked.out / "table.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
