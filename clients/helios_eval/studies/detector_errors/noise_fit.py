"""Noise table fitted to the errors of a real detector, as the error study measured them.

    python -m helios_eval.studies.detector_errors.noise_fit runs/detector-errors \\
        --severity 1.5 --false-severity 10 --name ovmm-v2 --out ovmm-v2.toml

The folder holds a run of the study whose first detector is the real one, and which has
`ovmm-v1-smooth` for comparison. Fitted are: misses by visible pixels, how often each class gets a
wrong name, scores by pixels, persistence, and false alarms. Which names are taken for each other
stays as in the base, since the real detector knows too few of them. `--severity` multiplies wrong
names and `--false-severity` false alarms; both are chosen on the trusting agent alone.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.view_noise import Shares
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from numpy.typing import NDArray

from helios_eval.studies.detector_errors.persistence import RELATIONS
from helios_eval.studies.detector_errors.sightings import Sightings

BASE = "ovmm-v1"
LIKE = "ovmm-v1-smooth"  # the base with smooth sides, whose measured errors are compared
REPORTED = 0.1  # score from which an object counts as reported at all
PIXELS = (60, 150, 400, 1000, 3000, 10_000, 40_000)  # places of the table
SCORE_PIXELS = (400, 1000, 3000, 10_000)
STEPS = 7  # quantiles of the scores
LEAST_OF_CLASS = 30  # sightings for a rate of its own
LEAST_FACTOR, MOST_FACTOR = 0.1, 5.0
LEAST_SHARE = 0.02
LEAST_KEPT, MOST_PERSISTENT = 0.4, 0.97  # limits of the correction for several draws


def fitted(
    seen: Sightings, figures: Mapping[str, Any], severity: float, false_severity: float
) -> dict[str, Any]:
    """Entries of the table that differ from the base.

    figures: of `detector-errors.json`; severity, false_severity: factors on the measured rates of
    wrong names and of false alarms.
    """
    real, base = (
        next(iter(figures["detectors"].values())),
        figures["detectors"][f"simulated:{LIKE}"],
    )
    clear = seen.part(seen.unobstructed)
    reported = np.maximum(clear.right, clear.wrong) >= REPORTED
    table = load_noise(BASE)
    assert isinstance(table, ViewNoiseTable)
    wrong, factors = wrong_names(clear.part(reported), table)
    false = real["alarms_per_name"] / base["alarms_per_name"]
    return {
        "persistence": persistence(real, base, table.shares),
        "scale": {
            "confuse": severity * wrong,
            "second": severity * wrong,
            "miss": 1.0,
            "false": false_severity * false * table.file.scale.false,
        },
        "miss": {
            "pixels": list(PIXELS),
            "by_pixels": misses(clear.pixels, ~reported),
            "by_distance": [0.0] * (1 + len(table.file.bands.distance_m)),
        },
        "score": scores(clear) | {"together": real["scores_together"]},
        "confusion": {"factor": factors},
    }


def persistence(real: Mapping[str, Any], base: Mapping[str, Any], shares: Shares) -> dict[str, Any]:
    """Shares from the latent correlations of "right name", and of the wrong name itself.

    Same view: all but the frame. Same side from another distance: object and side. Opposite side:
    the object alone. An outcome has several draws (missed, named, scored), which lowers its
    correlation below that of each draw; `base`, whose shares are known, shows by how much. For the
    choice of the wrong name, the shares of pairs with one name stand for the correlations.
    """
    known = (1 - shares.frame, shares.thing + shares.side, shares.thing)
    whole = [
        min(of_real * true / max(of_base, true * LEAST_KEPT), MOST_PERSISTENT)
        for of_real, of_base, true in zip(widening(real), widening(base), known, strict=True)
    ]
    same_name = real["same_wrong_name"]
    return {
        **shares_of(*whole),
        "sides": "smooth",
        "name": shares_of(*(_number(same_name[RELATIONS[k]]) for k in (0, 1, 5))),
    }


def widening(figures: Mapping[str, Any]) -> tuple[float, float, float]:
    """Latent correlation of "right name": in one view, of one side, from the opposite side; NaN
    where the report has none."""
    right = [_number(figures["right_persists"][name]["value"]) for name in RELATIONS]
    return right[0], right[1], (right[5] + right[6]) / 2


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def shares_of(view: float, side: float, thing: float) -> dict[str, float]:
    """Shares that add up to 1, from the correlations of ever wider relations."""
    if math.isnan(view + side + thing):
        raise InvalidInput("too few pairs of images for the persistence; play more homes")
    view = min(max(view, 0.0), 1.0)
    side = min(max(side, 0.0), view)
    thing = min(max(thing, 0.0), side)
    out = {"thing": thing, "side": side - thing, "view": view - side, "frame": 1 - view}
    out = {key: max(round(value, 2), LEAST_SHARE) for key, value in out.items()}
    largest = max(out, key=lambda key: out[key])  # takes what rounding leaves
    out[largest] = round(out[largest] + 1 - sum(out.values()), 2)
    return out


def misses(pixels: NDArray[np.float64], missed: NDArray[np.bool_]) -> list[float]:
    """Miss rate at each place of PIXELS, falling with the size."""
    borders = np.log(PIXELS)
    middles = (borders[1:] + borders[:-1]) / 2
    band = np.searchsorted(middles, np.log(pixels), "right")
    rates = [float(missed[band == k].mean()) for k in range(len(PIXELS))]
    return [round(r, 3) for r in np.minimum.accumulate(rates).tolist()]


def wrong_names(reported: Sightings, table: ViewNoiseTable) -> tuple[float, dict[str, float]]:
    """(scale of wrong names, factor of each class) under which the rates are the measured ones.

    A wrong name counts if it is reported at all, beside a right one or instead of it.
    """
    wrong = reported.wrong >= REPORTED
    measured, listed = {}, {}
    for name in np.unique(reported.class_name).tolist():
        rows, row = reported.class_name == name, table.rows.get(name)
        if rows.sum() >= LEAST_OF_CLASS and row is not None:
            measured[name], listed[name] = float(wrong[rows].mean()), 2 * row.total
    if not measured:
        raise InvalidInput(f"no class has {LEAST_OF_CLASS} sightings; play more homes")
    scale = float(np.mean(list(measured.values())) / np.mean(list(listed.values())))
    factors = {
        name: round(float(np.clip(rate / listed[name] / scale, LEAST_FACTOR, MOST_FACTOR)), 2)
        for name, rate in measured.items()
    }
    return scale, factors


def scores(clear: Sightings) -> dict[str, Any]:
    """Quantiles of right and wrong scores, and their factor by pixels."""
    right, wrong = clear.right >= REPORTED, clear.wrong >= REPORTED
    steps = np.linspace(0, 1, STEPS)
    large = right & (clear.pixels >= SCORE_PIXELS[-1])
    top = float(np.median(clear.right[large]))
    borders = (0, *np.sqrt(np.multiply(SCORE_PIXELS[1:], SCORE_PIXELS[:-1])), np.inf)
    factors = []
    for low, high in itertools.pairwise(borders):
        rows = right & (clear.pixels >= low) & (clear.pixels < high)
        factors.append(min(1.0, float(np.median(clear.right[rows])) / top))
    by_size = np.interp(np.log(clear.pixels), np.log(SCORE_PIXELS), np.maximum.accumulate(factors))
    return {
        "true": _rounded(np.quantile(clear.right[right] / by_size[right], steps)),
        "confused": _rounded(np.quantile(clear.wrong[wrong] / by_size[wrong], steps)),
        "pixels": list(SCORE_PIXELS),
        "factor_by_pixels": _rounded(np.maximum.accumulate(factors)),
    }


def toml(name: str, about: str, entries: Mapping[str, Any]) -> str:
    """TOML text of a table with a base."""
    lines = [f"# {about}", f'base = "{BASE}"', f'name = "{name}"']
    lines += _section("", entries)
    return "\n".join(lines) + "\n"


def _section(prefix: str, entries: Mapping[str, Any]) -> list[str]:
    lines = []
    for key, value in entries.items():
        if isinstance(value, Mapping):
            inner = {k: v for k, v in value.items() if not isinstance(v, Mapping)}
            if inner:
                lines += ["", f"[{prefix}{key}]"]
            lines += [f"{_key(k)} = {_value(v)}" for k, v in inner.items()]
            rest = {k: v for k, v in value.items() if isinstance(v, Mapping)}
            lines += _section(f"{prefix}{key}.", rest)
    return lines


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() else json.dumps(name)


def _value(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else json.dumps(value)


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [round(min(float(v), 1.0), 3) for v in values]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.detector_errors.noise_fit",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("run", type=Path, help="folder of the error study")
    parser.add_argument("--severity", type=float, default=1.0, help="factor on wrong names")
    parser.add_argument("--false-severity", type=float, default=1.0, help="factor on false alarms")
    parser.add_argument("--name", default="ovmm-v2")
    parser.add_argument("--out", type=Path, required=True, help="table to write")
    given = parser.parse_args(argv)
    try:
        figures = json.loads((given.run / "detector-errors.json").read_text())
        with np.load(given.run / "sightings-0.npz") as file:
            detector = str(file["detector"])
            seen = Sightings(**{key: file[key] for key in file.files if key != "detector"})
        if f"simulated:{LIKE}" not in figures["detectors"]:
            raise InvalidInput(
                f"{given.run} has no detector simulated:{LIKE} to compare with; "
                f"repeat the study with --detector simulated:{LIKE}"
            )
        factors = given.severity, given.false_severity
        about = (
            f"Fitted to {Path(detector).name} by noise_fit.py, severity {factors[0]:g}, of false "
            f"alarms {factors[1]:g}."
        )
        write_file(given.out, toml(given.name, about, fitted(seen, figures, *factors)))
        load_noise(str(given.out))
    except (HeliosError, OSError, KeyError) as error:
        print(f"noise_fit: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
