"""Sums up results of `helios chaos`: `python -m helios_chaos.summary FILE…` prints Markdown."""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from helios_chaos.figures import percentiles

HEAD = ("fault", "times", "acting again: p50", "p95", "max", "standing: p95", "max")


def totals(runs: Sequence[dict[str, Any]]) -> str:
    """One sentence on tasks, losses and what was left behind."""

    def added(key: str) -> int:
        return sum(run[key] for run in runs)

    counted = ""
    if all("moves" in run for run in runs):  # files of earlier versions lack these counts
        counted = (
            f"{added('unjudged')} tasks ended with the message that it is not known how far they "
            f"came; {added('moves_succeeded')} of {added('moves')} tasks to move a thing "
            f"succeeded; {added('hit_while_driving')} faults hit a robot that drove; "
        )
    sound = all(run["journal_ok"] and run["map_ok"] for run in runs)
    return (
        f"{sum(len(run['faults']) for run in runs)} faults in {added('minutes'):.0f} minutes; "
        f"{added('tasks')} tasks: {added('succeeded')} succeeded, {added('failed')} failed, "
        f"{added('cancelled')} cancelled, {added('lost')} lost; {added('orphans')} processes left "
        f"behind; {counted}journal and maps {'sound' if sound else 'not sound'}."
    )


def table(runs: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Rows of `HEAD`: one for each kind of fault, then one for all. Times in seconds."""
    by_kind: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for run in runs:
        for fault in run["faults"]:
            by_kind[fault["kind"]].append(fault)
    every = [fault for faults in by_kind.values() for fault in faults]
    return [_row(kind, faults) for kind, faults in sorted(by_kind.items())] + [_row("all", every)]


def _row(name: str, faults: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    again = [f["acting_again_s"] for f in faults if f["acting_again_s"] is not None]
    still = [f["still_after_s"] for f in faults if f["still_after_s"] is not None]
    acts, stands = percentiles(again, 50, 95), percentiles(still, 50, 95)
    cells = (acts["p50"], acts["p95"], acts["max"], stands["p95"], stands["max"])
    return name, str(len(faults)), *("" if v is None else f"{v:.2f}" for v in cells)


def main() -> None:
    parser = argparse.ArgumentParser(prog="helios-chaos-summary", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, help="JSON of `helios chaos`")
    runs = [json.loads(path.read_text()) for path in parser.parse_args().files]
    print(totals(runs), end="\n\n")
    print("| " + " | ".join(HEAD) + " |\n|---|" + "--:|" * (len(HEAD) - 1))
    for row in table(runs):
        print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
