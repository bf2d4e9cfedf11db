"""The dashboard's map and the rendered map images use the same colours and names."""

from __future__ import annotations

import re
from pathlib import Path

import helios_gateway
import pytest
from helios_map2d.pictures import canvas, legend

PAGE = Path(helios_gateway.__file__).parent / "static"
SAME = {
    "frontier": canvas.FRONTIER_RGB,
    "beyond": canvas.BEYOND_RGB,
    "way": canvas.TRAIL_RGB,
    "plan": canvas.PATH_RGB,
    "robot": canvas.ROBOT_RGB,
}
ONLY_THERE = ("low obstacle",)  # the page draws all obstacles in one shade


@pytest.mark.parametrize("name", SAME)
def test_a_mark_has_the_same_colour_on_the_page_and_in_rendered_images(name: str) -> None:
    in_light, *_ = re.findall(f"--map-{name}: (#[0-9a-f]{{6}})", (PAGE / "style.css").read_text())
    assert in_light == "#" + bytes(SAME[name]).hex()


def test_the_page_legend_covers_the_legend_of_the_rendered_images() -> None:
    text = (PAGE / "index.html").read_text()
    start = text.index('id="legend-2d"')
    said = text[start : text.index("</div>", start)]
    names = re.findall(r'^        \("(.+)", \w+_RGB\)', Path(legend.__file__).read_text(), re.M)
    assert len(names) > 5
    assert [name for name in names if name not in said] == list(ONLY_THERE)
