"""Fit of the simulated image-text scorer's errors, on VLFM and random frontiers alone.

    python -m helios_eval.studies.scorer_severity --spreads 0,0.3,1 --episodes 100 --out DIR

Both agents have VLFM's belief, detector and stop. One drives to the frontier of the highest value,
the other to a random one, so their ratio of SPL shows what the scores of the images are worth. The
program plays object navigation with the table's error spread replaced by each given number, and
prints the ratio. No other agent plays, so that the table cannot be chosen in its favour.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from typing import get_args

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_planner.agent import trusting
from helios_planner.decisions import global_search
from helios_planner.search.baselines import VlfmBelief
from helios_planner.search.frontier_exploration import RuleExplorer
from rich.console import Console
from rich.table import Table

from helios_eval.episodes.episode_record import EpisodeRecord, Semantics, Setting
from helios_eval.episodes.episode_spec import noise_of
from helios_eval.episodes.home_presets import noise_of as noise_of_preset
from helios_eval.provenance import usable_cores
from helios_eval.report import number_format
from helios_eval.report.interval_statistics import Interval, json_bounds, paired_ratio
from helios_eval.runs.evaluation_run import Run, run
from helios_eval.runs.results import UNLIMITED
from helios_eval.studies.development_homes import homes

random_frontiers = trusting(VlfmBelief, partial(RuleExplorer, rule=global_search.drawn))

RANDOM = "helios_eval.studies.scorer_severity:random_frontiers"
VALUE_MAP = "vlfm"


@dataclass(frozen=True)
class Ratio:
    """SPL of VLFM by that of random frontiers over the same homes, with its 95 % interval."""

    spread: str
    homes: int
    random_spl: float
    vlfm_spl: float
    random_success: float
    vlfm_success: float
    ratio: Interval

    def to_json(self) -> dict[str, str | float | None]:
        """Fields for JSON; None where a value or bound is undefined or infinite."""
        value, low, high = json_bounds(self.ratio)
        return vars(self) | {"ratio": value, "low": low, "high": high}


def ratio_of(spread: str, random: Sequence[EpisodeRecord], vlfm: Sequence[EpisodeRecord]) -> Ratio:
    """Ratio over the episodes in the same order, as `paired_ratio`."""
    spl_random, spl_vlfm = (np.array([r.spl for r in records]) for records in (random, vlfm))
    return Ratio(
        spread,
        len(random),
        float(spl_random.mean()),
        float(spl_vlfm.mean()),
        float(np.mean([r.success for r in random])),
        float(np.mean([r.success for r in vlfm])),
        paired_ratio(spl_vlfm, spl_random),
    )


def table_with_spread(text: str, spread: float) -> str:
    """Text of a scorer table with another error spread. Raises InvalidInput without the entry."""
    pattern = re.compile(r"^spread = [0-9.]+", re.MULTILINE)
    changed, count = pattern.subn(f"spread = {spread:g}", text, 1)
    if count != 1:
        raise InvalidInput("the table has no line 'spread = NUMBER'; wanted one in [error]")
    return changed


def play(
    asked: argparse.Namespace, agent: str, scorer: str, out: Path, console: Console
) -> list[EpisodeRecord]:
    """Play the missing episodes of one agent; return all in the order of their seeds."""
    console.print(f"[bold]{out.name}[/]")
    noisy = asked.semantics == "noisy"
    noise = noise_of(noise_of_preset(asked.preset), 1.0, None) if noisy else None
    settings: dict[str, Setting] = {"detector.scorer": scorer}
    records = run(
        Run(
            "objectnav", (agent,), (UNLIMITED,), asked.semantics, asked.preset, asked.episodes,
            asked.seed0, out, asked.jobs, noise, settings,
        ),
        console,
    )  # fmt: skip
    return sorted(records, key=lambda r: r.seed)


def compare(asked: argparse.Namespace, console: Console) -> list[Ratio]:
    """Ratios for all spreads."""
    shipped = resources.files("helios_detector").joinpath("scorer_tables", f"{asked.table}.toml")
    text = shipped.read_text(encoding="utf-8")
    random = play(asked, RANDOM, "lexical", asked.out / "random", console)
    found: list[Ratio] = []
    for spread in asked.spreads.split(","):
        folder = asked.out / f"spread-{spread}"
        folder.mkdir(parents=True, exist_ok=True)
        table = folder / f"{asked.table}.toml"
        write_file(table, table_with_spread(text, float(spread)))
        vlfm = play(asked, VALUE_MAP, f"simulated:{table}", folder, console)
        found.append(ratio_of(spread, random, vlfm))
    return found


def show(found: Sequence[Ratio], console: Console) -> None:
    """Print a row per spread."""
    table = Table(
        "spread", "homes", "SPL random", "SPL VLFM", "SR random", "SR VLFM", "ratio of SPL", "95 %"
    )
    for r in found:
        table.add_row(
            r.spread,
            str(r.homes),
            f"{r.random_spl:.3f}",
            f"{r.vlfm_spl:.3f}",
            f"{r.random_success:.3f}",
            f"{r.vlfm_success:.3f}",
            number_format.number(r.ratio.value, 2),
            number_format.bounds(r.ratio.low, r.ratio.high, 2)
            if r.ratio.has_bounds
            else number_format.NONE,
        )
    console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(prog="helios-scorer-severity", description=__doc__)
    parser.add_argument("--table", default="itc-v1", help="scorer table that is shipped")
    parser.add_argument(
        "--semantics", choices=get_args(Semantics), default="noisy", help="detections"
    )
    parser.add_argument("--spreads", default="0.3", help="spreads of the error, as 0,0.3,1")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed0", type=int, default=0, help="first home")
    parser.add_argument("--jobs", type=int, default=usable_cores())
    parser.add_argument("--out", type=Path, default=Path("runs/scorer-severity"))
    asked, console = parser.parse_args(), Console()
    try:
        homes(asked.seed0, asked.episodes)
        found = compare(asked, console)
    except (HeliosError, ValueError) as error:
        print(f"helios-scorer-severity: {error}", file=sys.stderr)
        return 1
    show(found, console)
    write_file(asked.out / "severity.json", json.dumps([r.to_json() for r in found], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
