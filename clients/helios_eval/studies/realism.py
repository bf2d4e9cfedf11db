"""Study of the simulator's realism: objects that a detector trained on real images recognises.

    python -m helios_eval.studies.realism --detector onnx:/work/shared/models/yolox_nano.onnx \
        --seeds 0-9 --out runs/realism

The robot's camera views every object of every home from two distances, once with parametric and
once with realistic furniture. An unoccluded object is recognised if a detection of its name covers
its box (IoU of at least 0.5). Writes `realism.json`, `realism.md` (the table), pictures and, with
realistic furniture, `attributions.md`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

from helios_core.atomic_file import write_file

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported; needs no display

from helios_core.errors import HeliosError, InvalidInput
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions
from helios_detector.model_loading import open_detector
from helios_sim.assets import realistic
from helios_sim.assets.asset_pack import Model
from helios_sim.home import PRESETS, generate_home
from helios_sim.home.catalogs import CATALOGS

from helios_eval.episodes.real_detector import real_detector
from helios_eval.studies.development_homes import seeds
from helios_eval.studies.realism_judging import (
    PARAMETRIC,
    REALISTIC,
    Judged,
    Judgement,
    judged,
    names_for,
    rows_of,
    table,
)
from helios_eval.studies.realism_views import ObserverCamera, RecordedFurnitureModels
from helios_eval.studies.recognised_classes import write_classes

LEAST_PX = 400  # smaller objects are not judged
LEAST_OPEN_BOX, LEAST_OPEN_PIXELS = 0.75, 0.35  # nor are occluded or cut-off ones


def judge_homes(
    detector: DetectorBackend,
    given: argparse.Namespace,
    keep: Callable[[Judged], None],
    say: Callable[[str], None],
) -> dict[str, frozenset[str]]:
    """Pass every judged view of every home to `keep`; return the correct names of each class."""
    preset = PRESETS[given.preset]
    catalog = CATALOGS[preset.catalog]
    classes = sorted({*catalog.receptacles, *catalog.fixtures, *catalog.objects})
    vocabulary = detector.vocabulary()
    right = {name: names_for(name, vocabulary) for name in classes}
    right = {name: names for name, names in right.items() if names}
    asked = vocabulary if vocabulary is not None else tuple(right)
    context = SearchContext(
        "realism", tuple(SearchClass(name, Role.WATCH, given.threshold) for name in asked)
    )
    kinds = [PARAMETRIC, REALISTIC] if given.furniture == "both" else [given.furniture]
    for looks in kinds:
        for seed in given.seeds:
            furniture_models = (
                RecordedFurnitureModels(realistic().pack) if looks == REALISTIC else None
            )
            eye = ObserverCamera(generate_home(seed, preset, furniture_models), furniture_models)
            try:
                views = 0
                for view in eye.views(right.keys()):
                    views += 1
                    found = detector.detect(view.frame, context).detections
                    sights = tuple(
                        (t, judged(t, looks, found, right[t.class_name]))
                        for t in view.things
                        if t.class_name in right
                        and t.pixels >= LEAST_PX
                        and t.open_box >= LEAST_OPEN_BOX
                        and t.open_pixels >= LEAST_OPEN_PIXELS
                        and (t.model is not None) == (looks == REALISTIC)
                    )
                    keep(Judged(view, looks, found, sights))
            finally:
                eye.close()
            say(f"{looks} home {seed}: {views} views")
    return right


def _credits(models: Iterable[Model]) -> str:
    """Authors of the models in the pictures, by licence."""
    by_licence: dict[str, dict[str, set[str]]] = {}
    for model in models:
        by_author = by_licence.setdefault(model.licence, {})
        for part in model.key.split("+"):  # one model may join several
            by_author.setdefault(model.author, set()).add(part.rpartition("/")[2])
    lines = []
    for licence, authors in sorted(by_licence.items()):
        named = "; ".join(f"{a}: {', '.join(sorted(k))}" for a, k in sorted(authors.items()))
        lines.append(f"- **{licence}**: {named}.")
    return "\n".join(lines) + "\n"


def main(argv: list[str] | None = None) -> int:
    given = _arguments().parse_args(argv)
    try:
        _measure(given)
    except HeliosError as error:
        print(f"realism: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput) else 1
    return 0


def _measure(given: argparse.Namespace) -> None:
    if given.furniture != PARAMETRIC:
        realistic()  # raises at once if nothing is baked
    detector = open_detector(given.detector, DetectorOptions(threads=given.threads))
    detector.warm_up()
    from helios_eval.studies.realism_pictures import Album, chart  # matplotlib takes a second

    sights: list[Judgement] = []
    album, views, of_nothing = Album(), Counter[str](), Counter[str]()

    def keep(judged: Judged) -> None:
        sights.extend(sight for _, sight in judged.sights)
        album.add(judged)
        views[judged.looks] += 1
        of_nothing[judged.looks] += judged.of_nothing

    right = judge_homes(detector, given, keep, lambda line: print(line, flush=True))
    rows = rows_of(sights)
    given.out.mkdir(parents=True, exist_ok=True)
    text = table(rows, right)
    write_file(given.out / "realism.md", text)
    figures = {
        "detector": detector.name,
        "preset": given.preset,
        "seeds": list(given.seeds),
        "threshold": given.threshold,
        "views": dict(views),
        "of_nothing": dict(of_nothing),
        "rows": [{"class": c, "looks": k} | asdict(row) for (c, k), row in sorted(rows.items())],
    }
    write_file(given.out / "realism.json", json.dumps(figures, indent=1) + "\n")
    if given.write_classes is not None:
        first, last = given.seeds[0], given.seeds[-1]
        about = {
            "detector": detector.name,
            "sha256": real_detector(given.detector).sha256,
            "preset": given.preset,
            "seeds": f"{first}-{last}",
            "threshold": f"{given.threshold:g}",
        }
        catalog = CATALOGS[PRESETS[given.preset].catalog]
        write_classes(given.write_classes, rows, right, catalog, about)
    chart(rows, detector.name, given.out / "realism-classes.png")
    shown = album.write(given.out)
    if shown:
        write_file(given.out / "attributions.md", _credits(shown))
    print(text)
    for looks, count in views.items():
        own = [s for s in sights if s.looks == looks]
        good = sum(s.recognised for s in own)
        print(
            f"{looks}: {good} of {len(own)} recognised ({good / max(1, len(own)):.0%}) in {count} "
            f"views; {of_nothing[looks] / count:.2f} reports of nothing a view"
        )


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.realism",
        description="Which simulated things does a detector of real pictures recognise?",
    )
    parser.add_argument("--detector", required=True, help="onnx:FILE, transformers:ID, …")
    parser.add_argument("--preset", default="ovmm-v1", choices=sorted(PRESETS))
    parser.add_argument("--furniture", default="both", choices=[PARAMETRIC, REALISTIC, "both"])
    parser.add_argument("--seeds", type=seeds, default=tuple(range(10)), help="3 or 0-9")
    parser.add_argument("--threshold", type=float, default=0.25, help="of the detector")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and pictures")
    parser.add_argument(
        "--write-classes",
        type=Path,
        help="TOML file to write: classes in the upper half, for helios eval ovmm --task-classes",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
