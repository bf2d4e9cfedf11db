"""Images of simulated homes with their ground truth, for real and simulated detectors alike."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from helios_core.types import Frame
from helios_detector.simulator_truth import Truth, TruthInstance
from helios_sim.home import Home
from helios_sim.home.home_types import SceneObject
from helios_sim.home.mujoco_model import structure_classes

from helios_eval.studies.detector_errors.sightings import Visible
from helios_eval.studies.detector_errors.viewpoints import Viewpoint, items, middle_m, viewpoints
from helios_eval.studies.realism_views import ObserverCamera, RecordedFurnitureModels, View

Point = tuple[float, float, float]  # world, metres

LEAST_PX = 60  # smaller objects are not judged
UNOBSTRUCTED_BOX, UNOBSTRUCTED_PIXELS = 0.75, 0.35  # least shares, as in the study of realism


@dataclass(frozen=True)
class JudgedImage:
    """One image, its viewpoint, and the objects in it."""

    viewpoint: Viewpoint
    frame: Frame
    truth: Truth
    things: tuple[Visible, ...]


class CurrentTruth:
    """Ground truth of the image that is judged now; a `TruthSource` of simulated detectors."""

    def __init__(self) -> None:
        self.current: Truth | None = None

    def segmentation(self, stamp_ns: int) -> Truth:
        """Ground truth of the current image; there is no other."""
        assert self.current is not None
        return self.current

    def check(self) -> None:
        """Ground truth is always available."""


def images_of(
    home: Home, classes: Collection[str], most: int, models: RecordedFurnitureModels | None = None
) -> Iterator[JudgedImage]:
    """Images around up to `most` objects of these classes. models: None for parametric shapes."""
    camera = ObserverCamera(home, models)
    try:
        centers_m = {thing.name: middle_m(thing) for thing in items(home)}
        instance_of = _instances(home, camera, centers_m)
        for viewpoint in viewpoints(home, classes, most):
            view = camera.look(viewpoint.eye_xy, viewpoint.at_m)
            truth = _truth(view, instance_of)
            things = tuple(
                Visible(
                    t.name,
                    t.class_name,
                    t.box_xyxy,
                    t.pixels,
                    centers_m[t.name],
                    t.open_box >= UNOBSTRUCTED_BOX and t.open_pixels >= UNOBSTRUCTED_PIXELS,
                )
                for t in view.things
                if t.pixels >= LEAST_PX
            )
            yield JudgedImage(viewpoint, view.frame, truth, things)
    finally:
        camera.close()


def _instances(
    home: Home, camera: ObserverCamera, centers_m: Mapping[str, Point]
) -> dict[int, TruthInstance]:
    """Ground truth of each named body of a home, by body id."""
    graspable = {thing.name for thing in items(home) if isinstance(thing, SceneObject)}
    structure = structure_classes(home.rooms, home.doorways)
    out = {}
    for body, name in camera.names().items():
        if name in centers_m:
            class_name, center_m = home.class_of(name), np.array(centers_m[name])
        elif name in structure:
            class_name, center_m = structure[name], np.zeros(3)
        else:
            continue
        out[body] = TruthInstance(body, class_name, center_m, name in graspable, name)
    return out


def _truth(view: View, instance_of: Mapping[int, TruthInstance]) -> Truth:
    """Ground truth of one view, as the simulated world gives it."""
    seen = np.flatnonzero(np.bincount(view.bodies.ravel())).tolist()
    instances = {body: instance_of[body] for body in seen if body in instance_of}
    return Truth(view.bodies.astype(np.uint16), instances)
