"""Reliability of "it is not here": estimates of absence against the truth.

    python -m helios_eval.studies.absence_reliability runs/absence --out runs/absence/report

Reads runs of `helios eval ovmm --absent SHARE` with an agent that estimates absence. For a whole
curve, let the agent search on: `--set absent_from=0.99`. Every first estimate of a number of
searches counts. Present and absent objects are weighted as if a share `--prior` of all tasks asked
for an absent object. Writes `absence.md`, `absence.json` and `absence.png`:

- how often the object is absent, by the probability that the agent gave
- by threshold: in how many homes a present object is called absent, and an absent one is, if the
  first estimate that reaches the threshold ends the search
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from helios_core.atomic_file import replacing, write_file
from helios_core.errors import HeliosError, InvalidInput
from matplotlib import pyplot as plt

from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import AbsenceEstimate, EpisodeRecord
from helios_eval.palette import BLUE, GRID, INK, MUTED, VERMILION
from helios_eval.report.interval_statistics import Interval, wilson
from helios_eval.report.number_format import share

mpl.use("Agg")

BORDERS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 1.0)
THRESHOLDS = (0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7)
PRIOR = 0.2


@dataclass(frozen=True)
class Bin:
    """Estimates between two probabilities, the upper one left out unless it is 1. absent_share:
    weighted share of absent objects."""

    low: float
    high: float
    mean: float
    present: int
    absent: int
    absent_share: float


@dataclass(frozen=True)
class Claims:
    """Homes whose search ends with "not here" at a threshold, of present and of absent objects."""

    threshold: float
    present: Interval
    absent: Interval


def first_estimates(record: EpisodeRecord) -> list[AbsenceEstimate]:
    """The first estimate after each number of complete searches."""
    first: dict[int, AbsenceEstimate] = {}
    for estimate in record.absence:
        first.setdefault(estimate.searches, estimate)
    return list(first.values())


def reliability(records: Sequence[EpisodeRecord], prior: float) -> list[Bin]:
    """Share of absent objects by the probability that the agent gave; only bins with estimates."""
    present, absent = ([r for r in records if r.absent is is_so] for is_so in (False, True))
    weights = [(1 - prior) / max(1, len(present)), prior / max(1, len(absent))]
    given = [
        np.array([e.probability for r in part for e in first_estimates(r)])
        for part in (present, absent)
    ]
    out: list[Bin] = []
    for low, high in itertools.pairwise(BORDERS):
        here = [p[(p >= low) & ((p < high) | (high == 1.0))] for p in given]
        counts = [len(p) for p in here]
        weight = [w * n for w, n in zip(weights, counts, strict=True)]
        if total := sum(weight):
            mean = sum(w * float(p.sum()) for w, p in zip(weights, here, strict=True)) / total
            out.append(Bin(low, high, mean, counts[0], counts[1], weight[1] / total))
    return out


def claims(records: Sequence[EpisodeRecord], threshold: float) -> Claims:
    """How often a search ends with "not here"."""
    ends = [
        [any(e.probability >= threshold for e in r.absence) for r in records if r.absent is is_so]
        for is_so in (False, True)
    ]
    return Claims(threshold, *(wilson(sum(part), len(part)) for part in ends))


def markdown(bins: Sequence[Bin], found: Sequence[Claims], records: int) -> str:
    """Both tables."""
    lines = [
        f"# Estimates of absence, {records} homes\n",
        "| probability given | mean | present, absent | absent, weighted |",
        "|---|--:|--:|--:|",
        *(
            f"| {b.low:.1f} to {b.high:.1f} | {b.mean:.2f} | {b.present}, {b.absent} | "
            f"{100 * b.absent_share:.0f} % |"
            for b in bins
        ),
        "",
        "| ends from | present: called absent | absent: called absent |",
        "|---|--:|--:|",
        *(
            f"| {c.threshold:g} | {share(c.present, ' %')} | {share(c.absent, ' %')} |"
            for c in found
        ),
    ]
    return "\n".join(lines) + "\n"


def chart(bins: Sequence[Bin], found: Sequence[Claims], file: Path) -> None:
    """Reliability on the left, claims by threshold on the right."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
    left.plot([0, 1], [0, 1], color=MUTED, lw=1.2, ls=(0, (4, 3)))
    left.plot([b.mean for b in bins], [b.absent_share for b in bins], "o-", color=BLUE)
    for b in bins:
        left.annotate(
            f"{b.present}, {b.absent}",
            (b.mean, b.absent_share),
            xytext=(6, -11),
            textcoords="offset points",
            fontsize=8,
            color=INK,
        )
    left.set(
        xlim=(0, 1),
        ylim=(-0.02, 1.02),
        xlabel="probability that the agent gave",
        ylabel="share of absent objects",
    )
    left.set_title("Is it right? (present, absent)", loc="left", fontsize=11)
    x = [c.threshold for c in found]
    for name, color, of in (
        ("absent objects, called absent", BLUE, [c.absent for c in found]),
        ("present objects, called absent", VERMILION, [c.present for c in found]),
    ):
        right.plot(x, [100 * i.value for i in of], "o-", color=color, label=name)
        right.fill_between(
            x, [100 * i.low for i in of], [100 * i.high for i in of], color=color, alpha=0.15
        )
    right.set(ylim=(0, 100), xlabel="threshold that ends the search", ylabel="% of homes")
    right.legend(frameon=False, fontsize=9)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color=GRID)
    with replacing(file) as part, part.open("wb") as out:
        figure.savefig(out, format="png", dpi=120)
    plt.close(figure)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m helios_eval.studies.absence_reliability",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, nargs="+", help="folders of `helios eval ovmm`")
    parser.add_argument("--prior", type=float, default=PRIOR, help="share of absent objects")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(argv)
    try:
        records = [r for folder in given.folder for r in episode_record.read(folder)]
        agents = sorted({r.agent for r in records if r.absence})
        if len(agents) > 1:
            raise InvalidInput(f"{' and '.join(agents)} estimate absence; give a folder of one")
        records = [r for r in records if r.agent in agents]  # others never claim it
        kinds = {r.absent for r in records}
        if kinds != {False, True}:
            raise InvalidInput(
                f"{len(records)} episodes came, {sum(r.absent for r in records)} with an absent "
                "object; wanted both kinds: run `helios eval ovmm --absent 0.5`"
            )
        bins, found = (
            reliability(records, given.prior),
            [claims(records, threshold) for threshold in THRESHOLDS],
        )
        given.out.mkdir(parents=True, exist_ok=True)
        text = markdown(bins, found, len(records))
        write_file(given.out / "absence.md", text)
        figures = {"bins": [asdict(b) for b in bins], "claims": [asdict(c) for c in found]}
        write_file(given.out / "absence.json", json.dumps(figures, indent=1) + "\n")
        chart(bins, found, given.out / "absence.png")
    except HeliosError as error:
        print(f"absence_reliability: {error.message}", file=sys.stderr)
        return 2
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
