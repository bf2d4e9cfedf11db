"""Things of simulated homes with their truth, by the images of the study of detector errors."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported; needs no display

import numpy as np
from helios_core.household_names import HOUSEHOLD_NAMES
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import open_detector
from helios_detector.simulator_truth import Truth
from helios_objectmap.settings import ObjectMapSettings
from helios_sim.home import PRESETS, generate_home
from numpy.typing import NDArray

from helios_eval.error_models.named_things import NamedThing, SceneLog
from helios_eval.studies.detector_errors.__main__ import (
    SIMULATED,
    Arm,
    arm_of,
    known_classes,
    opened,
)
from helios_eval.studies.detector_errors.simulated_images import CurrentTruth, images_of


@dataclass(frozen=True)
class HomeSightings:
    """What a detector said in simulated homes."""

    detector: str  # name that the detector gives itself
    asked: tuple[str, ...]
    arm: Arm  # judged images, by visible pixels and distance
    true_things: tuple[NamedThing, ...]
    found_things: tuple[NamedThing, ...]  # the same views, without truth
    views: int


def look_at_homes(
    detector: str,
    seeds: Sequence[int],
    preset: str,
    things: int,
    threads: int,
    settings: ObjectMapSettings,
    say: Callable[[str], None],
) -> HomeSightings:
    """Look around objects of homes, as the study of detector errors does. Raises InvalidInput."""
    vocabulary = None
    if not detector.startswith(SIMULATED):
        with closing(open_detector(detector, DetectorOptions(threads=threads))) as asked_for:
            vocabulary = asked_for.vocabulary()
    classes = known_classes(preset, vocabulary)
    arm = arm_of(detector, sorted({*classes, *HOUSEHOLD_NAMES}), vocabulary)
    right = {c: tuple(sorted(names)) for c, names in arm.log.right.items() if names}
    name, views, true, found = detector, 0, [], []
    for seed in seeds:
        truth, log, class_of = CurrentTruth(), SceneLog(settings), {}
        with closing(opened(detector, truth, seed, threads)) as model:
            name = model.name
            for image in images_of(generate_home(seed, PRESETS[preset]), classes, things):
                truth.current = image.truth
                said = model.detect(image.frame, arm.context).detections
                pose = image.frame.T_world_cam
                arm.log.add(seed, image.viewpoint.view, pose, image.things, said)
                if log.takes(pose):
                    log.add(image.frame, said)
                log.add_surface(image.frame, _masks(image.truth, {t.name for t in image.things}))
                class_of |= {t.name: t.class_name for t in image.things}
        names = {t: right[c] for t, c in class_of.items() if c in right}
        true += log.true_things(seed, names)
        found += log.found_things(seed)
        views += len(log)
        say(f"home {seed}: {len(log)} views, {len(true)} true things so far")
    asked = tuple(c.name for c in arm.context.classes)
    return HomeSightings(name, asked, arm, tuple(true), tuple(found), views)


def _masks(truth: Truth, names: set[str]) -> dict[str, NDArray[np.bool_]]:
    """Pixels of each of these true things, by its name."""
    return {i.name: truth.ids == n for n, i in truth.instances.items() if i.name in names}
