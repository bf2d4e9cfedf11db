"""Tests the images of a home; they need a graphics library, as the simulator does."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import pytest
from helios_sim.home import PRESETS, generate_home
from helios_sim.home.home_pictures import Pictures, room_views


def test_a_home_is_rendered_from_above_and_at_eye_level() -> None:
    home = generate_home(0, PRESETS["demo-v1"])
    try:
        pictures = Pictures(home, 160, 120)
    except Exception as error:  # the graphics library reports in its own many ways
        pytest.skip(f"no offscreen graphics here: {error}")
    try:
        images = [pictures.above(), *(pictures.at_eye_level(*v) for v in room_views(home))]
    finally:
        pictures.close()
    for image in images:
        assert image.shape == (120, 160, 3)
        assert image.std() > 15
        assert 60 < image.mean() < 235
