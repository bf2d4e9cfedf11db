"""How severe the detector's noise must be: the paper's loss, on the trusting agent alone.

    python -m helios_eval.severity --table ovmm-v1 --severities 0.5,1,2 --episodes 100 --out DIR

The paper's Table 4 has the trusting agent at FindObj 57.5 and Pick 56.5 with ground-truth semantics
(%), and Table 1 at 21.9 and 19.3 with a real detector: it keeps 0.38 and 0.34 of them. This plays
the same episodes with ground-truth semantics and at each severity (a factor on the scale of wrong
names and of false things) and says what is kept. HELIOS does not run here: a table that was chosen
by what is good for it would prove nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from helios_core.errors import HeliosError, InvalidInput
from rich.console import Console
from rich.table import Table

from helios_eval.record import EpisodeRecord, Noise
from helios_eval.results import UNLIMITED
from helios_eval.run import Run, run
from helios_eval.spec import noise_of

AGENT = "trusting"
WANTED = {"find_object": 21.9 / 57.5, "pick": 19.3 / 56.5}
_SCALED = ("confuse", "false")  # not what is missed: recall is the table's own


@dataclass(frozen=True)
class Kept:
    """Share of the ground-truth result that is left at one severity, with a 95 % interval."""

    metric: str
    severity: float
    truth: float
    noisy: float
    ratio: float
    low: float
    high: float


def kept(
    metric: str, severity: float, truth: Sequence[bool], noisy: Sequence[bool], seed: int = 0
) -> Kept:
    """Of the same episodes in the same order; the interval is a bootstrap over episodes."""
    pairs = np.array([truth, noisy], float)
    rng = np.random.default_rng(seed)
    drawn = pairs[:, rng.integers(0, pairs.shape[1], (2000, pairs.shape[1]))].mean(-1)
    ratios = drawn[1] / np.maximum(drawn[0], 1e-9)
    low, high = (float(v) for v in np.quantile(ratios, [0.025, 0.975]))
    mean = pairs.mean(1)
    ratio = float(mean[1] / max(mean[0], 1e-9))
    return Kept(metric, severity, float(mean[0]), float(mean[1]), ratio, low, high)


def scaled_table(text: str, severity: float) -> str:
    """The table's text with its scales of wrong names and false things times `severity`.

    Raises InvalidInput where it has none.
    """
    for name in _SCALED:
        pattern = re.compile(rf"^({name} = )([0-9.]+)", re.MULTILINE)
        text, count = pattern.subn(lambda m: f"{m[1]}{float(m[2]) * severity:.6g}", text, 1)
        if count != 1:
            raise InvalidInput(f"the table has no line '{name} = NUMBER'; wanted one in [scale]")
    return text


def play(
    asked: argparse.Namespace, noise: Noise | None, out: Path, console: Console
) -> list[EpisodeRecord]:
    console.print(f"[bold]{out.name}[/]")
    return run(
        Run(
            "ovmm", (AGENT,), (UNLIMITED,), "noisy" if noise else "ground-truth", asked.preset,
            asked.episodes, asked.seed0, out, asked.jobs, noise, {},
        ),
        console,
    )  # fmt: skip


def compare(asked: argparse.Namespace, console: Console) -> list[Kept]:
    """Play what is missing; figures by severity."""
    shipped = resources.files("helios_detector").joinpath("noise_tables", f"{asked.table}.toml")
    text = shipped.read_text(encoding="utf-8")
    truth = play(asked, None, asked.out / "ground-truth", console)
    found: list[Kept] = []
    for severity in map(float, asked.severities.split(",")):
        folder = asked.out / f"severity-{severity:g}"
        folder.mkdir(parents=True, exist_ok=True)
        table = folder / f"{asked.table}.toml"
        table.write_text(scaled_table(text, severity), encoding="utf-8")
        noisy = play(asked, noise_of(str(table), 1.0, None), folder, console)
        found += [
            kept(m, severity, [getattr(r, m) for r in truth], [getattr(r, m) for r in noisy])
            for m in WANTED
        ]
    return found


def show(found: Sequence[Kept], wanted: Mapping[str, float], console: Console) -> None:
    table = Table("severity", "metric", "ground truth", "noisy", "kept", "95 %", "wanted")
    for k in found:
        table.add_row(
            f"{k.severity:g}", k.metric, f"{k.truth:.3f}", f"{k.noisy:.3f}", f"{k.ratio:.3f}",
            f"{k.low:.2f}-{k.high:.2f}", f"{wanted[k.metric]:.3f}",
        )  # fmt: skip
    console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(prog="helios-severity", description=__doc__)
    parser.add_argument("--table", default="ovmm-v1", help="noise table that is shipped")
    parser.add_argument("--severities", default="0.5,1,2", help="factors on its scales")
    parser.add_argument("--preset", default="ovmm-v1", help="kind of homes")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed0", type=int, default=0, help="first home")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("runs/severity"))
    asked, console = parser.parse_args(), Console()
    try:
        found = compare(asked, console)
    except HeliosError as error:
        print(f"helios-severity: {error.message}", file=sys.stderr)
        return 1
    show(found, WANTED, console)
    (asked.out / "severity.json").write_text(json.dumps([asdict(k) for k in found], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
