"""Drawings of the report keep long labels of agents readable."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable

import pytest
from helios_eval.report import plots
from helios_eval.report.interval_statistics import Interval
from helios_eval.report.report_model import Graphic

LONG = "helios-paper · evidence=hindsight · named_from=0.15 · tau_g=0.19 · tau_b=0.39 · cs_a=0.2"
AGENTS = ["helios", LONG, f"{LONG} · cs_b=0.2"]
SHARE = Interval(0.5, 0.4, 0.6)


@pytest.mark.parametrize(
    "draw",
    [
        lambda: plots.dots(AGENTS, ["Pick", "Place", "SR"], [[SHARE] * 3] * 3, "Pick and place"),
        lambda: plots.anytime(AGENTS, [[10.0, 20.0]] * 3, [4] * 3),
        lambda: plots.causes(AGENTS, [{"": 3, "place missed": 1}] * 3),
        lambda: plots.effort(AGENTS, [[10.0, 20.0]] * 3, [SHARE] * 3),
        lambda: plots.forest([("SR", f"{a} − {AGENTS[1]}", SHARE) for a in AGENTS]),
    ],
    ids=["dots", "anytime", "causes", "effort", "forest"],
)
def test_a_long_label_takes_several_lines_and_loses_nothing(draw: Callable[[], Graphic]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a layout without room for its axes
        svg = draw().svg
    lines = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    assert max(len(line) for line in lines) <= 60
    for part in LONG.split(" · "):
        assert part in svg
