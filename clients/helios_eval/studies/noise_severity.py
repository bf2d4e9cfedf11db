"""Fit of the detector's noise to the paper's loss, on the trusting agent alone.

    python -m helios_eval.studies.noise_severity --table ovmm-v1 --factors 1:1:1,2:1:0.6 --out DIR

In the paper the trusting agent has FindObj 57.5 and Pick 56.5 (%) with ground-truth semantics
(Table 4), and 21.9 and 19.3 with a real detector (Table 1): it keeps 0.38 and 0.34 of them. This
program plays the same episodes with ground-truth semantics and with the table's scales times each
three factors (on wrong names, false objects and misses), and prints the kept shares. HELIOS does
not run here, so that the table cannot be chosen in its favour.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from rich.console import Console
from rich.table import Table

from helios_eval.episodes.episode_record import EpisodeRecord, Noise
from helios_eval.episodes.episode_spec import DEFAULT_SCORER, SCORER, noise_of
from helios_eval.provenance import usable_cores
from helios_eval.report import number_format
from helios_eval.report.interval_statistics import Interval, json_bounds, paired_ratio
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.results import UNLIMITED
from helios_eval.studies.development_homes import homes

AGENT = "trusting"
WANTED = {"find_object": 21.9 / 57.5, "pick": 19.3 / 56.5}


@dataclass(frozen=True)
class Factors:
    """Factors on the scales of a noise table."""

    names: float  # wrong and second names
    false: float
    miss: float

    @classmethod
    def of(cls, text: str) -> Factors:
        """Factors from text like "2:1:0.6". Raises InvalidInput for anything else."""
        try:
            names, false, miss = map(float, text.split(":"))
        except ValueError:
            raise InvalidInput(
                f"{text!r} are no factors; wanted NAMES:FALSE:MISS as in 2:1:0.6"
            ) from None
        return cls(names, false, miss)

    def __str__(self) -> str:
        return f"{self.names:g}:{self.false:g}:{self.miss:g}"


@dataclass(frozen=True)
class Kept:
    """Share of the ground-truth result that remains under noise, with its 95 % interval."""

    metric: str
    factors: str
    truth: float
    noisy: float
    ratio: Interval

    def to_json(self) -> dict[str, str | float | None]:
        """Fields for JSON; None where a value or bound is undefined or infinite."""
        value, low, high = json_bounds(self.ratio)
        return vars(self) | {"ratio": value, "low": low, "high": high}


def kept(metric: str, factors: str, truth: Sequence[bool], noisy: Sequence[bool]) -> Kept:
    """Kept share over the same episodes in the same order, as `paired_ratio`."""
    t, n = np.array(truth, np.float64), np.array(noisy, np.float64)
    return Kept(metric, factors, float(t.mean()), float(n.mean()), paired_ratio(n, t))


def scaled_table(table: str, factors: Factors) -> str:
    """TOML text of a table based on another, with its scales multiplied.

    Raises InvalidInput for a table that is missing, invalid or without scales.
    """
    loaded = load_noise(table)
    if not isinstance(loaded, ViewNoiseTable):
        raise InvalidInput(f"the noise table {table!r} has no [scale]; name one like ovmm-v1")
    scale, f = loaded.file.scale, factors
    rows = {
        "confuse": scale.confuse * f.names,
        "second": scale.second * f.names,
        "false": scale.false * f.false,
        "miss": scale.miss * f.miss,
    }
    lines = [f"{name} = {value:.6g}" for name, value in rows.items()]
    base = os.path.abspath(table) if Path(table).is_file() else table
    return "\n".join([f"base = {json.dumps(base)}", "[scale]", *lines, ""])


def play(
    asked: argparse.Namespace, noise: Noise | None, out: Path, console: Console
) -> list[EpisodeRecord]:
    """Play the trusting agent's episodes into `out`; noise None: ground-truth semantics."""
    console.print(f"[bold]{out.name}[/]")
    return run(
        Run(
            "ovmm", (AGENT,), (UNLIMITED,), "noisy" if noise else "ground-truth", asked.preset,
            asked.episodes, asked.seed0, out, asked.jobs, noise, {SCORER: asked.scorer},
        ),
        console,
    )  # fmt: skip


def compare(asked: argparse.Namespace, console: Console) -> list[Kept]:
    """Play the missing episodes; return the kept shares of all factors."""
    truth = play(asked, None, asked.out / "ground-truth", console)
    found: list[Kept] = []
    for factors in map(Factors.of, asked.factors.split(",")):
        folder = asked.out / str(factors).replace(":", "-")
        folder.mkdir(parents=True, exist_ok=True)
        table = folder / f"{Path(asked.table).stem}.toml"
        write_file(table, scaled_table(asked.table, factors))
        noisy = play(asked, noise_of(str(table), 1.0, None), folder, console)
        found += [
            kept(m, str(factors), [getattr(r, m) for r in truth], [getattr(r, m) for r in noisy])
            for m in WANTED
        ]
    return found


def show(found: Sequence[Kept], wanted: Mapping[str, float], console: Console) -> None:
    """Print a row per metric and factors: shares of episodes, and the kept share, 0 to 1."""
    table = Table("factors", "metric", "ground truth", "noisy", "kept", "95 %", "wanted")
    for k in found:
        table.add_row(
            k.factors,
            k.metric,
            f"{k.truth:.3f}",
            f"{k.noisy:.3f}",
            number_format.number(k.ratio.value, 3),
            number_format.bounds(k.ratio.low, k.ratio.high, 2)
            if k.ratio.has_bounds
            else number_format.NONE,
            f"{wanted[k.metric]:.3f}",
        )
    console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(prog="helios-severity", description=__doc__)
    parser.add_argument("--table", default="ovmm-v1", help="noise table, shipped or a file")
    parser.add_argument("--factors", default="1:1:1", help="on its scales: NAMES:FALSE:MISS,...")
    parser.add_argument("--scorer", default=DEFAULT_SCORER, help="image-text scorer")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed0", type=int, default=0, help="first home")
    parser.add_argument("--jobs", type=int, default=usable_cores())
    parser.add_argument("--out", type=Path, default=Path("runs/severity"))
    asked, console = parser.parse_args(), Console()
    try:
        homes(asked.seed0, asked.episodes)
        found = compare(asked, console)
    except HeliosError as error:
        print(f"helios-severity: {error.message}", file=sys.stderr)
        return 1
    show(found, WANTED, console)
    write_file(asked.out / "severity.json", json.dumps([k.to_json() for k in found], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
