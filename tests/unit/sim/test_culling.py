"""Tests frustum culling: only geometry outside the camera's view is left out."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from helios_core.robot import Tilt, Turn
from helios_sim.frustum_culling import Frustum
from helios_sim.robot_sensors import DRAWN_GROUPS
from helios_sim.world import World

MODEL = """
<mujoco>
  <worldbody>
    <camera name="eye" fovy="90" quat="0.5 0.5 -0.5 -0.5"/>
    <geom name="ahead" type="sphere" size="0.1" pos="3 0 0"/>
    <geom name="left inside" type="sphere" size="0.1" pos="3 3.9 0"/>
    <geom name="left across" type="sphere" size="0.1" pos="3 6.1 0"/>
    <geom name="left outside" type="sphere" size="0.1" pos="3 6.4 0"/>
    <geom name="above outside" type="sphere" size="0.1" pos="3 0 3.2"/>
    <geom name="above across" type="sphere" size="0.1" pos="3 0 3.1"/>
    <geom name="behind" type="sphere" size="0.1" pos="-3 0 0"/>
    <geom name="around" type="sphere" size="4" pos="-3 0 0"/>
    <geom name="floor" type="plane" size="1 1 1" pos="-9 0 -1"/>
  </worldbody>
</mujoco>
"""


def test_only_geometry_completely_outside_the_frustum_is_culled():
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    outside = Frustum(model, 0, 2.0).outside(data)
    found = {model.geom(k).name for k in np.flatnonzero(outside)}
    assert found == {"left outside", "above outside", "behind"}


def test_images_with_culling_equal_images_without_culling(world: World):
    model, data = world._model, world._data
    painter = world._sensors._painter
    for k in range(8):
        for half in range(2):
            world.act(Turn(math.radians(25)), f"turn-{k}-{half}")
        world.act(Tilt((-0.3, 0.2, 0.9)[k % 3]), f"tilt-{k}")
        drawn = {}
        for painter._cull in (True, False):
            color, depth_m = painter.color_and_depth(data, 10.0)
            drawn[painter._cull] = (color, depth_m, painter.body_ids(data))
        for culled, whole in zip(drawn[True], drawn[False], strict=True):
            assert np.array_equal(culled, whole)
        shown = np.isin(model.geom_group, DRAWN_GROUPS)
        assert painter._frustum.outside(data)[shown].mean() > 0.3
