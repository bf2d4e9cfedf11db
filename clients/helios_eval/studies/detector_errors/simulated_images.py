"""Images of simulated homes with their ground truth, for real and simulated detectors alike."""

from __future__ import annotations

from collections.abc import Collection, Iterator
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
        for viewpoint in viewpoints(home, classes, most):
            view = camera.look(viewpoint.eye_xy, viewpoint.at_m)
            truth = _truth(home, camera, view)
            things = tuple(
                Visible(
                    t.name, t.class_name, t.box_xyxy, t.pixels, centers_m[t.name],
                    t.open_box >= UNOBSTRUCTED_BOX and t.open_pixels >= UNOBSTRUCTED_PIXELS,
                )
                for t in view.things
                if t.pixels >= LEAST_PX
            )  # fmt: skip
            yield JudgedImage(viewpoint, view.frame, truth, things)
    finally:
        camera.close()


def _truth(home: Home, camera: ObserverCamera, view: View) -> Truth:
    """Ground truth of one view, as the simulated world gives it."""
    graspable = {thing.name for thing in items(home) if isinstance(thing, SceneObject)}
    centers_m = {thing.name: middle_m(thing) for thing in items(home)}
    structure = structure_classes(home.rooms, home.doorways)
    instances = {}
    for body in np.flatnonzero(np.bincount(view.bodies.ravel())):
        name = camera.name_of(int(body))
        if name in centers_m:
            class_name, center_m = home.class_of(name), np.array(centers_m[name])
        elif name in structure:
            class_name, center_m = structure[name], np.zeros(3)
        else:
            continue
        instances[int(body)] = TruthInstance(
            int(body), class_name, center_m, name in graspable, name
        )
    return Truth(view.bodies.astype(np.uint16), instances)
