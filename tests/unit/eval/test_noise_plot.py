"""Tests the plot of a noise table."""

import cv2
import pytest
from helios_core.errors import InvalidInput
from helios_eval.studies.noise_plot import alike, draw, view_table


def test_a_noise_table_is_drawn(tmp_path):
    out = tmp_path / "noise.png"
    draw(view_table("ovmm-v1").scaled(2.0), out)
    image = cv2.imread(str(out))
    assert image is not None
    assert image.std() > 10


def test_the_similarity_of_views_decreases_with_their_distance():
    curve = alike(view_table("ovmm-v1"))
    assert curve[0] > curve[1] > curve[2] > curve[3] > curve[6]


def test_a_noise_table_in_the_other_format_is_refused():
    with pytest.raises(InvalidInput, match="ovmm-v1"):
        view_table("demo-v1")
