"""How real the simulator looks to a detector that was trained on real pictures.

    python -m helios_eval.studies.realism --detector onnx:/work/shared/models/yolox_nano.onnx \
        --seeds 0-9 --out runs/realism

Every thing of every home is looked at from two distances, by the robot's camera, once in parametric
and once in realistic furniture. A thing that nothing hides is recognised when a detection of its
name covers its box (IoU of at least 0.5). Writes `realism.json`, `realism.md` (the table), pictures
and, with realistic furniture, `attributions.md`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported; needs no display

from helios_core.errors import HeliosError, InvalidInput
from helios_core.types import Detection, Role, SearchClass, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions
from helios_detector.opening import open_detector
from helios_detector.vocabulary import accepts, neighbours, normalised
from helios_sim.assets import realistic
from helios_sim.assets.pack import Model
from helios_sim.home import PRESETS, generate_home
from helios_sim.home.catalogs import CATALOGS

from helios_eval.studies.realism_views import Eye, NotedDressing, Thing, View, iou

COVERS_IOU = 0.5
NOWHERE_IOU = 0.3  # a detection that covers less of every thing is of nothing there
LEAST_PX = 400  # smaller things are not judged
LEAST_OPEN_BOX, LEAST_OPEN_PIXELS = 0.75, 0.35  # nor those that something else, or the edge, hides
PARAMETRIC, REALISTIC = "parametric", "realistic"


@dataclass(frozen=True)
class Sight:
    """What the detector made of one thing in one picture."""

    looks: str  # parametric or realistic
    class_name: str
    found: str  # the detector's name for it; empty: nothing covers it
    score: float  # of that detection
    recognised: bool


@dataclass(frozen=True)
class Row:
    """One class in one kind of looks."""

    seen: int
    recognised: int
    taken_for: tuple[tuple[str, int], ...]  # wrong names, most frequent first


@dataclass(frozen=True)
class Judged:
    """A view with what was found in it."""

    view: View
    looks: str
    detections: tuple[Detection, ...]
    sights: tuple[tuple[Thing, Sight], ...]

    @property
    def of_nothing(self) -> int:
        """Detections where nothing stands."""
        boxes = [t.box_xyxy for t in self.view.things]
        return sum(
            all(iou(d.box_xyxy, box) < NOWHERE_IOU for box in boxes) for d in self.detections
        )


def names_for(class_name: str, vocabulary: Iterable[str] | None) -> frozenset[str]:
    """The detector's names that are right for a class of the simulator; empty: it knows none.

    Its own name and synonyms; only where there are none, wider or neighbouring kinds.
    """
    if vocabulary is None:
        return frozenset({class_name})
    known = {normalised(name): name for name in vocabulary}
    same = accepts(class_name) & known.keys()
    return frozenset(known[name] for name in same or (neighbours(class_name) & known.keys()))


def judged(
    thing: Thing, looks: str, detections: Iterable[Detection], right: frozenset[str]
) -> Sight:
    """The best detection of a right name that covers the thing, else the best of a wrong one."""
    over = [d for d in detections if iou(d.box_xyxy, thing.box_xyxy) >= COVERS_IOU]
    over.sort(key=lambda d: (d.class_name in right, d.score), reverse=True)
    if not over:
        return Sight(looks, thing.class_name, "", 0.0, False)
    best = over[0]
    return Sight(looks, thing.class_name, best.class_name, best.score, best.class_name in right)


def rows_of(sights: Iterable[Sight]) -> dict[tuple[str, str], Row]:
    """(class, looks) -> what became of it."""
    groups: dict[tuple[str, str], list[Sight]] = {}
    for sight in sights:
        groups.setdefault((sight.class_name, sight.looks), []).append(sight)
    return {
        key: Row(
            len(group),
            sum(s.recognised for s in group),
            tuple(Counter(s.found for s in group if s.found and not s.recognised).most_common(3)),
        )
        for key, group in groups.items()
    }


def table(rows: Mapping[tuple[str, str], Row], right: Mapping[str, frozenset[str]]) -> str:
    """Markdown; most recognised first."""
    names = sorted({name for name, _ in rows})

    def share(name: str, looks: str) -> float:
        row = rows.get((name, looks))
        return row.recognised / row.seen if row else -1.0

    names.sort(key=lambda n: (-max(share(n, REALISTIC), share(n, PARAMETRIC)), n))
    lines = [
        "| thing | counts as | parametric: recognised | else taken for | realistic: recognised "
        "| else taken for |",
        "|---|---|---|---|---|---|",
    ]
    for name in names:
        cells = [name, ", ".join(sorted(right[name]))]
        for looks in (PARAMETRIC, REALISTIC):
            row = rows.get((name, looks))
            if row is None:
                cells += ["–", "–"]
                continue
            cells.append(f"{row.recognised / row.seen:.0%} of {row.seen}")
            cells.append(", ".join(f"{wrong} {n}" for wrong, n in row.taken_for) or "nothing")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def judge_homes(
    detector: DetectorBackend,
    given: argparse.Namespace,
    keep: Callable[[Judged], None],
    say: Callable[[str], None],
) -> dict[str, frozenset[str]]:
    """Every view of every home, given to `keep`; the names that are right for each class."""
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
            dressing = NotedDressing(realistic().pack) if looks == REALISTIC else None
            eye = Eye(generate_home(seed, preset, dressing), dressing)
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
                        and t.open_box >= LEAST_OPEN_BOX and t.open_pixels >= LEAST_OPEN_PIXELS
                        and (t.model is not None) == (looks == REALISTIC)
                    )  # fmt: skip
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
        for part in model.key.split("+"):  # several in one
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
        realistic()  # says at once what to bake
    detector = open_detector(given.detector, DetectorOptions(threads=given.threads))
    detector.warm_up()
    from helios_eval.studies.realism_pictures import Album, chart  # matplotlib takes a second

    sights: list[Sight] = []
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
    (given.out / "realism.md").write_text(text)
    figures = {
        "detector": detector.name, "preset": given.preset, "seeds": list(given.seeds),
        "threshold": given.threshold, "views": dict(views), "of_nothing": dict(of_nothing),
        "rows": [{"class": c, "looks": k} | asdict(row) for (c, k), row in sorted(rows.items())],
    }  # fmt: skip
    (given.out / "realism.json").write_text(json.dumps(figures, indent=1) + "\n")
    chart(rows, detector.name, given.out / "realism-classes.png")
    shown = album.write(given.out)
    if shown:
        (given.out / "attributions.md").write_text(_credits(shown))
    print(text)
    for looks, count in views.items():
        own = [s for s in sights if s.looks == looks]
        good = sum(s.recognised for s in own)
        print(
            f"{looks}: {good} of {len(own)} recognised ({good / max(1, len(own)):.0%}) in {count} "
            f"views; {of_nothing[looks] / count:.2f} reports of nothing a view"
        )


def _seeds(text: str) -> tuple[int, ...]:
    first, _, last = text.partition("-")
    try:
        out = tuple(range(int(first), int(last or first) + 1))
    except ValueError:
        out = ()
    if not out:
        raise argparse.ArgumentTypeError(f"{text!r} names no seeds; write 3 or 0-9")
    return out


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.realism",
        description="Which simulated things does a detector of real pictures recognise?",
    )
    parser.add_argument("--detector", required=True, help="onnx:FILE, transformers:ID, …")
    parser.add_argument("--preset", default="ovmm-v1", choices=sorted(PRESETS))
    parser.add_argument("--furniture", default="both", choices=[PARAMETRIC, REALISTIC, "both"])
    parser.add_argument("--seeds", type=_seeds, default=tuple(range(10)), help="3 or 0-9")
    parser.add_argument("--threshold", type=float, default=0.25, help="of the detector")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and pictures")
    return parser


if __name__ == "__main__":
    sys.exit(main())
