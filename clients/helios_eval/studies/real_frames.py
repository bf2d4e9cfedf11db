"""Study of the object map on posed real frames, under several settings, frame by frame.

    python -m helios_eval.studies.real_frames ../shared/data/redkitchen --out runs/kitchen \\
        --detector onnx:../shared/models/yolox_nano.onnx \\
        --classes "cup,bowl,microwave,book,dining table,chair,tv" --receptacles "dining table" \\
        --thresholds "microwave=0.45" \\
        --place "mug A=cup@1.80,0.715,0.80" --place "mug B=cup@1.655,-0.265,0.785" \\
        --with size_agreement=on --with "prior_classes=8 size_agreement=on"

The detector runs once; its detections go into one map with the default settings, and into one for
each `--agent` and `--with`. `--also household` asks for all household names, too, as `helios` does.
A full map (`max_gaussians`) takes no more frames.

Prints Psi at the end and, in brackets, the highest at any frame: of the instance at each place, and
of the best one of each class that is at none of the places. Writes the same for every frame to
`beliefs.json`, with probabilities and centres, and two charts. `psi.png` shows Psi of the objects
at the places over the frames (without places, of the best instance of each class that was accepted
at some frame), and dotted the probability of each other class that claims such an object.
`gaussians.png` shows the number of Gaussians of all maps.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from helios_client.replay.class_thresholds import search_context_from_flags
from helios_client.usage_errors import UsageError
from helios_core.agent_presets import AGENT_NAMES
from helios_core.agent_presets import service_settings as settings_of_agent
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.household_names import HOUSEHOLD_NAMES
from helios_core.types import Role, SearchContext
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import open_detector
from helios_objectmap.settings import ObjectMapSettings
from helios_replay.rgbd_folder import read_dataset

from helios_eval.episodes import service_settings
from helios_eval.studies.real_frames_beliefs import (
    EpisodeProgress,
    Place,
    belief_progress,
    names_in,
)
from helios_eval.studies.real_frames_pictures import draw_beliefs, draw_counts

DEFAULT = "default"


def table(found: dict[str, EpisodeProgress]) -> str:
    """Markdown table: a row per arm, a column per place and class."""
    names = names_in(found)
    lines = [f"| | {' | '.join(names)} |", "|---|" + "--:|" * len(names)]
    for arm, course in found.items():
        cells = (f"{course.ended(n):.2f} ({course.highest(n):.2f})" for n in names)
        lines.append(f"| {course.title(arm)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def figures(found: dict[str, EpisodeProgress]) -> dict:
    """Content of `beliefs.json`: for each map, lists with one entry per frame."""
    return {
        arm: {
            "frames": c.frames,
            "gaussians": c.gaussians,
            "psi": [{name: seen.psi for name, seen in row.items()} for row in c.seen],
            "probabilities": [
                {name: seen.probabilities for name, seen in row.items()} for row in c.seen
            ],
            "center_m": [{name: seen.center_m for name, seen in row.items()} for row in c.seen],
        }
        for arm, c in found.items()
    }


def place(text: str) -> Place:
    """Place from text like `"mug A=cup@1.8,0.7,0.8"`."""
    name, _, rest = text.partition("=")
    class_name, _, numbers = rest.partition("@")
    try:
        center_m = np.array([float(n) for n in numbers.split(",")])
    except ValueError:
        center_m = np.empty(0)
    if not name.strip() or not class_name or center_m.shape != (3,):
        raise argparse.ArgumentTypeError(f"{text!r} is no place; write NAME=CLASS@X,Y,Z in metres")
    return Place(name.strip(), class_name, center_m)


def arms_of(given: Sequence[str], agents: Sequence[str] = ()) -> dict[str, ObjectMapSettings]:
    """Default settings, those of each agent, and those of each text like
    `"size_agreement=on prior_classes=4"`."""
    arms = {DEFAULT: ObjectMapSettings()}
    for agent in agents:
        arms[agent] = ObjectMapSettings.model_validate(settings_of_agent("objectmap", agent))
    for text in given:
        chosen = service_settings.parsed(f"objectmap.{part}" for part in text.split())
        arms[text] = ObjectMapSettings(**service_settings.of_service("objectmap", chosen))
    return arms


def context_of(classes: str, thresholds: str, receptacles: str) -> SearchContext:
    """Search context of the classes; receptacles are joined over wider voxels.

    Raises UsageError.
    """
    context = search_context_from_flags(classes, thresholds)
    wide = {name.strip() for name in receptacles.split(",") if name.strip()}
    if unknown := sorted(wide - {c.name for c in context.classes}):
        raise UsageError(f"--receptacles names {', '.join(unknown)}, which --classes does not")
    return replace(
        context,
        classes=tuple(
            replace(c, role=Role.START_RECEPTACLE if c.name in wide else Role.OBJECT)
            for c in context.classes
        ),
    )


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.real_frames",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("dataset", type=Path, help="folder of posed RGB-D images")
    parser.add_argument("--detector", required=True, help="onnx:FILE, transformers:ID, …")
    parser.add_argument("--classes", required=True, help="names with commas between them")
    parser.add_argument("--thresholds", default="", help='"cup=0.25,microwave=0.45"')
    parser.add_argument("--receptacles", default="", help="which of the classes are receptacles")
    parser.add_argument(
        "--place",
        type=place,
        action="append",
        default=[],
        metavar="NAME=CLASS@X,Y,Z",
        help="where a thing is, or is said to be, world, metres; may be repeated",
    )
    parser.add_argument(
        "--with",
        dest="arms",
        action="append",
        default=[],
        metavar="SETTING=VALUE …",
        help="settings of the object map for one more map; may be repeated",
    )
    parser.add_argument(
        "--agent",
        dest="agents",
        choices=AGENT_NAMES,
        action="append",
        default=[],
        help="agent whose settings one more map has; may be repeated",
    )
    parser.add_argument(
        "--also",
        choices=("nothing", "household"),
        default="nothing",
        help="names that the detector is asked for beside --classes",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for figures and pictures")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    given = _arguments().parse_args(arguments)
    try:
        context = context_of(given.classes, given.thresholds, given.receptacles)
        if given.also == "household":
            context = replace(context, also=HOUSEHOLD_NAMES)
        arms, data = arms_of(given.arms, given.agents), read_dataset(given.dataset)
        detector = open_detector(given.detector, DetectorOptions())
        detector.warm_up()
        found = belief_progress(data, detector, context, given.place, arms)
    except HeliosError as error:
        print(f"real_frames: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput | UsageError) else 1
    given.out.mkdir(parents=True, exist_ok=True)
    write_file(given.out / "beliefs.json", json.dumps(figures(found), indent=1) + "\n")
    draw_beliefs(found, [p.name for p in given.place], given.out / "psi.png")
    draw_counts(found, given.out / "gaussians.png")
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
