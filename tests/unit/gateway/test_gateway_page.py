"""The dashboard's map and the pictures of the map: one set of colours and names."""

from __future__ import annotations

import re
from pathlib import Path

import helios_gateway
import pytest
from helios_map2d.pictures import canvas, legend

PAGE = Path(helios_gateway.__file__).parent / "static"
SAME = {
    "frontier": canvas.FRONTIER_RGB, "beyond": canvas.BEYOND_RGB, "way": canvas.TRAIL_RGB,
    "plan": canvas.PATH_RGB, "robot": canvas.ROBOT_RGB,
}  # fmt: skip
ONLY_THERE = ("low one",)  # obstacles of the page are of one shade


@pytest.mark.parametrize("name", SAME)
def test_a_mark_has_the_colour_that_it_has_in_pictures(name: str) -> None:
    in_light, *_ = re.findall(f"--map-{name}: (#[0-9a-f]{{6}})", (PAGE / "style.css").read_text())
    assert in_light == "#" + bytes(SAME[name]).hex()


def test_the_legend_names_all_that_that_of_pictures_names() -> None:
    text = (PAGE / "index.html").read_text()
    start = text.index('id="legend-2d"')
    said = text[start : text.index("</div>", start)]
    names = re.findall(r'^        \("(.+)", \w+_RGB\)', Path(legend.__file__).read_text(), re.M)
    assert len(names) > 5
    assert [name for name in names if name not in said] == list(ONLY_THERE)
