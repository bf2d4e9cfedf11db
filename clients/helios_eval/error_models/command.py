"""`helios calibrate`: from recordings or homes to a file, and what it says on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from helios_client.usage_errors import UsageError, check_writable
from helios_core.atomic_file import write_file
from helios_core.detector_error_model import to_text
from helios_objectmap.instances.name_sightings import BROAD_PRIOR
from helios_objectmap.settings import ObjectMapSettings
from helios_sim.home.presets import PRESETS

from helios_eval.error_models.chart import draw
from helios_eval.error_models.model_building import FITTED, Built, of_homes, of_recordings
from helios_eval.error_models.recordings import RECORDED, look_at_recordings, read_places
from helios_eval.error_models.simulated_homes import look_at_homes
from helios_eval.ledger import FIRST_SEED

MEANING = {
    "hit": "right name, in a view that names the thing",
    "mistaken": "another name, so that the map's rule is likeliest",
    "sides_correlate": "correlation of the errors of two sides",
    "rival": "odds of one other name beforehand",
}
UNTOLD = (
    "Without truth an error that is the same from all sides looks like the truth; a prior decides "
    "how often that happens."
)


@dataclass(frozen=True)
class Job:
    """What to fit, from the command line."""

    recordings: Sequence[Path]
    detector: str
    out: Path
    homes: str = ""
    preset: str = "ovmm-v1"
    things: int = 10
    places: Path | None = None
    with_truth: bool = True
    threads: int = 1
    chart: Path | None = None


def calibrate(job: Job, say: Callable[[str], None]) -> Built:
    """Fit a model, write its file and chart. Raises UsageError, InvalidInput, Unavailable."""
    if bool(job.recordings) == bool(job.homes):
        raise UsageError("name recordings, or simulated homes with --homes 0-19; not both")
    if job.homes and job.places is not None:
        raise UsageError("--places is for recordings; the truth of homes is known")
    if job.homes and job.detector == RECORDED:
        raise UsageError(
            f"--detector {RECORDED} needs recordings; with --homes name simulated:TABLE or a model"
        )
    if job.recordings and job.detector.partition(":")[0] == "simulated":
        raise UsageError(
            f"--detector {job.detector} needs --homes; with recordings name {RECORDED} or a model"
        )
    if job.preset not in PRESETS:
        raise UsageError(f"no preset is called {job.preset!r}; wanted one of {', '.join(PRESETS)}")
    for file in (job.out, job.chart):
        if file is not None:
            check_writable(file)
    settings = ObjectMapSettings.read()
    if job.homes:
        seen = look_at_homes(
            job.detector, seeds_of(job.homes), job.preset, job.things, job.threads, settings, say
        )
        what = f"simulated homes {job.homes} of {job.preset}, {job.things} things each"
        built = of_homes(seen, what, job.detector, job.with_truth)
    else:
        places = read_places(job.places) if job.places is not None else ()
        heard = look_at_recordings(job.recordings, job.detector, places, job.threads, settings, say)
        what = "recordings " + ", ".join(path.name for path in job.recordings)
        built = of_recordings(heard, what, job.detector)
    write_file(job.out, to_text(built.model))
    if job.chart is not None:
        draw(built, job.chart)
    return built


def seeds_of(text: str) -> range:
    """Seeds of "3" or "0-19". Raises UsageError."""
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal()) or int(last or first) < int(first):
        raise UsageError(f"--homes is {text!r}; wanted a seed or a range, as 3 or 0-19")
    if int(last or first) >= FIRST_SEED:
        raise UsageError(
            f"--homes is {text}; take homes below {FIRST_SEED}, because later ones are "
            "for evaluations"
        )
    return range(int(first), int(last or first) + 1)


def lines(built: Built, out: Path) -> list[str]:
    """Report of a fit for the terminal."""
    m = built.model
    broad = asdict(BROAD_PRIOR)
    text = [
        f"{m.detector}: {m.source.things} things, {m.source.views} views, "
        f"{m.source.sides:.0f} sides; {_truth(m.source.things_with_truth, m.source.things)}",
        f"{'':16} {'fitted':>7}  {'95 % interval':>15}  {'broad prior':>11}",
    ]
    for name in FITTED:
        e = getattr(m.names, name)
        text.append(
            f"{name:16} {e.value:7.3f}  {e.low:6.3f} to {e.high:5.3f}  {broad[name]:11.3f}  "
            f"{MEANING[name]}"
        )
    if built.checked is not None:
        text.append("names of other scenes, log loss and AUROC of the map's probability:")
        for name, (loss, area) in built.checked.figures().items():
            text.append(f"{name:16} {loss:7.3f}  {area:.3f}")
    if m.source.truth != "truth":
        text.append(UNTOLD)
    text.append(f"wrote {out}; use it: HELIOS_OBJECTMAP_ERROR_MODEL={out.resolve()} helios up …")
    return text


def answer(built: Built) -> dict[str, Any]:
    """The same as JSON."""
    out: dict[str, Any] = {"model": built.model.model_dump(mode="json")}
    if built.checked is not None:
        out["check"] = {
            name: {"log_loss": loss, "auroc": area}
            for name, (loss, area) in built.checked.figures().items()
        }
    return out


def _truth(known: int, things: int) -> str:
    if not known:
        return "no truth, so fitted by agreement between sides"
    return "with truth" if known == things else f"truth of {known} of them"
