"""Options that the commands of `helios eval` share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Agents = Annotated[str, typer.Option(help="agents, separated by commas")]
Limits = Annotated[str, typer.Option(help="pick limits, separated by commas: 1,5,unlimited")]
Semantics = Annotated[str, typer.Option(help="detections: noisy, ground-truth or detector")]
Detector = Annotated[
    str | None,
    typer.Option(help="real detector of --semantics detector: onnx:FILE or transformers:ID"),
]
TaskClasses = Annotated[
    str | None,
    typer.Option(
        help="classes that tasks may ask for: a TOML file, yolox_nano or all  [default: all; with "
        "a real detector the table of its file]"
    ),
]
Preset = Annotated[
    str, typer.Option(help="preset of the homes; +sweethome3d: with realistic furniture")
]
Episodes = Annotated[int, typer.Option(help="number of homes, each with one task", min=1)]
Seed0 = Annotated[int, typer.Option(help="seed of the first home", min=0)]
Out = Annotated[
    Path, typer.Option(help="folder for the results; finished episodes are not run again")
]
Jobs = Annotated[
    int | None, typer.Option(help="number of parallel episodes  [default: number of cores]", min=1)
]
Table = Annotated[str | None, typer.Option("--noise", help="noise table  [default: the preset's]")]
NoiseLevel = Annotated[float, typer.Option(help="noise multiplier; 0: no noise", min=0, max=10)]
Correlation = Annotated[
    float | None, typer.Option(help="1: errors persist, 0: drawn per frame  [default: the table's]")
]
Sensor = Annotated[str, typer.Option(help="noise of camera and pose: none or realistic")]
Scorer = Annotated[
    str | None,
    typer.Option(
        help="image-text scorer of the value maps  [default: simulated:itc-v1; with a real "
        "detector lexical]"
    ),
]
PickRule = Annotated[
    str,
    typer.Option(
        help="physical: a pick takes what lies at the point; ovmm: only the sought class, as in "
        "the HomeRobot OVMM benchmark"
    ),
]
Assignments = Annotated[
    list[str] | None, typer.Option("--set", help="service setting, such as a=1")
]
Steps = Annotated[
    int | None, typer.Option("--max-steps", help="maximum actions per episode", min=1)
]
Absent = Annotated[
    float, typer.Option(help="share of homes that lack the asked object", min=0, max=1)
]
Why = Annotated[
    str, typer.Option(help="reason for docs/results/ledger.jsonl (homes from seed 1000 on)")
]
Homes = Annotated[
    Path | None,
    typer.Option(
        help="plan of a home (.sh3d), or a folder of plans that take turns, instead of a preset"
    ),
]
Level = Annotated[str, typer.Option(help="level of the plans  [default: that with most rooms]")]
Ray = Annotated[str | None, typer.Option(help="address of a Ray cluster, or local")]
