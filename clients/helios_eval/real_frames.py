"""What the object map believes of posed real frames, under several settings, view after view.

    python -m helios_eval.real_frames ../shared/data/redkitchen --out runs/kitchen \\
        --detector onnx:../shared/models/yolox_nano.onnx \\
        --classes "cup,bowl,microwave,book,dining table,chair,tv" --receptacles "dining table" \\
        --thresholds "microwave=0.45" \\
        --place "mug A=cup@1.80,0.715,0.80" --place "mug B=cup@1.655,-0.265,0.785" \\
        --with size_agreement=on --with "prior_classes=8 size_agreement=on"

The detector is asked once; its detections go into one map with the default settings, and into one
for each `--with`. Prints Psi at the end and, in brackets, the highest at any frame: of the instance
at each place, and of the best one of each class that is at none of the places. Leaves the same for
every frame in `beliefs.json`, and pictures of it and of the number of Gaussians.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from helios_client.watch_list import watch_list
from helios_client.wrong_use import WrongUse
from helios_core.errors import HeliosError, InvalidInput
from helios_core.types import Frame, FrameId, Observation, Role, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions, open_detector
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_replay.dataset import Dataset, read_dataset, read_image
from numpy.typing import NDArray

from helios_eval import service_settings

DEFAULT = "default"
NEAR_M = 0.15  # an instance whose centre is this near to a place is the thing there


@dataclass(frozen=True)
class Place:
    """Where a thing really is."""

    name: str
    class_name: str
    center_m: NDArray[np.float64]  # [3] world


@dataclass
class Course:
    """How one map went; the lists have one entry a frame."""

    gaussians: list[int] = field(default_factory=list)
    psi: list[dict[str, float]] = field(default_factory=list)  # of a place or a class elsewhere

    def ended(self, name: str) -> float:
        return self.psi[-1].get(name, 0.0)

    def highest(self, name: str) -> float:
        return max(row.get(name, 0.0) for row in self.psi)


def frames_of(data: Dataset) -> Iterator[Frame]:
    """All images, as keyframes of a robot whose base is at the origin."""
    for index, image in enumerate(data.images):
        color, depth_m = read_image(data, index)
        yield Frame(
            FrameId("dataset", 0, index), image.stamp_ns, True, color, depth_m, data.camera,
            image.T_world_cam, np.eye(4),
        )  # fmt: skip


def courses(
    data: Dataset,
    detector: DetectorBackend,
    context: SearchContext,
    places: Sequence[Place],
    arms: dict[str, ObjectMapSettings],
) -> dict[str, Course]:
    """Each arm's map after each frame. Raises HeliosError."""
    maps = {name: ObjectMap(chosen) for name, chosen in arms.items()}
    out = {name: Course() for name in arms}
    for frame in frames_of(data):
        found = detector.detect(frame, context).detections
        for name, built in maps.items():
            built.update(Observation(frame, context.id, found, {}, "detector"), context)
            out[name].gaussians.append(len(built))
            out[name].psi.append(_believed(built, places))
    return out


def _believed(built: ObjectMap, places: Sequence[Place]) -> dict[str, float]:
    """Highest Psi of each place and of each class elsewhere; those that there are."""
    best: dict[str, float] = {}
    for o in built.objects():
        alike = [p for p in places if p.class_name == o.class_name]
        elsewhere = f"other {o.class_name}" if alike else o.class_name
        name = next((p.name for p in alike if _near(o.center_m, p)), elsewhere)
        best[name] = max(best.get(name, -1.0), o.score)
    return best


def _near(center_m: NDArray[np.float64], place: Place) -> bool:
    return float(np.linalg.norm(center_m - place.center_m)) < NEAR_M


def table(found: dict[str, Course]) -> str:
    """Markdown: a row for each arm, a column for each place and class."""
    names = sorted({name for course in found.values() for row in course.psi for name in row})
    lines = [f"| | {' | '.join(names)} |", "|---|" + "--:|" * len(names)]
    for arm, course in found.items():
        cells = (f"{course.ended(n):.2f} ({course.highest(n):.2f})" for n in names)
        lines.append(f"| {arm} | {' | '.join(cells)} |")
    return "\n".join(lines)


def pictures(found: dict[str, Course], folder: Path) -> None:
    """Psi over the frames for each arm, and Gaussians of all of them."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    names = sorted({name for course in found.values() for row in course.psi for name in row})
    figure, axes = plt.subplots(
        len(found), 1, figsize=(9, 3.4 * len(found)), dpi=110, layout="constrained", squeeze=False
    )
    for (arm, course), axis in zip(found.items(), axes[:, 0], strict=True):
        for name in names:
            axis.plot([row.get(name, np.nan) for row in course.psi], label=name)
        axis.axhline(0.5, color="0.5", lw=0.8, ls="--")
        axis.set(title=arm, xlabel="frame", ylabel="Ψ", ylim=(0, 1))
    axes[0, 0].legend(frameon=False, ncol=3, fontsize=8)
    figure.savefig(folder / "psi.png")
    figure, axis = plt.subplots(figsize=(9, 3.4), dpi=110, layout="constrained")
    for arm, course in found.items():
        axis.plot(np.array(course.gaussians) / 1e3, label=arm)
    axis.set(xlabel="frame", ylabel="thousand Gaussians", ylim=(0, None))
    axis.legend(frameon=False, fontsize=8)
    figure.savefig(folder / "gaussians.png")
    plt.close("all")


def place(text: str) -> Place:
    """`"mug A=cup@1.8,0.7,0.8"`."""
    name, _, rest = text.partition("=")
    class_name, _, numbers = rest.partition("@")
    try:
        center_m = np.array([float(n) for n in numbers.split(",")])
    except ValueError:
        center_m = np.empty(0)
    if not name.strip() or not class_name or center_m.shape != (3,):
        raise argparse.ArgumentTypeError(f"{text!r} is no place; write NAME=CLASS@X,Y,Z in metres")
    return Place(name.strip(), class_name, center_m)


def arms_of(given: Sequence[str]) -> dict[str, ObjectMapSettings]:
    """The default settings, and those of each text like `"size_agreement=on prior_classes=4"`."""
    arms = {DEFAULT: ObjectMapSettings()}
    for text in given:
        chosen = service_settings.parsed(f"objectmap.{part}" for part in text.split())
        arms[text] = ObjectMapSettings(**service_settings.of_service("objectmap", chosen))
    return arms


def context_of(classes: str, thresholds: str, receptacles: str) -> SearchContext:
    """Receptacles among the classes are joined over wider voxels. Raises WrongUse."""
    context = watch_list(classes, thresholds)
    wide = {name.strip() for name in receptacles.split(",") if name.strip()}
    if unknown := sorted(wide - {c.name for c in context.classes}):
        raise WrongUse(f"--receptacles names {', '.join(unknown)}, which --classes does not")
    return replace(
        context,
        classes=tuple(
            replace(c, role=Role.START_RECEPTACLE if c.name in wide else Role.OBJECT)
            for c in context.classes
        ),
    )


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.real_frames", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("dataset", type=Path, help="folder of posed RGB-D images")
    parser.add_argument("--detector", required=True, help="onnx:FILE, transformers:ID, …")
    parser.add_argument("--classes", required=True, help="names with commas between them")
    parser.add_argument("--thresholds", default="", help='"cup=0.25,microwave=0.45"')
    parser.add_argument("--receptacles", default="", help="which of the classes are receptacles")
    parser.add_argument(
        "--place", type=place, action="append", default=[], metavar="NAME=CLASS@X,Y,Z",
        help="where a thing really is, world, metres; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--with", dest="arms", action="append", default=[], metavar="SETTING=VALUE …",
        help="settings of the object map for one more map; may be repeated",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, help="folder for figures and pictures")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    given = _arguments().parse_args(arguments)
    try:
        context = context_of(given.classes, given.thresholds, given.receptacles)
        arms, data = arms_of(given.arms), read_dataset(given.dataset)
        detector = open_detector(given.detector, DetectorOptions())
        detector.warm_up()
        found = courses(data, detector, context, given.place, arms)
    except HeliosError as error:
        print(f"real_frames: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput | WrongUse) else 1
    given.out.mkdir(parents=True, exist_ok=True)
    rows = {arm: {"gaussians": c.gaussians, "psi": c.psi} for arm, c in found.items()}
    (given.out / "beliefs.json").write_text(json.dumps(rows, indent=1) + "\n")
    pictures(found, given.out)
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
