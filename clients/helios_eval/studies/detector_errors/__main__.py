"""Study of detectors' errors: real and simulated ones on the same images.

    python -m helios_eval.studies.detector_errors --detector onnx:yolox_nano.onnx \\
        --detector simulated:ovmm-v1 --detector simulated:ovmm-v1-smooth --seeds 0-19 \\
        --frames ../shared/data/redkitchen --out runs/detector-errors

The robot's camera looks at objects of each home from 12 sides and several distances, twice from
each place, a few centimetres apart. Each detector is asked for all classes for which the first real
detector has a name, and every object in the image is judged. `--frames` adds posed real frames,
where only agreement between frames can be measured. Writes `detector-errors.md`, `.json` and
`.png`, and all judgements of the detectors in the order given (`sightings-0.npz`, …).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported; needs no display

import numpy as np
from helios_core.atomic_file import replacing, write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.types import Frame, FrameId, Role, SearchClass, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions
from helios_detector.model_loading import open_detector
from helios_replay.rgbd_folder import read_dataset, read_image
from helios_sim.assets import realistic
from helios_sim.home import PRESETS, generate_home
from helios_sim.home.catalogs import CATALOGS

from helios_eval.studies.detector_errors.error_report import chart, markdown
from helios_eval.studies.detector_errors.error_summary import quantiles, summary
from helios_eval.studies.detector_errors.repeat_rates import (
    LoggedImage,
    RepeatRates,
    logged,
    nothing,
    repeat_rates,
)
from helios_eval.studies.detector_errors.sightings import SightingLog
from helios_eval.studies.detector_errors.simulated_images import CurrentTruth, images_of
from helios_eval.studies.development_homes import seeds
from helios_eval.studies.realism_judging import PARAMETRIC, REALISTIC, names_for
from helios_eval.studies.realism_views import RecordedFurnitureModels

LEAST_SCORE = 0.05  # threshold of the detectors; reports apply their own
SIMULATED = "simulated:"


@dataclass
class Arm:
    """One detector, what it is asked for, and what it said."""

    name: str
    context: SearchContext
    log: SightingLog
    repeats: RepeatRates = field(default_factory=nothing)
    waiting: list[LoggedImage] = field(default_factory=list)  # images around one object

    def close_scene(self) -> None:
        """Count the agreement of the images around one object."""
        self.repeats = self.repeats + repeat_rates(self.waiting)
        self.waiting.clear()


def arm_of(name: str, classes: Sequence[str], vocabulary: Sequence[str] | None) -> Arm:
    """Arm of a detector that is asked for these classes of objects by its own names."""
    right = {c: names_for(c, vocabulary) for c in classes}
    furniture = {name for c in classes if c in _furniture() for name in right[c]}
    asked = sorted({name for names in right.values() for name in names})
    context = SearchContext(
        "errors",
        tuple(
            SearchClass(n, Role.START_RECEPTACLE if n in furniture else Role.OBJECT, LEAST_SCORE)
            for n in asked
        ),
    )
    return Arm(name, context, SightingLog(right, len(asked)))


def known_classes(preset: str, vocabulary: Sequence[str] | None) -> list[str]:
    """Classes of a preset's homes for which a detector has a name."""
    catalog = CATALOGS[PRESETS[preset].catalog]
    classes = sorted({*catalog.receptacles, *catalog.fixtures, *catalog.objects})
    return [name for name in classes if names_for(name, vocabulary)]


def look_around(given: argparse.Namespace, arms: Sequence[Arm], classes: Sequence[str]) -> None:
    """Show every home to every detector."""
    models = RecordedFurnitureModels(realistic().pack) if given.furniture == REALISTIC else None
    for seed in given.seeds:
        truth, target, count = CurrentTruth(), "", 0
        detectors = [opened(arm.name, truth, seed, given.threads) for arm in arms]
        home = generate_home(seed, PRESETS[given.preset], models)
        for image in images_of(home, classes, given.things, models):
            if image.viewpoint.target != target:
                target = image.viewpoint.target
                for arm in arms:
                    arm.close_scene()
            truth.current = image.truth
            count += 1
            for arm, detector in zip(arms, detectors, strict=True):
                found = detector.detect(image.frame, arm.context).detections
                T = image.frame.T_world_cam
                depth_m = image.frame.depth_m
                arm.log.add(seed, image.viewpoint.view, T, image.things, found, depth_m)
                arm.waiting.append(logged(image.frame, found))
        for arm, detector in zip(arms, detectors, strict=True):
            arm.close_scene()
            detector.close()
        print(f"home {seed}: {count} images", flush=True)


def real_frames(folder: Path, arm: Arm, threads: int) -> tuple[RepeatRates, list[float]]:
    """Agreement of a real detector with itself on posed real frames, and its scores there."""
    data = read_dataset(folder)
    detector = opened(arm.name, CurrentTruth(), 0, threads)
    images, scores = [], []
    for n, posed in enumerate(data.images):
        color, depth_m = read_image(data, n)
        frame = Frame(
            FrameId("real", 0, n + 1),
            n + 1,
            True,
            color,
            depth_m,
            data.camera,
            posed.T_world_cam,
            np.eye(4),
        )
        found = detector.detect(frame, arm.context).detections
        images.append(logged(frame, found))
        scores += [d.score for d in found]
    detector.close()
    return repeat_rates(images), scores


def main(argv: list[str] | None = None) -> int:
    given = _arguments().parse_args(argv)
    try:
        _measure(given)
    except HeliosError as error:
        print(f"detector_errors: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput) else 1
    return 0


def _measure(given: argparse.Namespace) -> None:
    real = [name for name in given.detector if not name.startswith(SIMULATED)]
    if not real:
        raise InvalidInput("no real detector came; add --detector onnx:FILE, whose names are used")
    vocabulary = open_detector(real[0], DetectorOptions()).vocabulary()
    classes = known_classes(given.preset, vocabulary)
    arms = [arm_of(n, classes, vocabulary if n in real else None) for n in given.detector]
    look_around(given, arms, classes)
    given.out.mkdir(parents=True, exist_ok=True)
    for n, arm in enumerate(arms):
        columns = vars(arm.log.sightings())
        with replacing(given.out / f"sightings-{n}.npz") as part, part.open("wb") as file:
            np.savez_compressed(file, detector=arm.name, **columns)
    found = {_title(a.name): summary(a.log.sightings(), a.log.false_alarms()) for a in arms}
    repeats = {_title(arm.name): arm.repeats for arm in arms}
    scores = {_title(arm.name): quantiles(arm.log.scores()) for arm in arms}
    if given.frames is not None:
        name = f"{_title(real[0])}, real frames"
        repeats[name], seen = real_frames(
            given.frames, arms[given.detector.index(real[0])], given.threads
        )
        scores[name] = quantiles(np.array(seen))
    text = markdown(found, repeats, scores)
    write_file(given.out / "detector-errors.md", text)
    figures = {
        "preset": given.preset,
        "seeds": list(given.seeds),
        "furniture": given.furniture,
        "classes": classes,
        "detectors": {name: asdict(s) for name, s in found.items()},
        "scores": scores,
        "repeats": {n: {k: v.tolist() for k, v in asdict(r).items()} for n, r in repeats.items()},
    }
    write_file(
        given.out / "detector-errors.json", json.dumps(_without_nan(figures), indent=1) + "\n"
    )
    chart(found, given.out / "detector-errors.png")
    print(text)


def _without_nan(value: Any) -> Any:
    """The value with None in place of every NaN, which JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(one) for one in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _title(name: str) -> str:
    """Name of a detector without folders."""
    return name.rpartition("/")[2]


def opened(name: str, truth: CurrentTruth, seed: int, threads: int) -> DetectorBackend:
    """Detector of one home; a simulated one draws its errors by the home's seed."""
    if name.startswith(SIMULATED):
        table = name.removeprefix(SIMULATED)
        options = DetectorOptions(truth, threads, noise=table, noise_seed=seed)
        return open_detector("simulated", options)
    detector = open_detector(name, DetectorOptions(threads=threads))
    detector.warm_up()
    return detector


def _furniture() -> frozenset[str]:
    return frozenset(name for c in CATALOGS.values() for name in (*c.receptacles, *c.fixtures))


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.detector_errors",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--detector",
        action="append",
        required=True,
        help="onnx:FILE, transformers:ID, simulated:TABLE; may be repeated",
    )
    parser.add_argument("--preset", default="ovmm-v1", choices=sorted(PRESETS))
    parser.add_argument("--furniture", default=PARAMETRIC, choices=[PARAMETRIC, REALISTIC])
    parser.add_argument("--seeds", type=seeds, default=tuple(range(20)), help="3 or 0-9")
    parser.add_argument("--things", type=int, default=12, help="objects of each home")
    parser.add_argument("--frames", type=Path, help="folder of posed RGB-D images")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and the chart")
    return parser


if __name__ == "__main__":
    sys.exit(main())
