"""Study: does a robot that starts at an unknown pose find its place in a saved map?

    python -m helios_eval.studies.relocalisation play --seeds 650-699 --out runs/relocalisation
    python -m helios_eval.studies.relocalisation report runs/relocalisation

For each home `play` plays a first visit, which makes the saved map, and a later session that starts
at a random pose and reports poses relative to it. It searches for the place of the saved maps of
this home and of another one in that session. Where the first visit found its object, a second
visit does the same task with the saved map loaded. Homes that are done are skipped.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path

from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.topics import RELOCALISATION
from helios_sim.home import PRESETS
from helios_sim.sensor_noise import SENSORS
from helios_sim.simulation_thread import WorldThread
from rich.console import Console

from helios_eval.episodes.in_process_stack import InProcessStack
from helios_eval.ledger import FIRST_SEED
from helios_eval.studies.development_homes import seeds
from helios_eval.studies.relocalisation import recordings
from helios_eval.studies.relocalisation.figures import table
from helios_eval.studies.relocalisation.judging import (
    HomeOutcome,
    Outcome,
    SecondVisit,
    outcome_of,
    starts_on_known_floor,
    stored_map,
    transform_of,
    true_transform,
)
from helios_eval.studies.relocalisation.pictures import write_picture
from helios_eval.studies.relocalisation.recordings import Recording
from helios_eval.studies.relocalisation.sessions import (
    LATER_STEPS,
    VISIT_STEPS,
    Moment,
    Place,
    moment_of,
    play,
)


def recorded(folder: Path, preset: str, seed: int, sensor: str) -> Recording:
    """Recording of a home; plays its sessions if there is none. Raises HeliosError, OSError."""
    path = recordings.path_of(folder, seed, sensor)
    if not path.exists():
        first = play(Place(preset, seed, sensor), VISIT_STEPS)
        moments: list[Moment] = []
        place = Place(preset, seed, sensor, random_start=seed)
        play(place, LATER_STEPS, lambda *running: moments.append(moment_of(*running)))
        recordings.write(folder, seed, sensor, first, moments)
    return recordings.read(path)


def searched(session: Recording, other: Recording) -> Outcome:
    """Search for the place of a stored map in a session. Raises InvalidInput for an empty map."""
    stored = stored_map(other.saved)
    if stored is None:
        raise InvalidInput(f"the saved map of home {other.seed} is empty")
    return outcome_of(session, other.seed, stored)


def second_visit(preset: str, recording: Recording) -> SecondVisit:
    """Do the task again, from a random start, with the saved map and without it. Raises
    HeliosError."""
    place = Place(preset, recording.seed, recording.sensor, random_start=recording.seed)
    told: list[pb.Relocalisation] = []
    known: list[tuple[int, float, float]] = []

    def on_step(stack: InProcessStack, thread: WorldThread) -> None:
        if not told:
            stack.bus().subscribe(RELOCALISATION, told.append)
        if told and told[-1].state == "relocalised" and not known:
            step, T = thread.run(lambda w: (w.progress.steps, w.T_estimated_true))
            robot_m = thread.run(lambda w: w.state().T_world_base[:2, 3])
            fix = transform_of(told[-1].T_present_stored).inverse
            known.append((step, *fix.difference(true_transform(T), robot_m)))

    done = play(place, VISIT_STEPS, on_step, recording.saved, explores=False)
    step, error_m, error_rad = known[0] if known else (0, 0.0, 0.0)
    without = play(place, VISIT_STEPS, explores=False)
    return SecondVisit(done.found_step, done.steps, without.found_step, step, error_m, error_rad)


def played(
    folder: Path, preset: str, seed: int, other: int, sensor: str, second_visits: bool
) -> HomeOutcome:
    """Outcome of a home. other: seed of another home. Raises HeliosError, OSError."""
    own = recorded(folder, preset, seed, sensor)
    elsewhere = recorded(folder, preset, other, sensor)
    again = second_visits and own.first_found_step > 0
    second = second_visit(preset, own) if again else None
    stored = stored_map(own.saved)
    known = stored is not None and starts_on_known_floor(own, stored)
    return HomeOutcome(
        seed,
        sensor,
        known,
        own.first_found_step,
        searched(own, own),
        searched(own, elsewhere),
        second,
    )


def main(argv: list[str] | None = None) -> int:
    given = _arguments().parse_args(argv)
    console = Console(width=110)
    try:
        if given.command == "play":
            _play_all(given, console)
        if given.command == "picture":
            write_picture(recordings.read(given.recording), given.step, given.out)
            console.print(given.out)
            return 0
        done = outcomes_in(given.out)
        if not done:
            raise InvalidInput(f"{given.out} has no outcomes; `play` writes them")
        for sensor in sorted({one.sensor for one in done}):
            console.print(table([one for one in done if one.sensor == sensor], sensor))
    except (HeliosError, OSError) as error:
        print(f"relocalisation: {error}", file=sys.stderr)
        return 2
    return 0


def outcomes_in(folder: Path) -> list[HomeOutcome]:
    """Outcomes that `play` wrote. Raises OSError."""
    paths = sorted(folder.glob("*.outcome.json"))
    return [HomeOutcome.from_json(json.loads(path.read_text())) for path in paths]


def _play_all(given: argparse.Namespace, console: Console) -> None:
    given.out.mkdir(parents=True, exist_ok=True)
    for i, seed in enumerate(given.seeds):
        path = given.out / f"{seed}-{given.sensor}.outcome.json"
        if path.exists():
            continue
        other = given.seeds[i - 1] if len(given.seeds) > 1 else (seed + 1) % FIRST_SEED
        done = played(given.out, given.preset, seed, other, given.sensor, given.second_visits)
        write_file(path, json.dumps(asdict(done)))
        console.print(_line(done))


def _line(done: HomeOutcome) -> str:
    own = done.own
    place = f"place after {own.step} steps" if own.step else f"no place ({own.reason})"
    error = f", {own.error_m:.3f} m, {math.degrees(own.error_rad):.2f}°" if own.step else ""
    second = f", second visit found it after {done.second.found_step}" if done.second else ""
    false = ", FALSE FIX" if own.is_false or done.other.is_false else ""
    return f"home {done.seed}: {place}{error}; found after {done.first_found_step}{second}{false}"


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.relocalisation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("play", help="play homes, and report")
    one.add_argument("--seeds", type=seeds, required=True, help="3 or 0-9")
    one.add_argument("--preset", default="ovmm-v1", choices=sorted(PRESETS))
    one.add_argument("--sensor", default="none", choices=sorted(SENSORS))
    one.add_argument(
        "--no-second-visits", dest="second_visits", action="store_false", help="leave them out"
    )
    one.add_argument("--out", type=Path, required=True, help="folder for recordings and outcomes")
    two = commands.add_parser("report", help="figures of the homes that are done")
    two.add_argument("out", type=Path, help="folder of `play`")
    three = commands.add_parser("picture", help="draw an alignment")
    three.add_argument("recording", type=Path, help="NPZ file of `play`")
    three.add_argument("--step", type=int, default=21, help="action of the later session")
    three.add_argument("--out", type=Path, required=True, help="PNG file to write")
    return parser


if __name__ == "__main__":
    sys.exit(main())
